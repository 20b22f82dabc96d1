"""The target that flies has another inertia than the model says, by as much as the model states."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import relnav
from relnav.accuracy.run_score_markers import MARKERS
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.dispersed_markers import fly_marker_run
from relnav.simulation.dispersions import Scenario
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.target_rotation import true_inertia
from relnav.simulation.trajectory import Approach

SIGMA = ((60.0, 30.0, 0.0), (30.0, 90.0, 0.0), (0.0, 0.0, 120.0))
NAMES = ("inertia_xx", "inertia_yy", "inertia_zz", "inertia_xy")


@pytest.fixture(scope="module")
def shipped():
    return relnav.load_model("three_marker_vision")


@pytest.fixture(scope="module")
def stated(shipped):
    return replace(shipped, target=replace(shipped.target, inertia_sigma_kg_m2=SIGMA))


def test_each_entry_is_off_by_its_sigmas(stated):
    off = true_inertia(stated.target, np.array([1.0, 2.0, -1.0, 5.0, 5.0, 3.0])) - stated.target.inertia_kg_m2
    assert_array_equal(off, [[60.0, 90.0, 0.0], [90.0, 180.0, 0.0], [0.0, 0.0, -120.0]])


def test_what_no_body_has_does_not_fly(stated):
    """A moment of 3000 kg m^2 less 1.4 of it would be negative; by a half of that there is a body."""
    target = replace(stated.target, inertia_sigma_kg_m2=((4200.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert true_inertia(target, -np.eye(6)[0])[0, 0] == 3000.0 - 2100.0


def test_a_flight_and_a_run_draw_it_once(shipped, stated):
    """Torques move the rates of a target that turns, as Euler's equations say of the inertia that was drawn."""
    approach = Approach(duration_s=40.0, rate_hz=5.0)
    fast = [replace(one, filter=replace(one.filter, initial_rate_sigma_rad_s=0.02)) for one in (shipped, stated)]
    exact, off = (simulate_flight(one, approach, seed=3) for one in fast)
    assert_array_equal(exact.rate_rad_s[0], off.rate_rad_s[0])
    assert_array_equal(exact.motion, off.motion)
    assert np.abs(exact.rate_rad_s - off.rate_rad_s).max() > 1e-7
    (one, drawn), (other, again) = (fly_marker_run(stated, Scenario(approach=approach), 5, run) for run in (1, 2))
    assert set(NAMES) <= set(drawn)
    assert "inertia_yz" not in drawn
    assert not set(NAMES) & set(fly_marker_run(shipped, Scenario(approach=approach), 5, 1)[1])
    assert all(drawn[name] != again[name] for name in NAMES)
    nothing = dict.fromkeys(NAMES, 0.0)
    given, _ = fly_marker_run(stated, Scenario(approach=approach), 5, 1, nothing)
    plain, _ = fly_marker_run(shipped, Scenario(approach=approach), 5, 1)
    assert_array_equal(given.rate_rad_s, plain.rate_rad_s)
    assert np.abs(one.rate_rad_s - plain.rate_rad_s).max() > 0.0
    assert len(other.t_s) == len(one.t_s)


def test_the_numbers_are_normal(stated):
    """Of 200 runs, against chi-square."""
    short = Scenario(approach=Approach(duration_s=2.0, rate_hz=1.0))
    drawn = [fly_marker_run(stated, short, 8, run)[1] for run in range(200)]
    squares = np.mean([[one[name] ** 2 for name in NAMES] for one in drawn])
    low, high = chi_square_interval(4 * 200, 0.999)
    assert low < squares < high


def test_a_campaign_has_a_column_for_it(shipped, stated):
    columns = MARKERS.columns(stated, Scenario())
    assert {f"drawn_{name}" for name in NAMES} <= set(columns)
    assert not {f"drawn_{name}" for name in NAMES} & set(MARKERS.columns(shipped, Scenario()))
