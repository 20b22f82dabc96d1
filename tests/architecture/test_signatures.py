"""What `help` shows of a public name can be read: types by their names, not by what they stand for."""

import inspect

import pytest

import relnav


def public():
    """Every public function, method and constructor, and what the sensors' modules export."""
    for name in relnav.__all__:
        whole = getattr(relnav, name)
        parts = [getattr(whole, part) for part in dir(whole) if part[0] != "_"] if inspect.ismodule(whole) else [whole]
        for one in parts:
            if inspect.isclass(one) and one.__module__.startswith("relnav"):
                yield from (call for part, call in vars(one).items() if part[0] != "_" or part == "__init__")
            yield one


def test_no_type_is_spelled_out():
    calls = [call for call in public() if inspect.isroutine(call) and call.__module__.startswith("relnav")]
    shown = {call.__qualname__: str(inspect.signature(call)) for call in calls}
    assert {"Navigator.step", "PoseNavigator.step", "TargetAttitude.step", "measure"} <= set(shown)
    assert {name for name, signature in shown.items() if "numpy._typing" in signature} == set()
    assert max(len(shown[f"{kind}.step"]) for kind in ("Navigator", "PoseNavigator", "TargetAttitude")) < 500


@pytest.mark.parametrize(
    ("kind", "model"), [("Navigator", "three_beacon_psd"), ("PoseNavigator", "three_marker_vision")]
)
def test_a_step_in_machine_code_is_that_of_its_class(kind, model):
    step = getattr(relnav, kind)(relnav.load_model(model)).step
    assert repr(step).startswith(f"<bound method {kind}.step of ")
    assert "numpy._typing" not in str(inspect.signature(step))
