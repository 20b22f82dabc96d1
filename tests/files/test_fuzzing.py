"""Some of the cases of benchmarks/fuzzing.py, the same ones every time; what must hold of each stands there."""

import importlib
import os
import random
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
FOUND = Path(__file__).with_name("found")
CASES = {"models": 60, "parquet": 120, "beacon track": 12, "marker track": 4, "vehicle track": 12}
CASES |= dict.fromkeys(("campaign, its description", "campaign, its summary", "campaign, its runs"), 30)
EACH = 80
NEEDS = {"parquet": "pyarrow", "campaign": "pyarrow", "ROS": "rosbags", "picture .fits": "astropy", "picture": "PIL"}


@pytest.fixture(scope="module")
def fuzzing():
    """The script, which imports others beside it."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        yield importlib.import_module("fuzzing")
    finally:
        sys.path.remove(str(BENCHMARKS))


NAMES = (
    *("beacon log", "raw log", "grid", "star frame", "star log", "orbit", "joined log", "sun table", "sun log"),
    *("vehicle log", "track", "models", "published", "scenario", "accuracy report", "detector calibration"),
    *("sun calibration", "parquet", "picture .png", "picture .tif", "picture .fits", "ROS 1 bag"),
    *("ROS 2 bag, its description", "ROS 2 bag, its messages", "beacon track", "marker track", "vehicle track"),
    *("campaign, its description", "campaign, its summary", "campaign, its runs"),
)


def need(name):
    """Skip without the package that a target's files need."""
    for word, package in NEEDS.items():
        if name.startswith(word):
            pytest.importorskip(package, reason="an extra is not installed")
            return


def test_no_target_is_left_out(fuzzing, tmp_path):
    assert set(fuzzing.targets(tmp_path)) == set(NAMES)


@pytest.mark.parametrize("file", sorted(path.name for path in FOUND.iterdir()))
def test_what_was_found_once(fuzzing, tmp_path, file):
    """Each of these files broke something: a traceback, an internal error, a NaN, a wrong message."""
    word = file.partition("-")[0].replace("_", " ")
    need(word)
    one, make, _ = fuzzing.tried(word, tmp_path)
    make(fuzzing.Seeded(random.Random(0)))  # where the target is a file of a folder, the others are made with its first
    one((FOUND / file).read_bytes())


@pytest.mark.parametrize("name", NAMES)
def test_nothing_breaks_it(fuzzing, tmp_path, name):
    need(name)
    cases = CASES.get(name, EACH)
    found = fuzzing.fuzz(name, tmp_path, cases, derandomize=True)
    assert found["cases"] >= cases // 2
    assert len(found["outcomes"]) > 1, "good files and bad ones among them"


def test_a_traceback_would_be_found(fuzzing, tmp_path):
    """The check itself can fail: a reader that trips over a cell is reported."""

    def careless(path):
        path.read_bytes().decode()

    with pytest.raises(UnicodeDecodeError):
        fuzzing.try_one(tmp_path / "log.csv", careless, b"\xff")

    def rude(path):
        raise fuzzing.InputError(f"{path}: \x1b[31m")

    with pytest.raises(AssertionError, match="a terminal obeys"):
        fuzzing.try_one(tmp_path / "log.csv", rude, b"")


def test_what_hangs_would_be_found(fuzzing, monkeypatch):
    """Whether it works without end, or waits; and although it catches every Exception."""
    monkeypatch.setattr(fuzzing, "LONGEST_S", 0.2)

    def busy():
        while True:
            try:
                time.sleep(0.01)
                sum(range(1000))
            except Exception:
                continue

    with pytest.raises(AssertionError, match="takes too long"), fuzzing.watched(0.01):
        busy()
    read, write = os.pipe()
    with pytest.raises(AssertionError, match="takes too long"), fuzzing.watched(0.01):
        os.read(read, 1)
    os.close(read)
    os.close(write)


def test_a_file_that_ends_the_process_is_a_fault(fuzzing, tmp_path, monkeypatch):
    """As a library in another language can: it is told and kept, and the cases behind it are tried."""
    ends, kept = fuzzing.Seeded(random.Random("0 2")).whole(0, 10**6), []

    def tried(name, folder):  # noqa: ARG001  (as the one it stands for)
        outcomes = Counter()

        def one(number):
            if number == ends:
                os._exit(9)
            outcomes["read"] += 1

        return one, lambda choose: choose.whole(0, 10**6), outcomes

    monkeypatch.setattr(fuzzing, "tried", tried)
    monkeypatch.setattr(fuzzing, "keep", lambda name, folder: kept.append((name, folder)))
    found = fuzzing.seeded("models", tmp_path, 5, 0)
    assert found["faults"] == ["the process ended with 9"]
    assert found["outcomes"] == {"read": 2, "fault": 1, "not counted": 2}
    assert kept == [("models", tmp_path)]
