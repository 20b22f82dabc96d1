"""A track begins on any three beacons: near the port A and B have left the detector."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

import relnav
from relnav.accuracy.campaign import noise_alone
from relnav.estimation.consistency import nees
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

LIMIT = chi2.isf(1e-7, 6)


def triad(a):
    return ((0.0, a, 0.0), (0.0, -a, 0.0), (3.0**0.5 * a, 0.0, 0.0))


@pytest.fixture(scope="module")
def layered():
    model = noise_alone(relnav.load_model("three_beacon_psd"), "spots")
    sensor = dataclasses.replace(model.sensor, extra_beacons_m=(*triad(0.06), *triad(0.03)))
    return dataclasses.replace(model, sensor=sensor)


def near(model, seed, faults=None):
    """From 2.5 m to 0.6 m; A and B are never on the detector."""
    approach = Approach(start_m=(2.5, 0.05, -0.03), final_range_m=0.6, duration_s=120.0)
    if faults is None:
        log = simulate(model, approach, Faults(), seed=seed)
        assert not np.isfinite(log.spots_m[:, :2]).all(axis=2).any()
        return log
    return simulate(model, approach, faults, seed=seed)


def run(model, log, **options):
    given = {"acceleration_m_s2": log.acceleration_m_s2, "method": "spots"} | options
    return relnav.filter_epochs(model, log.t_s, log.spots_m, **given)


def test_starts_at_the_second_image(layered):
    """Of 30 approaches all; the first epoch's error is what its covariance says: mean NEES of position 3."""
    values = []
    for seed in range(30):
        log = near(layered, seed)
        solution = run(layered, log)
        first = int(np.flatnonzero(np.isfinite(solution.state[:, 0]))[0])
        assert first <= 2
        assert solution.restarts == 0
        error = (solution.state - log.truth)[first : first + 1, :3]
        values.append(float(nees(error, solution.covariance[first : first + 1, :3, :3])[0]))
        assert np.abs((solution.state - log.truth)[-1, :3]).max() < 1e-3
    assert np.mean(values) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / 30.0))


def test_glints_start_no_false_track(layered):
    """One spot in ten is a glint, two images in three have one: of 30 approaches none starts wrong, all within 5 s."""
    for seed in range(30):
        log = near(layered, 100 + seed, Faults(outliers=0.1))
        solution = run(layered, log)
        running = np.isfinite(solution.state[:, 0])
        assert np.flatnonzero(running)[0] < 50
        assert nees((solution.state - log.truth)[running], solution.covariance[running]).max() < LIMIT


def test_engines_agree(layered):
    log = near(layered, 7, Faults(outliers=0.05))
    ours, theirs = run(layered, log), run(layered, log, engine="filterpy")
    np.testing.assert_array_equal(np.isfinite(ours.state), np.isfinite(theirs.state))
    assert np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma) < 1e-6


def test_two_beacons_are_not_enough(layered):
    log = near(layered, 3)
    spots = log.spots_m.copy()
    spots[:, [2, 4, 5, 6, 7]] = np.nan  # D and I are left
    solution = relnav.filter_epochs(layered, log.t_s, spots, acceleration_m_s2=log.acceleration_m_s2, method="spots")
    assert np.isnan(solution.state).all()


def test_lever_arms_are_included(layered):
    """Neither lens nor port at a centre of mass."""
    model = dataclasses.replace(
        layered,
        docking=dataclasses.replace(layered.docking, port_position_m=(0.4, -0.3, 0.25)),
        camera=dataclasses.replace(layered.camera, position_m=(0.05, -0.03, 0.04)),
    )
    log = near(model, 11)
    solution = run(model, log)
    assert np.isfinite(solution.state[2]).all()
    assert np.abs((solution.state - log.truth)[-1, :3]).max() < 1e-3


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_an_image_that_cannot_begin_a_track_leaves_the_trial_alone(layered, engine):
    """A glint in the second image: the trial of the first is taught by the others, and the third confirms it."""
    log = near(layered, 0)
    log.spots_m[1, 4] += 3e-4
    solution = run(layered, log, engine=engine)
    assert solution.status[2] == relnav.EpochStatus.STARTED
