"""`relnav calibrate sun`: file, report, maps and exit codes, on the example that ships."""

import json
from pathlib import Path

import pytest

from relnav.cli import run

EXAMPLE = Path(__file__).parents[2] / "examples" / "aps_sun_turntable" / "turntable.csv"


def test_all_outputs(tmp_path, capsys):
    files = {name: tmp_path / name for name in ("sun.json", "maps.png", "report.json")}
    arguments = ["--plot", str(files["maps.png"]), "--json", str(files["report.json"])]
    assert run(["calibrate", "sun", str(EXAMPLE), "--out", str(files["sun.json"]), *arguments]) == 0
    out = capsys.readouterr().out
    assert "49 points, model aps_sun, method: rays, field +-60 deg" in out
    assert "residual map, rms in 0.001 deg" in out
    assert "hole_height_m" in out
    assert files["maps.png"].read_bytes().startswith(b"\x89PNG")
    report = json.loads(files["report.json"].read_text())
    assert report["error_before_max_deg"] > 5.0
    assert report["error_after_3rms_deg"] < 0.03
    assert json.loads(files["sun.json"].read_text())["format"] == "relnav sun calibration 1"


def test_quiet(tmp_path, capsys):
    assert run(["calibrate", "sun", str(EXAMPLE), "--out", str(tmp_path / "sun.json"), "--quiet"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["--out", "{tmp}/none/sun.json"], 2, "the folder"),
        (["--out", "{tmp}/sun.json", "--plot", "{tmp}/maps.pdf"], 2, "a picture ends in .png"),
        (["--out", "{tmp}/sun.json", "--json", "{tmp}/sun.json"], 2, "is named twice"),
        (["--out", "{tmp}/sun.json", "--model", "three_beacon_psd"], 3, "an APS sun sensor is expected"),
        (["--out", "{tmp}/sun.json", "--method", "patent"], 3, "lacks 14592 of 14641"),
        (["--out", "{tmp}/sun.json", "--method", "best"], 2, "'best' is not one of"),
    ],
)
def test_wrong_use(tmp_path, capsys, arguments, code, text):
    assert run(["calibrate", "sun", str(EXAMPLE), *(a.format(tmp=tmp_path) for a in arguments)]) == code
    assert text in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_help_lists_the_sensor(capsys):
    assert run(["calibrate", "--help"]) == 0
    assert "sun" in capsys.readouterr().out
    assert run(["calibrate", "sun", "--help"]) == 0
    assert "alpha_deg, beta_deg (projection angles) or outer_deg, inner_deg" in " ".join(
        capsys.readouterr().out.split()
    )
