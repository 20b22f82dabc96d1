"""Runs of a scenario: the same seed and run, the same log; what is lost changes nothing else; spreads are as stated."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.simulation.dispersed import fly_run
from relnav.simulation.dispersions import AsBuilt, Images, Scenario, Spread, Thrust
from relnav.simulation.trajectory import Approach

SHORT = Approach(duration_s=6.0, rate_hz=2.0, assumed_noise=True)
SPREAD = Scenario(SHORT, Spread((0.5, 0.2, 0.1), (0.01, 0.02, 0.03), 0.1, 0.2), Thrust(0.02, 0.01))


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


def same(one, two):
    return all(
        np.array_equal(getattr(one, name), getattr(two, name), equal_nan=True)
        for name in ("t_s", "spots_m", "acceleration_m_s2", "truth")
    )


def test_a_run_is_given_by_seed_and_number(model):
    log = relnav.simulate(model, SPREAD, seed=4, run=9)
    assert same(log, relnav.simulate(model, SPREAD, seed=4, run=9))
    assert not same(log, relnav.simulate(model, SPREAD, seed=4, run=10))
    assert not same(log, relnav.simulate(model, SPREAD, seed=9, run=4))


def test_without_a_scenario(model):
    assert relnav.simulate(model, Scenario(SHORT)).truth.shape == (12, 6)


def test_a_lost_beacon_leaves_the_rest_as_it_was(model):
    """Paired comparisons: noise, glints and dropouts of the others, and the flight, are the same to the bit."""
    images = Images(dropout=0.2, outliers=0.2)
    whole = relnav.simulate(model, Scenario(SHORT, images=images), seed=1)
    losing = dataclasses.replace(images, lost_beacon="b", lost_from_s=2.0, lost_for_s=2.0)
    lost = relnav.simulate(model, Scenario(SHORT, images=losing), seed=1)
    gone = (lost.t_s >= 2.0) & (lost.t_s < 4.0)
    assert np.isnan(lost.spots_m[gone, 1]).all()
    expected = whole.spots_m.copy()
    expected[gone, 1] = np.nan
    assert np.array_equal(lost.spots_m, expected, equal_nan=True)
    assert np.array_equal(lost.truth, whole.truth)


def test_the_share_of_runs_that_lose_a_beacon(model):
    scenario = Scenario(
        dataclasses.replace(SHORT, duration_s=1.0), images=Images(lost_beacon="a", lost_probability=0.3)
    )
    lost = [np.isnan(relnav.simulate(model, scenario, 2, run).spots_m[:, 0]).all() for run in range(200)]
    assert abs(np.mean(lost) - 0.3) < 4.0 * np.sqrt(0.3 * 0.7 / 200)


def test_starts_are_spread_as_stated(model):
    """300 runs: deviation of each coordinate within 4 / sqrt(600) of it, mean within 4 / sqrt(300) deviations."""
    scenario = dataclasses.replace(SPREAD, approach=dataclasses.replace(SHORT, duration_s=1.0))
    starts = np.array([relnav.simulate(model, scenario, 3, run).truth[0] for run in range(300)])
    sigma = np.array([0.5, 0.2, 0.1, 0.01, 0.02, 0.03])
    middle = np.array([10.0, 0.25, -0.15, 0.0, 0.0, 0.0])
    assert (np.abs(starts.std(axis=0) / sigma - 1.0) < 4.0 / np.sqrt(600)).all()
    assert (np.abs(starts.mean(axis=0) - middle) < 4.0 * sigma / np.sqrt(300)).all()


def test_thrust_errors_act_on_what_is_executed(model):
    """Over the first second the executed acceleration is R (1 + s) of the commanded one, by both truths' velocity."""
    still = Approach(duration_s=2.0, rate_hz=1.0)
    plain = relnav.simulate(model, Scenario(still), 5, 2)
    flight = fly_run(model, Scenario(still, thrust=Thrust(0.1, 0.05)), 5, 2)
    a, drawn = plain.acceleration_m_s2[1], flight.drawn
    turn = 0.05 * np.array([drawn[f"thrust_turn_{axis}"] for axis in "xyz"])
    expected = 0.1 * drawn["thrust_scale"] * a + np.cross(turn, a)
    gained = (flight.log.truth[1] - plain.truth[1])[3:]
    np.testing.assert_allclose(gained, expected, rtol=0.0, atol=5e-3 * np.abs(expected).max())


def test_a_built_sensor_is_seen_in_the_spots(model):
    scenario = Scenario(SHORT, as_built=AsBuilt(focal_length_relative_sigma=0.05))
    flight = fly_run(model, scenario, 6, 1)
    plain = relnav.simulate(model, Scenario(SHORT), 6, 1)
    noise = plain.spots_m - relnav.simulate(model, scenario, 6, 1).spots_m
    assert np.abs(noise).max() > 1e-5
    factor = 1.0 + 0.05 * flight.drawn["focal_length"]
    wide = dataclasses.replace(model.sensor, focal_length_m=model.sensor.focal_length_m * factor)
    same_lens = relnav.simulate(dataclasses.replace(model, sensor=wide), Scenario(SHORT), 6, 1)
    np.testing.assert_allclose(flight.log.spots_m, same_lens.spots_m, rtol=0.0, atol=1e-12)


def test_noise_by_received_power(model):
    log = relnav.simulate(model, Scenario(SHORT, images=Images(by_received_power=True)), 1)
    assert log.sigma_m is not None
    assert np.isfinite(log.sigma_m).all()


def test_other_models_are_refused():
    with pytest.raises(ValueError, match="scenarios are flown by three_beacon and three_marker missions and by vehi"):
        relnav.simulate(relnav.load_model("aps_sun"))


def test_tolerances_must_be_there(model):
    bare = dataclasses.replace(model, tolerances=None)
    with pytest.raises(ValueError, match=r"has no \[tolerances\]"):
        relnav.simulate(bare, Scenario(SHORT, as_built=AsBuilt(by_tolerances=True)))
    with pytest.raises(ValueError, match=r"has no \[tolerances\]"):  # before any run is flown and called failed
        relnav.campaign(bare, 4, 1, dispersions=Scenario(SHORT, as_built=AsBuilt(by_tolerances=True)))
    markers = dataclasses.replace(relnav.load_model("three_marker_vision"), tolerances=None)
    with pytest.raises(ValueError, match=r"three_marker_vision has no \[tolerances\]"):
        relnav.simulate(markers, Scenario(SHORT, as_built=AsBuilt(by_tolerances=True)))
