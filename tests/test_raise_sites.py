"""Which messages the tests trigger is counted rightly: every `raise` that makes an error, noted when it runs."""

import ast
from types import SimpleNamespace

import pytest

import relnav

SOURCE = """
def f(x):
    if x:
        raise ValueError("a sentence") from None
    try:
        return 1 / x
    except ZeroDivisionError:
        raise
"""


def test_a_refused_call_is_noted(messages):
    model = relnav.load_model("three_beacon_psd")
    found = (name for name in messages.sites() if name.startswith("relnav/navigation/arguments.py"))
    (site,) = (name for name in found if "method must be" in messages.sites()[name])
    messages.seen.discard(site)
    with pytest.raises(ValueError, match="method must be"):
        relnav.Navigator(model, method="spot")
    assert site in messages.seen
    assert site not in [line.split(": ")[0] for line in messages.untold(messages.seen)]


def test_what_no_test_triggers_is_named(messages):
    everything = set(messages.sites())
    assert len(everything) > 500
    assert messages.untold(everything) == []
    (line,) = messages.untold(everything - {min(everything)})
    assert line.startswith(f"{min(everything)}: raise ")


def test_only_errors_that_are_made_are_sites(messages):
    changed = messages.Noting(messages.PACKAGE / "module.py").visit(ast.parse(SOURCE))
    assert ast.unparse(changed).count(messages.NOTE) == 1
    assert f"{messages.NOTE}('relnav/module.py:4')" in ast.unparse(changed)


@pytest.fixture
def run(messages, monkeypatch):
    """The counts of a run of its own, in which every message was triggered but the first."""
    for name in ("seen", "skipped", "left_out"):
        monkeypatch.setattr(messages, name, set())
    messages.seen.update(messages.sites())
    messages.seen.discard(min(messages.sites()))
    return messages


def test_a_message_that_no_test_triggers_fails_a_whole_run(run):
    lines, fails = run.verdict()
    assert fails
    assert lines[0] == "messages that no test triggers: 1"
    assert min(run.sites()) in lines[1]
    run.join({"seen": [min(run.sites())]})  # by another process
    assert run.verdict() == ([], False)


def test_where_tests_were_skipped_it_is_told_alone(run):
    """As an extra is not installed; not where the test has nothing to do with the package, or is expected to fail."""
    report = SimpleNamespace(skipped=True, nodeid="test_x.py::test_y", keywords={})
    for other in ({"keywords": {"messageless": 1}}, {"wasxfail": "why"}, {"skipped": False}):
        run.note_skip(SimpleNamespace(**vars(report) | other))
    assert run.verdict()[1]
    run.note_skip(SimpleNamespace(skipped=True, nodeid="test_z.py"))  # a whole file has no keywords
    lines, fails = run.verdict()
    assert not fails
    assert "were skipped: 1 " in lines[-1]
    assert run.kept()["skipped"] == ["test_z.py"]


@pytest.mark.parametrize("part", ["keyword", "ignore_glob", "lf", "collectonly"])
def test_a_part_of_the_tests_is_not_a_whole_run(run, part):
    assert run.is_whole(SimpleNamespace(keyword="", lf=False))
    assert not run.is_whole(SimpleNamespace(**{part: "x"}))
    run.left_out.add("test_x.py::test_y")
    assert not run.is_whole(SimpleNamespace())
