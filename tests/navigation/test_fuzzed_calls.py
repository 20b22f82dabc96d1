"""Some of the cases of benchmarks/fuzzing_calls.py, the same ones every time; what must hold of each stands there."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import relnav

CASES = {"PoseNavigator.step": 4, "dual_field.measure": 4, "VehicleNavigator.observe": 8, "find_stars": 25}
EACH = 30
SPOTS = [[-1.5e-3, 0.0], [1.5e-3, 0.0], [0.0, 0.0]]


@pytest.fixture(scope="module")
def fuzzing():
    """The script, which imports another one beside it."""
    place = str(Path(__file__).parents[2] / "benchmarks")
    sys.path.insert(0, place)
    try:
        yield importlib.import_module("fuzzing_calls")
    finally:
        sys.path.remove(place)


NAMES = (
    *("Navigator.step", "PoseNavigator.step", "TargetAttitude.step", "filter_epochs", "three_beacon.measure"),
    *("three_marker.measure", "dual_field.measure", "find_stars", "sun sensors' measure", "load_model", "simulate"),
    "VehicleNavigator.observe",
)


def test_no_call_is_left_out(fuzzing):
    assert set(fuzzing.CALLS) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_breaks_it(fuzzing, tmp_path, name):
    found = fuzzing.fuzz(name, tmp_path, CASES.get(name, EACH), derandomize=True)
    assert {"refused", "given"} & set(found["outcomes"])


def test_a_broken_promise_would_be_found(fuzzing):
    """The check itself can fail."""

    def careless(array):
        array[0] = 1.0

    with pytest.raises(AssertionError, match="arguments stay"):
        fuzzing.asked(careless, np.zeros(3))
    with pytest.raises(AssertionError, match="positive definite"):
        fuzzing.check_covariance([[1.0, 2.0], [2.0, 1.0]])

    class Forgetful:
        seen = 0

        def __getstate__(self):
            return {"seen": self.seen}

        def step(self):
            self.seen += 1
            raise ValueError("no")

    filter_ = Forgetful()
    with pytest.raises(AssertionError, match="as it was"):
        fuzzing.in_turn(filter_, lambda _: None, filter_.step)


@pytest.mark.parametrize("state", [[1e155, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, -1e308]])
def test_a_start_beyond_all_orbits(state):
    """Its range would be infinite beside a finite state."""
    navigator = relnav.Navigator(relnav.load_model("three_beacon_psd"))
    with pytest.raises(ValueError, match=r"state must be finite, and up to 1e\+30 in size"):
        navigator.start(0.0, state, np.eye(6))


@pytest.mark.parametrize("name", ["acceleration_m_s2", "delta_v_m_s"])
def test_a_control_beyond_all_thrusters(name):
    navigator = relnav.Navigator(relnav.load_model("three_beacon_psd"))
    navigator.step(0.0, SPOTS)
    with pytest.raises(ValueError, match=rf"{name} must be finite, and up to 1e\+30 in size"):
        navigator.step(0.1, SPOTS, **{name: [0.0, 1e31, 0.0]})


def test_seeds_are_whole_numbers():
    """Seed 3.5 was taken for 3."""
    with pytest.raises(ValueError, match="seed is a whole number"):
        relnav.simulate(relnav.load_model("three_beacon_psd"), seed=3.5)
