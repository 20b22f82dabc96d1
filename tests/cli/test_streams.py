"""Standard streams: a reader that leaves, closed streams, pipes; the work is done whatever becomes of them."""

import json
import os
import subprocess
import sys

import pytest

import relnav.cli

MODEL = ("--model", "three_beacon_psd")
PLAIN = {"RELNAV_JIT": "0"}
posix = pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")


@pytest.fixture
def grid(tmp_path):
    """A grid of known spots for `calibrate psd`."""
    path = tmp_path / "grid.csv"
    places = [(x, y) for x in range(-3000, 3001, 1000) for y in range(-3000, 3001, 1000)]
    rows = [f"{x},{y},{1.01 * x + 0.1 * (x % 7)},{1.01 * y - 0.1 * (y % 5)}" for x, y in places]
    path.write_text("\n".join(["true_x_um,true_y_um,spot_x_um,spot_y_um", *rows]))
    return path


def commands(log, grid):
    """Every kind of command that writes, with its outputs."""
    return {
        "filter": (["filter", log, *MODEL, "--out", "track.csv", "--json", "sum.json"], ["track.csv", "sum.json"]),
        "simulate": (
            ["simulate", "three_beacon_psd", "--duration", "5", "--out", "log.csv", "--truth", "truth.csv"],
            ["log.csv", "truth.csv"],
        ),
        "calibrate": (["calibrate", "psd", grid, "--out", "c.toml", "--json", "c.json"], ["c.toml", "c.json"]),
        "models": (["models", "three_beacon_psd", "--json", "m.json"], ["m.json"]),
    }


@posix
@pytest.mark.parametrize("name", ["filter", "simulate", "calibrate", "models"])
def test_a_reader_that_leaves_costs_nothing(short_log, grid, tmp_path, name):
    """`relnav ... | true`: exit code 0 means that the files are there."""
    arguments, outputs = commands(short_log, grid)[name]
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "relnav", *map(str, arguments)]
    done = subprocess.run(
        command, stdout=write, stderr=subprocess.PIPE, cwd=tmp_path, env=os.environ | PLAIN, check=False, text=True
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")
    assert all((tmp_path / output).stat().st_size for output in outputs)


@posix
@pytest.mark.parametrize("closed", [(1,), (1, 2), (0, 1, 2)])
def test_closed_streams(short_log, tmp_path, closed):
    """As after `>&- 2>&-`: no file takes the number of a stream, and the track is whole."""
    script = f'"{sys.executable}" -m relnav filter "{short_log}" --model three_beacon_psd --out track.csv'
    script += "".join(f" {number}{'<' if number == 0 else '>'}&-" for number in closed)
    done = subprocess.run(script, shell=True, cwd=tmp_path, env=os.environ | PLAIN, check=False)
    assert done.returncode == 0
    assert len((tmp_path / "track.csv").read_text().splitlines()) > 200


@posix
def test_bad_input_with_closed_streams_keeps_its_code(tmp_path):
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    script = f'"{sys.executable}" -m relnav filter bad.csv --model three_beacon_psd >&- 2>&-'
    assert subprocess.run(script, shell=True, cwd=tmp_path, env=os.environ | PLAIN, check=False).returncode == 3


def test_dash_for_everything(program, short_log):
    """`relnav filter - --out -`: the track alone on standard output, the summary beside it."""
    done = program("filter", "-", *MODEL, "--out", "-", input=short_log.read_text(), environment=PLAIN)
    assert done.returncode == 0
    rows = [line for line in done.stdout.splitlines() if not line.startswith("#")]
    assert len(rows) == 201
    assert rows[0].startswith("t_s,x_m,")
    assert "200 epochs" in done.stderr


def test_dash_for_json(program, short_log):
    done = program("filter", short_log, *MODEL, "--json", "-", environment=PLAIN)
    assert json.loads(done.stdout)["epochs"] == 200
    assert program("filter", short_log, *MODEL, "--json", "-", "--out", "-").returncode == 2, "two outputs, one stream"


@posix
def test_a_named_pipe_and_a_shells_substitution(short_log, tmp_path):
    expected = tmp_path / "expected.csv"
    relnav = f'"{sys.executable}" -m relnav filter --model three_beacon_psd --quiet'
    script = f"""
        {relnav} "{short_log}" --out "{expected}" &&
        {relnav} <(cat "{short_log}") --out sub.csv &&
        cat "{short_log}" | {relnav} /dev/stdin --out stdin.csv &&
        mkfifo in out.csv && (cat "{short_log}" > in &) && (cat out.csv > fifo.csv &) &&
        {relnav} in --out out.csv && sleep 0.5
    """
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=os.environ | PLAIN, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr

    def rows(name):
        return [line for line in (tmp_path / name).read_text().splitlines() if not line.startswith("#")]

    for name in ("sub.csv", "stdin.csv", "fifo.csv"):
        assert rows(name) == rows(expected), name


def test_a_filter_that_never_started_says_so_by_its_code(run, tmp_path):
    """One image confirms nothing; the track is written, and holds no state."""
    log = tmp_path / "one.csv"
    log.write_text(
        "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um\n0,-1500,0,1500,0,0,0\n"
    )
    code, out, _ = run("filter", log, *MODEL, "--out", tmp_path / "track.csv")
    assert code == 5
    assert "NOT STARTED" in out
    assert (tmp_path / "track.csv").exists()


def test_nothing_to_compare_is_not_as_expected(run, tmp_path):
    """A model of one's own, without published figures: a script must not take that for a success."""
    copy = tmp_path / "mine.toml"
    assert run("models", "ground_camera", "--copy", copy)[0] == 0
    code, out, _ = run("accuracy", copy, "--runs", "2")
    assert code == 1
    assert "NOTHING TO COMPARE WITH" in out
    assert "as expected" not in out


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
def test_what_was_written_is_what_is_there(short_log, tmp_path, monkeypatch, capfd):
    """A summary or a track that is not printed: the files that are in place are named, and no hidden one."""
    command, track = ["filter", str(short_log), "--model", "three_beacon_psd", "--out"], tmp_path / "track.csv"
    assert relnav.cli.run([*command, "/dev/full"]) == 3
    assert capfd.readouterr().err == "relnav: /dev/full: No space left on device; nothing was written\n"
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert relnav.cli.run([*command, str(track)]) == 3
    assert capfd.readouterr().err == f"relnav: standard output: No space left on device; written: {track}\n"
    assert track.exists()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
def test_a_summary_that_cannot_be_printed(monkeypatch, capfd):
    """A full disk behind standard output, in this process: one sentence, and nothing is tried again at exit."""
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert relnav.cli.run(["models"]) == 3
    assert capfd.readouterr().err == "relnav: standard output: No space left on device; nothing was written\n"
