"""Which messages the tests trigger is counted rightly: every `raise` that makes an error, noted when it runs."""

import ast

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
