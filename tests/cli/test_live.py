"""`relnav filter --follow` as a program: pipes, growing files, signals, a reader that leaves, a disk that is full."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX pipes and signals")
PLAIN = {"RELNAV_JIT": "0"}
MODEL = ("--model", "three_beacon_psd")
ENDINGS = [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]


@contextmanager
def following(*arguments, **options):
    """The program, running."""
    command = [sys.executable, "-m", "relnav", "filter", "--follow", *MODEL, *map(str, arguments)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, env=os.environ | PLAIN, text=True, **(pipes | options))
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            with suppress(OSError):
                if stream is not None:
                    stream.close()


def rows_of(text):
    return [line for line in text.splitlines() if not line.startswith("#")]


def until(true, seconds=30.0):
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.02)
    assert true()


def test_each_row_is_answered_before_the_next_comes(short_log, tmp_path, program):
    """Over pipes; the lines are those of the whole log's track, to the last bit."""
    whole = program("filter", short_log, *MODEL, "--out", tmp_path / "track.csv", "--quiet", environment=PLAIN)
    assert whole.returncode == 0
    head, *rows = rows_of(short_log.read_text())
    with following("-") as process:
        process.stdin.write(head + "\n")
        answers = []
        for row in rows[:50]:
            process.stdin.write(row + "\n")
            process.stdin.flush()
            answers.append(next(line for line in process.stdout if line[0].isdigit()).rstrip("\n"))
        out, error = process.communicate()
    assert (process.returncode, out) == (0, "")
    assert answers == rows_of((tmp_path / "track.csv").read_text())[1:51]
    assert "50 epochs" in error


def test_a_growing_file_until_a_signal(short_log, tmp_path):
    number, code, word = ENDINGS[0]
    log, track = tmp_path / "log.csv", tmp_path / "track.jsonl"
    text = short_log.read_text()
    log.write_text(text[:2000])
    with following(log, "--out", track) as process, log.open("a") as file:
        until(lambda: track.exists() and track.read_text())
        whole = len(rows_of(text[:2000])) - 2  # the header, and a row that is not yet whole
        until(lambda: len(track.read_text().splitlines()) == whole)
        file.write(text[2000:] + "x,y\n")
        file.flush()
        until(lambda: len(track.read_text().splitlines()) == len(rows_of(text)) - 1)
        process.send_signal(number)
        out, error = process.communicate(timeout=30.0)
    assert process.returncode == code
    found = [json.loads(line) for line in track.read_text().splitlines()]
    assert len(found) == len(rows_of(text)) - 1
    assert f"log.csv:{len(text.splitlines()) + 1}: " in error
    assert "cells are expected as in the header; got 2; row left out" in error
    assert f"relnav: {word}; written: {len(found)} rows of {track}" in error
    assert f"{len(found)} epochs" in out, "the summary is told all the same"
    assert "1 row left out" in out


@pytest.mark.parametrize(
    ("number", "code", "word", "head"),
    [(*ENDINGS[0], "t_s,sp"), (*ENDINGS[1], None)],
    ids=["half a header", "a header"],
)
def test_a_signal_before_any_row(short_log, tmp_path, number, code, word, head):
    os.mkfifo(tmp_path / "log")
    with following(tmp_path / "log", "--out", tmp_path / "track.csv") as process, (tmp_path / "log").open("w") as file:
        file.write(head or rows_of(short_log.read_text())[0] + "\n")  # it is open: the program waits
        file.flush()
        time.sleep(0.2)
        process.send_signal(number)
        assert process.wait(timeout=30.0) == code
        assert process.stderr.read().strip().startswith(f"relnav: {word}; ")


def test_a_reader_that_leaves_ends_it(short_log):
    with following("-") as process:
        process.stdout.close()
        for row in rows_of(short_log.read_text()):
            try:
                process.stdin.write(row + "\n")
                process.stdin.flush()
            except BrokenPipeError:
                break
        assert process.wait(timeout=30.0) == 0
        assert process.stderr.read() == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_full_disk_is_told(short_log):
    with open("/dev/full", "w") as full, following("-", stdout=full) as process:
        _, error = process.communicate(short_log.read_text(), timeout=30.0)
    assert process.returncode == 3
    assert "No space left on device" in error


ROOM = 50_000
"""Bytes that a file may have: some rows, and a part of one."""


def little_room():
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM))


@pytest.mark.parametrize("ending", ["csv", "jsonl"])
def test_rows_before_a_full_disk_are_counted_and_whole(short_log, tmp_path, ending):
    """A part of what is written at once is there: each row of it to its end, and the next is cut off."""
    out = tmp_path / f"track.{ending}"
    with following("-", "--out", out, preexec_fn=little_room) as process:
        _, error = process.communicate(short_log.read_text(), timeout=30.0)
    text = out.read_text()
    rows = rows_of(text)[ending == "csv" :]  # its first names the columns
    assert process.returncode == 3
    assert len(rows) > 10
    assert f"written: {len(rows)} rows of {out}\n" in error
    assert text.endswith("\n")
    assert 0.9 * ROOM < len(text) < ROOM
    assert json.loads(rows[-1])["t_s"] > 1.0 if ending == "jsonl" else rows[-1].count(",") == rows[0].count(",")


def test_a_part_of_a_row_on_standard_output_is_told(short_log, tmp_path):
    """It is not this program's file to cut."""
    with (tmp_path / "track.csv").open("w") as out, following("-", stdout=out, preexec_fn=little_room) as process:
        _, error = process.communicate(short_log.read_text(), timeout=30.0)
    text = (tmp_path / "track.csv").read_text()
    assert process.returncode == 3
    assert len(text) == ROOM
    assert f"written: {len(rows_of(text)) - 2} rows of /dev/stdout and a part of one more\n" in error


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--smooth"], "--smooth looks at a whole log, --follow at one that grows"),
        (["--plot", "a.png"], "--plot looks at a whole log"),
        (["--json", "a.json"], "--json looks at a whole log"),
        (["--out", "a.oem"], "ends in .csv or .jsonl; got '.oem'"),
        (["--out", "a.csv", "--format", "jsonl"], "ends in .csv, but .jsonl is asked for"),
        (["--out", "."], "is a folder"),
    ],
)
def test_wrong_use(run, short_log, tmp_path, monkeypatch, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    code, _, error = run("filter", "--follow", short_log, *MODEL, *arguments)
    assert code == 2
    assert sentence in error


def test_nothing_that_starts_the_filter_is_told_by_the_code(run, lines_of_one, tmp_path):
    read, write = os.pipe()
    os.write(write, lines_of_one.encode())
    os.close(write)
    code, out, _ = run("filter", "--follow", f"/dev/fd/{read}", *MODEL, "--out", tmp_path / "track.csv")
    os.close(read)
    assert code == 5
    assert "NOT STARTED" in out
    assert len(rows_of((tmp_path / "track.csv").read_text())) == 2


@pytest.fixture
def lines_of_one():
    """A log of one image, which confirms nothing."""
    return "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um\n0,-1500,0,1500,0,0,0\n"


def test_a_terminal_shows_how_it_stands(short_log, tmp_path):
    """Standard error is a terminal, the track goes to a file: a view that says the last state and what was left out."""
    pty = pytest.importorskip("pty", reason="no pseudo terminals")
    controller, terminal = pty.openpty()
    environment = {"env": os.environ | PLAIN | {"TERM": "xterm", "COLUMNS": "100", "LINES": "30", "NO_COLOR": "1"}}
    command = [sys.executable, "-m", "relnav", "filter", "--follow", "-", *MODEL, "--out", str(tmp_path / "t.csv")]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=terminal, text=True, **environment
    )
    os.close(terminal)
    process.stdin.write(short_log.read_text() + "x,y\n")
    process.stdin.flush()
    shown = ""
    end = time.monotonic() + 30.0
    wanted = ("1 left out", "3-sigma", "row left out")
    while not all(words in shown for words in wanted) and time.monotonic() < end:
        shown += os.read(controller, 100_000).decode()
    out, _ = process.communicate(timeout=30.0)
    os.close(controller)
    assert "stdin, three_beacon_psd" in shown
    assert "200 rows" in shown
    assert "range" in shown
    assert "row left out" in shown, "what is told stands above the view"
    assert "200 epochs" in out
    assert process.returncode == 0
