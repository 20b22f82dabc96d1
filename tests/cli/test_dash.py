"""`-` for what is read, in every command that reads a table: what comes through the pipe is what the file gives."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")
PLAIN = os.environ | {"RELNAV_JIT": "0"}
SPOTS = [f"spot_{beacon}_{axis}_px" for beacon in "abc" for axis in "xy"]
IMAGE = "469.3,553.7,553.7,553.7,511.5,511.5"
PLACES = range(-3000, 3001, 1000)
INPUTS = {
    "markers": "\n".join(["t_s," + ",".join(SPOTS), *(f"{0.1 * k:.1f},{IMAGE}" for k in range(9))]),
    "vehicle": "\n".join(["t_s,sensor,v0,v1,v2", *(f"{0.01 * k:.2f},gyro,0,0.00113,0" for k in range(120))]),
    "grid": "\n".join(
        ["true_x_um,true_y_um,spot_x_um,spot_y_um"]
        + [f"{x},{y},{1.01 * x + 0.1 * (x % 7)},{1.01 * y - 0.1 * (y % 5)}" for x in PLACES for y in PLACES]
    ),
    "sun": "\n".join(["t_s,spot_x_px,spot_y_px", *(f"{k},{512 + 3 * k},{512 - k}" for k in range(9))]),
    "stars": "x_px,y_px,flux\n1,2,3\n-1,2,3\n",
}  # fmt: skip
COMMANDS = {
    "markers": ["filter", "-", "--model", "three_marker_vision", "--out", "out.csv"],
    "vehicle": ["filter", "-", "--model", "rendezvous_demo", "--out", "out.csv"],
    "grid": ["calibrate", "psd", "-", "--out", "out.toml"],
    "sun": ["sun", "measure", "-", "--model", "aps_sun", "--out", "out.csv"],
    "stars": ["stars", "solve", "-", "--focal-px", "3000", "--json", "out.json"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_standard_input(tmp_path, name):
    outputs = {}
    for way in ("-", "table.csv"):
        folder = tmp_path / ("pipe" if way == "-" else "file")
        folder.mkdir()
        (folder / "table.csv").write_text(INPUTS[name])
        arguments = [way if one == "-" else one for one in COMMANDS[name]]
        with (folder / "table.csv").open("rb") as table:
            done = subprocess.run(
                [sys.executable, "-m", "relnav", *arguments], stdin=table, cwd=folder, env=PLAIN, capture_output=True,
                text=True, check=False, timeout=120,
            )  # fmt: skip
        assert "internal error" not in done.stderr
        out = next((entry for entry in folder.iterdir() if entry.name.startswith("out.")), None)
        said = done.stdout.replace("table.csv", "-").replace("stdin", "-")
        outputs[way] = done.returncode, None if out is None else _content(out), len(said.splitlines())
        assert done.returncode in (0, 3), done.stderr
    assert outputs["-"] == outputs["table.csv"]
    assert outputs["-"][0] == 0 or name == "stars", "two stars are no attitude"


def _content(path):
    """Rows; heads name the file."""
    lines = path.read_text().splitlines()
    return [line for line in lines if not line.startswith("#") and "table.csv" not in line and "stdin" not in line]


def test_a_simulated_log_on_standard_output(tmp_path):
    arguments = ["simulate", "three_beacon_psd", "--duration", "2", "--out", "-"]
    command = [sys.executable, "-m", "relnav", *arguments]
    done = subprocess.run(command, cwd=tmp_path, env=PLAIN, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0
    rows = [line for line in done.stdout.splitlines() if not line.startswith("#")]
    assert rows[0].startswith("t_s,spot_a_x_um")
    assert len(rows) in (21, 22)
    assert "log:" in done.stderr
