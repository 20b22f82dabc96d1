"""A few of the runs of benchmarks/interruption.py, with signals at fixed shares of a command's time."""

import os
import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")


@pytest.fixture(scope="module")
def interruption(script):
    return script("benchmarks/interruption.py")


@pytest.mark.parametrize("name", ["filter", "calibrate"])
def test_files_are_whole_or_absent(interruption, tmp_path, name):
    interruption.prepare(tmp_path)
    found = interruption.end_at_random(name, tmp_path, 3, seed=1)
    assert found["faults"] == []


def test_a_campaign_goes_on_to_the_same_bytes(interruption, tmp_path):
    pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    found = interruption.go_on_after_random("campaign", tmp_path, 3, seed=1)
    assert found["faults"] == []


def test_a_campaign_that_does_not_go_on_is_seen(interruption, tmp_path, monkeypatch):
    """The check itself: a command whose file depends on how often it was started is told."""
    script = (
        "import pathlib, time; place = pathlib.Path('camp'); place.mkdir(exist_ok=True); time.sleep(0.3)\n"
        "(place / f'part-{len(list(place.iterdir()))}').write_text('x')"
    )

    def started(_, folder):
        return subprocess.Popen([sys.executable, "-c", script], cwd=folder, stderr=subprocess.PIPE)

    monkeypatch.setattr(interruption, "start", started)
    monkeypatch.setattr(interruption.np.random, "default_rng", lambda _: Late())
    found = interruption.go_on_after_random("campaign", tmp_path, 1)
    assert any("another folder" in fault for fault in found["faults"])


class Late:
    """Draws a time after the end."""

    def uniform(self, _, high):
        return 3.0 * high


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGTERM, 143, "terminated"), (signal.SIGINT, 130, "interrupted")]
)
def test_in_the_middle_of_the_work(tmp_path, number, code, word):
    """The log comes through a pipe that stays open: the program waits for more, with the half track in its folder."""
    rows = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um\n0,-1500,0,1500,0,0,0\n"
    command = [sys.executable, "-m", "relnav", "filter", "-", "--model", "three_beacon_psd", "--out", "track.csv"]
    process = subprocess.Popen(
        command, cwd=tmp_path, env=os.environ | {"RELNAV_JIT": "0"}, stdin=subprocess.PIPE, stderr=subprocess.PIPE
    )
    process.stdin.write(rows.encode())
    process.stdin.flush()
    until = time.monotonic() + 60.0
    while not list(tmp_path.glob(".track.csv.relnav-part/*")) and time.monotonic() < until:
        time.sleep(0.05)
    assert list(tmp_path.iterdir()), "the work has begun"
    process.send_signal(number)
    error = process.communicate(timeout=60.0)[1].decode()
    assert process.returncode == code
    assert error.strip() == f"relnav: {word}; nothing was written"
    assert list(tmp_path.iterdir()) == []


def test_killed_and_run_again(program, short_log, tmp_path):
    """SIGKILL leaves one hidden folder; the next run of the same command removes it."""
    folder = tmp_path / "work"
    folder.mkdir()
    command = [sys.executable, "-m", "relnav", "filter", "-", "--model", "three_beacon_psd", "--out", "work/track.csv"]
    process = subprocess.Popen(command, cwd=tmp_path, env=os.environ | {"RELNAV_JIT": "0"}, stdin=subprocess.PIPE)
    until = time.monotonic() + 60.0
    process.stdin.write(short_log.read_bytes()[:500])
    process.stdin.flush()
    while not list(folder.glob(".track.csv.relnav-part/*")) and time.monotonic() < until:
        time.sleep(0.05)
    process.kill()
    process.communicate()
    assert [entry.name for entry in folder.iterdir()] == [".track.csv.relnav-part"]
    arguments = ("filter", short_log, "--model", "three_beacon_psd", "--out", "work/track.csv")
    assert program(*arguments, environment={"RELNAV_JIT": "0"}).returncode == 0
    assert [entry.name for entry in folder.iterdir()] == ["track.csv"]


@pytest.mark.parametrize(("number", "code", "word"), [("SIGTERM", 143, "terminated"), ("SIGINT", 130, "interrupted")])
def test_while_it_is_still_being_loaded(program, tmp_path, number, code, word):
    """The signal comes where click is imported: no traceback of Python's."""
    (tmp_path / "click.py").write_text(
        f"import os, signal, time\nos.kill(os.getpid(), signal.{number})\ntime.sleep(9)\n"
    )
    places = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = program("models", environment={"PYTHONPATH": places})
    assert (done.returncode, done.stderr) == (code, f"relnav: {word}; nothing was written\n")


@pytest.mark.parametrize("then", ["raise RuntimeError('no compiled object yet')", "time.sleep(30)"])
@pytest.mark.parametrize(("number", "code", "word"), [("SIGTERM", 143, "terminated"), ("SIGINT", 130, "interrupted")])
def test_while_a_library_calls_back(tmp_path, number, code, word, then):
    """What is raised in a callback of LLVM's is dropped; numba then said "no compiled object yet"."""
    script = f"""
import ctypes, os, signal, time
import relnav.cli

def interrupted(*_):
    def call_back():
        os.kill(os.getpid(), signal.{number})
        time.sleep(0.01)
    ctypes.CFUNCTYPE(None)(call_back)()
    {then}

relnav.cli._command = interrupted
relnav.cli.main()
"""
    begin = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path, timeout=60
    )
    assert (done.returncode, done.stderr) == (code, f"relnav: {word}; nothing was written\n")
    assert time.monotonic() - begin < 25.0
