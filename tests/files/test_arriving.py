"""Bytes that are still coming: a file that grows, is cut, or loses its name; what a signal ends."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from relnav.errors import LogError
from relnav.files import arriving
from relnav.files.arriving import Arriving

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setattr(arriving, "LOOK_AGAIN_S", 0.01)
    path = tmp_path / "log.csv"
    path.write_bytes(b"first")
    return path


def later(action):
    threading.Timer(0.05, action).start()


def test_what_is_appended_comes(file):
    pieces = Arriving()(file)
    assert next(pieces) == b"first"
    with file.open("ab") as more:
        more.write(b"second")
    assert next(pieces) == b"second"


def test_a_file_that_is_cut(file):
    pieces = Arriving()(file)
    next(pieces)
    later(lambda: file.write_bytes(b""))
    with pytest.raises(LogError, match="was cut while it was followed"):
        next(pieces)


def test_another_file_under_its_name(file):
    pieces = Arriving()(file)
    next(pieces)
    (file.parent / "new").write_bytes(b"")
    later(lambda: (file.parent / "new").rename(file))
    with pytest.raises(LogError, match="another file took its name"):
        next(pieces)


def test_a_file_that_was_moved_away_is_read_on(file):
    pieces = Arriving()(file)
    next(pieces)
    with file.open("ab") as more:
        file.rename(file.parent / "old")
        time.sleep(0.05)
        more.write(b"still")
    assert next(pieces) == b"still"


def test_a_pipe_ends_when_nobody_writes():
    read, write = os.pipe()
    os.write(write, b"all")
    os.close(write)
    assert list(Arriving()(Path(f"/dev/fd/{read}"))) == [b"all"]
    os.close(read)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_input(file, number):
    before = signal.getsignal(number)
    with Arriving() as reads:
        pieces = reads(file)
        assert next(pieces) == b"first"
        later(lambda: os.kill(os.getpid(), number))
        assert list(pieces) == []
        assert reads.ended_by == number
    assert signal.getsignal(number) is before


def test_a_signal_during_the_work_lets_it_be_done(file):
    with Arriving() as reads:
        pieces = reads(file)
        next(pieces)
        os.kill(os.getpid(), signal.SIGINT)
        assert reads.ended_by == signal.SIGINT, "nothing is raised while there is work"
        assert list(pieces) == []


def test_the_second_signal_ends_everything():
    with Arriving():
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
