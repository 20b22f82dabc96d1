"""A file appears whole or not at all; what was there before stays until the new one is complete."""

import errno
import os
import stat

import numpy as np
import pytest

import relnav
from relnav.files import tracks
from relnav.files.atomic import replacing
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
        assert temporary.parent == path.parent, "a rename is atomic within one file system only"
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
