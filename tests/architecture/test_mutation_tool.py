"""Mutation testing: its files are there, and each excuse is of one mutant that there is."""

from collections import Counter

import pytest


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
