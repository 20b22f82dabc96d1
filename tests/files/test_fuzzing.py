"""Some of the cases of benchmarks/fuzzing.py, the same ones every time; what must hold of each stands there."""

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "fuzzing.py"
CASES = {"models": 60, "parquet": 60, "beacon track": 12, "marker track": 4}
EACH = 80


@pytest.fixture(scope="module")
def fuzzing():
    spec = importlib.util.spec_from_file_location("fuzzing", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


NAMES = (
    *("beacon log", "raw log", "grid", "star frame", "star log", "orbit", "joined log", "sun table"),
    *("models", "published", "detector calibration", "sun calibration", "parquet", "beacon track", "marker track"),
)


def test_no_target_is_left_out(fuzzing, tmp_path):
    assert set(fuzzing.targets(tmp_path)) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_breaks_it(fuzzing, tmp_path, name):
    if name == "parquet":
        pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
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
