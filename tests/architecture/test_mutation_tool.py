"""Mutation testing: its files are there, and each excuse is of one mutant that there is."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def mutation(script):
    return script("benchmarks/mutation.py")


@pytest.fixture(scope="module")
def every(mutation):
    return [one for files in mutation.room_files().values() for path in files for one in mutation.mutants(path)]


def test_a_place_has_one_name(every):
    assert len(every) > 5000
    names = Counter((one.path, one.within, one.before, one.after) for one in every)
    assert [name for name, count in names.items() if count > 1] == []


def test_an_excuse_is_of_one_mutant(mutation, every):
    there = Counter((one.path, one.within, one.after) for one in every)
    assert mutation.judged()
    assert {key: there[key] for key in mutation.judged() if there[key] != 1} == {}


def test_a_missing_file_is_an_error(mutation, monkeypatch):
    monkeypatch.setattr(mutation, "CLOSED_FORMS", ("sensors/nowhere.py",))
    with pytest.raises(FileNotFoundError, match=r"nowhere\.py"):
        mutation.room_files()


def test_only_a_failed_test_kills(mutation):
    assert set(mutation.KILLED) == {1, mutation.TOO_LONG}


def in_a_program(script, *lines):
    """What lines print in a process of its own that has the tool and nothing of relnav, as the tool runs."""
    head = ["import importlib.util, sys", f"spec = importlib.util.spec_from_file_location('mutation', {str(script)!r})"]
    head += ["mutation = sys.modules['mutation'] = importlib.util.module_from_spec(spec)"]
    head += ["spec.loader.exec_module(mutation)"]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join([*head, *lines])],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"RELNAV_JIT": "0"},
        timeout=240,
        check=True,
    )
    return done.stdout.split()


def test_the_mutant_is_what_is_tested():
    """A change that a test must notice is noticed, and nothing without it: the mutant is what is imported."""
    lines = [
        "path = mutation.ROOT / 'relnav/geometry/rotation_vector.py'",
        "tests = ['tests/geometry/test_rotation_vector.py']",
        "sine = next(one for one in mutation.mutants(path) if one.after.startswith('math.cos('))",
        "print(*(mutation.run_tests(tests, change, 60.0) for change in (None, sine)))",
    ]
    assert in_a_program(ROOT / "benchmarks" / "mutation.py", *lines) == ["0", "1"]


def test_a_test_that_takes_too_long_is_none_and_the_next_is_timed(tmp_path):
    (tmp_path / "test_times.py").write_text(
        "def test_slow():\n    while True:\n        try:\n            sum(range(10**5))\n"
        "        except Exception:\n            pass\n\n\ndef test_quick():\n    pass\n"
    )
    lines = [
        "mutation.LONGEST_TEST_S = 0.5",
        f"watch = mutation.Stopwatch(mutation.Path({str(tmp_path / 'took.json')!r}))",
        f"mutation.run_tests([{str(tmp_path / 'test_times.py')!r}], None, 30.0, watch)",
        "print(*(name.rpartition(':')[2] for name in mutation.json.loads(watch.out.read_text())))",
    ]
    assert in_a_program(ROOT / "benchmarks" / "mutation.py", *lines) == ["test_quick"]
