"""A file appears whole or not at all; what was there before stays until the new one is complete."""

import errno
import os
import signal
import stat
from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.files import tracks
from relnav.files.atomic import IN_PLACE, Outputs, replacing
from relnav.files.tables import write_json


@pytest.fixture
def solution():
    t = 0.1 * np.arange(50)
    spots = np.tile([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]], (50, 1, 1))
    return relnav.filter_epochs(relnav.load_model("three_beacon_psd"), t, spots, method="spots")


def break_after(monkeypatch, parts, error):
    """Let the writing of a track fail with `error` after some parts are written."""
    monkeypatch.setattr(tracks, "ROWS_AT_ONCE", 10)
    original, calls = relnav.Solution.part, []

    def part(self, begin, end):
        calls.append(begin)
        if len(calls) > parts:
            raise error
        return original(self, begin, end)

    monkeypatch.setattr(relnav.Solution, "part", part)


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt(), ValueError("a bug"), MemoryError()]
)
@pytest.mark.parametrize("old", [None, "what was there\n"])
def test_a_track_that_cannot_be_finished(solution, tmp_path, monkeypatch, error, old):
    path = tmp_path / "track.csv"
    if old is not None:
        path.write_text(old)
    break_after(monkeypatch, 3, error)
    with pytest.raises(type(error)):
        relnav.write(solution, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ([] if old is None else ["track.csv"])
    if old is not None:
        assert path.read_text() == old


def test_a_rename_that_fails_leaves_nothing(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("pathlib.Path.replace", refuse)
    with pytest.raises(PermissionError):
        write_json({"a": 1}, tmp_path / "out.json")
    assert list(tmp_path.iterdir()) == []


def test_the_old_file_is_there_until_the_new_one_is_complete(tmp_path):
    path = tmp_path / "out.txt"
    path.write_text("old")
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        assert temporary.parent.parent == path.parent, "a rename is atomic within one file system only"
    assert path.read_text() == "new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.txt"]


def test_rights_are_those_of_an_ordinary_new_file(tmp_path):
    write_json({}, tmp_path / "ours.json")
    (tmp_path / "plain.json").write_text("")
    ours, plain = ((tmp_path / name).stat().st_mode for name in ("ours.json", "plain.json"))
    assert stat.S_IMODE(ours) == stat.S_IMODE(plain)


def test_a_missing_folder_is_named(solution, tmp_path):
    with pytest.raises(relnav.UsageError, match=r"the folder .*none does not exist; make it, or write elsewhere"):
        relnav.write(solution, tmp_path / "none" / "track.csv")


def test_a_folder_is_no_file(solution, tmp_path):
    (tmp_path / "track.csv").mkdir()
    with pytest.raises(relnav.UsageError, match="is a folder; name a file in it"):
        relnav.write(solution, tmp_path / "track.csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_a_pipe_or_device_is_not_replaced_by_a_file(tmp_path):
    """As with /dev/stdout or, worse, /dev/null as root: it is written into, and stays what it is."""
    pipe = tmp_path / "out.json"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # so that a writer does not wait
    try:
        write_json({"a": 1}, pipe)
        assert os.read(reader, 100) == b'{\n  "a": 1\n}\n'
    finally:
        os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no symbolic links on this system")
def test_a_link_stays_a_link(tmp_path):
    """`latest.json -> run7.json`: the file that it names is written."""
    real, link = tmp_path / "run7.json", tmp_path / "latest.json"
    real.write_text("old")
    link.symlink_to(real)
    write_json({"a": 1}, link)
    assert link.is_symlink()
    assert real.read_text() == '{\n  "a": 1\n}\n'


def test_files_of_one_block_appear_together(tmp_path):
    first, second = tmp_path / "a.csv", tmp_path / "b.json"
    second.write_text("old")
    with Outputs() as outputs:
        outputs.path(first).write_text("1")
        outputs.path(second).write_text("2")
        assert sorted(entry.name for entry in tmp_path.iterdir()) == [".a.csv.relnav-part", "b.json"]
        assert second.read_text() == "old"
    assert {entry.name: entry.read_text() for entry in tmp_path.iterdir()} == {"a.csv": "1", "b.json": "2"}


def _one_then_error(outputs, first, second):
    with outputs:
        outputs.path(first).write_text("1")
        outputs.path(second)
        raise OSError(errno.ENOSPC, "No space left on device")


def test_none_of_them_after_an_error(tmp_path):
    with pytest.raises(OSError, match="No space"):
        _one_then_error(Outputs(), tmp_path / "a.csv", tmp_path / "b.json")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_names_the_file_that_was_asked_for(tmp_path):
    """Not the hidden one, however many writers stand between."""

    def fill(path):
        with replacing(path) as temporary, replacing(temporary):
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space") as caught:
        fill(tmp_path / "track.csv")
    assert caught.value.filename == str(tmp_path / "track.csv")


def test_what_is_in_place_is_told(tmp_path):
    token = IN_PLACE.set([])
    try:
        write_json({}, tmp_path / "a.json")
        assert IN_PLACE.get() == [str(tmp_path / "a.json")]
    finally:
        IN_PLACE.reset(token)


@pytest.mark.skipif(os.name == "nt", reason="POSIX locks")
def test_what_a_killed_program_left_is_taken_over(tmp_path):
    """Its lock went with it."""
    left = tmp_path / ".out.json.relnav-part"
    (left / "sub").mkdir(parents=True)
    (left / "0.json").write_text("half")
    write_json({"a": 1}, tmp_path / "out.json")
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.json"]


@pytest.mark.skipif(os.name == "nt", reason="POSIX locks")
def test_two_programs_may_write_one_file(tmp_path):
    """Each in a folder of its own; the last to finish stays."""
    path = tmp_path / "out.txt"
    with replacing(path) as first:
        first.write_text("first")
        with replacing(path) as second:
            assert second.parent != first.parent
            second.write_text("second")
        assert path.read_text() == "second"
    assert path.read_text() == "first"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.txt"]


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no symbolic links on this system")
def test_links_in_a_circle_are_named(tmp_path):
    a, b = tmp_path / "a.json", tmp_path / "b.json"
    a.symlink_to(b)
    b.symlink_to(a)
    with pytest.raises(relnav.UsageError, match=r"a\.json: a link that leads back to itself"):
        write_json({}, a)


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_waits_until_the_files_are_in_place(tmp_path, monkeypatch, number):
    """Between two renames: both files are there, then the program ends."""
    original = Path.replace

    def interrupted(self, target):
        signal.raise_signal(number)
        return original(self, target)

    monkeypatch.setattr("pathlib.Path.replace", interrupted)

    def write():
        with Outputs() as outputs:
            outputs.path(tmp_path / "a").write_text("1")
            outputs.path(tmp_path / "b").write_text("2")

    before = signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            write()
    finally:
        signal.signal(number, before)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a", "b"]
