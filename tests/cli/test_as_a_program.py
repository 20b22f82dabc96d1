"""The command line as a program of its own: pipes, signals, a full disk, exit codes as a shell sees them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

MODEL = ("--model", "three_beacon_psd")


def test_done_and_quiet_when_piped(program, short_log, tmp_path):
    done = program("filter", short_log, *MODEL, "--out", "track.csv")
    assert done.returncode == 0
    assert done.stderr == "", "no progress bar, no warning"
    assert "200 epochs" in done.stdout
    assert (tmp_path / "track.csv").exists()


def test_a_long_log_shows_no_bar_when_piped(program, vbar_log, tmp_path):
    """A log large enough for a bar in a terminal."""
    lines = vbar_log.read_text().splitlines()
    rows = [f"{k / 10!r}," + line.partition(",")[2] for k, line in enumerate(lines[1:] * 22)]
    log = tmp_path / "long.csv"
    log.write_text("\n".join([lines[0], *rows]))
    assert log.stat().st_size > 5_000_000
    program("filter", log, *MODEL)  # what is not at hand is compiled, and that is said, once
    done = program("filter", log, *MODEL)
    assert done.returncode == 0
    assert done.stderr == ""
    assert "\r" not in done.stdout
    assert "#" not in done.stdout


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--help"], 0),
        (["filter"], 2),
        (["filter", "none.csv", *MODEL], 2),
        (["filter", "empty.csv", *MODEL], 3),
    ],
)
def test_exit_codes(program, tmp_path, arguments, code):
    (tmp_path / "empty.csv").write_text("")
    assert program(*arguments).returncode == code


def test_the_installed_command_is_the_module(short_log):
    command = Path(sys.executable).with_name("relnav")
    if not command.exists():
        pytest.skip("relnav is not installed beside this Python")
    done = subprocess.run([command, "filter", short_log, *MODEL], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "200 epochs" in done.stdout


def test_a_reader_that_leaves_is_no_error():
    """As in `relnav models three_beacon_psd | head -1`; 1 would mean that an accuracy was not met."""
    command = [sys.executable, "-m", "relnav", "models", "three_beacon_psd"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        error = process.stderr.read()
    assert process.returncode == 0
    assert error == ""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX limit on the size of files")
def test_a_disk_that_fills_up_while_writing(program, short_log, tmp_path):
    """The system itself refuses to write beyond 20 kB: the half track goes, yesterday's stays."""
    import resource

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    (tmp_path / "track.csv").write_text("of yesterday")
    # The limit holds for compiled code that would be kept, too: run without.
    done = program("filter", short_log, *MODEL, "--out", "track.csv", environment={"RELNAV_JIT": "0"}, preexec_fn=limit)
    assert done.returncode == 3
    assert "nothing was written" in done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "track.csv").read_text() == "of yesterday"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["short.csv", "track.csv"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
def test_standard_output_on_a_full_disk(program, short_log, tmp_path):
    """The track was written before the summary could not be printed: that is not to be denied."""
    with open("/dev/full", "w") as full:
        done = program(
            "filter", short_log, *MODEL, "--out", "track.csv", capture_output=False, stdout=full, stderr=subprocess.PIPE
        )
    assert done.returncode == 3
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "track.csv").exists() or "nothing was written" not in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_control_c(vbar_log, tmp_path):
    """A real interrupt in the middle of the work (plain Python, so that it takes long enough)."""
    lines = vbar_log.read_text().splitlines()
    rows = [f"{k / 10!r}," + line.partition(",")[2] for k, line in enumerate(lines[1:] * 5)]
    (tmp_path / "log.csv").write_text("\n".join([lines[0], *rows]))
    command = [sys.executable, "-m", "relnav", "filter", "log.csv", *MODEL, "--out", "track.csv"]
    process = subprocess.Popen(
        command,
        cwd=tmp_path,
        env=os.environ | {"RELNAV_JIT": "0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(2.0)
    assert process.poll() is None, "the work was over before it could be interrupted"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.strip() == "relnav: interrupted; nothing was written"
    assert out == ""
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.csv"]
