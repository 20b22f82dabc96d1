"""Long stretches with less than three beacons, swapped beacons, and beacons behind the camera."""

import numpy as np
import pytest
from scipy.stats import chi2

import relnav
from relnav.navigation.status import PARTIAL, REJECTED, STARTED, UPDATED, WAITING
from relnav.sensors.measurement import Status

LIMIT = chi2.isf(1e-6, 6)


def test_c_alone_grows_slowly_and_stays_consistent(vbar, fly):
    """Three bearings become one: the range is no longer seen, and its sigma says so."""

    def only_c(t, spots):
        spots[t >= 150.0, :2] = np.nan

    flight = fly(vbar, seed=3, edit=only_c, duration_s=260.0, start_m=(8.0, 0.1, -0.1), speed_m_s=0.015)
    solution = flight.solution
    late = flight.t_s >= 150.0
    assert np.all(solution.dof[late][np.isfinite(solution.nis[late])] == 2)
    sigma = solution.sigma[late]
    assert sigma[-1, 0] > 2.0 * sigma[0, 0], "range is unobservable"
    assert sigma[-1, 0] < 0.05, "but the dynamics are known"
    assert np.all(sigma[-1, 1:3] < 1e-3), "the bearing is seen"
    assert flight.nees(150.0).max() < LIMIT
    assert flight.nees(150.0).mean() < 9.0
    assert 0.9 <= flight.nis_per_dof(150.0) <= 1.1
    assert solution.restarts == 0


def test_c_alone_under_a_thruster_that_is_one_percent_off(vbar, fly):
    """The execution-error covariance is on by default: without it this braking makes the filter overconfident."""

    def only_c(t, spots):
        spots[t >= 100.0, :2] = np.nan

    means = []
    for seed in (1, 2, 3):
        flight = fly(vbar, seed=seed, edit=only_c, thrust_scale_error=0.01, duration_s=250.0)
        means.append(flight.nees(150.0).mean())
    assert max(means) < 9.0


@pytest.mark.parametrize("lost", [0, 1])
def test_two_beacons_for_minutes_are_consistent(vbar, fly, lost):
    def lose(t, spots):
        spots[t >= 60.0, lost] = np.nan

    flight = fly(vbar, seed=5, edit=lose)
    assert 2.0 <= flight.nees(60.0).mean() <= 9.0
    assert 0.9 <= flight.nis_per_dof(60.0) <= 1.1
    assert np.all(flight.solution.sigma[-1, :3] < [0.005, 0.001, 0.001])


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_swapped_beacons_never_start_the_filter(vbar, fly, method):
    def swap(_, spots):
        spots[:, [0, 1]] = spots[:, [1, 0]]

    flight = fly(vbar, method=method, seed=5, edit=swap, duration_s=100.0)
    assert np.all(flight.solution.status == WAITING)
    assert np.all(flight.solution.measurement_status == Status.SWAPPED)
    assert np.isnan(flight.solution.nis).all()


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_beacons_swapped_for_a_second_are_refused(vbar, fly, method):
    def swap(t, spots):
        now = (t >= 60.0) & (t < 61.0)
        spots[now] = spots[now][:, [1, 0, 2]]

    flight = fly(vbar, method=method, seed=5, edit=swap, duration_s=100.0)
    now = (flight.t_s >= 60.0) & (flight.t_s < 61.0)
    assert set(flight.solution.status[now]) <= {PARTIAL, REJECTED}
    assert flight.solution.restarts == 0
    assert flight.nees(50.0).max() < LIMIT


def test_beacons_predicted_behind_the_camera_are_refused_and_a_new_start_follows(vbar, drift, look, nees):
    """Half a metre a second toward the port, then the images stop: after ten seconds the prediction is past it."""
    t = 0.1 * np.arange(300)
    toward = drift(vbar, t[:50], [6.5, 0.0, 0.05, -0.1, 0.0, 0.0])
    late = t[50:] + 120.0
    stopped = drift(vbar, late, [8.0, 0.0, 0.05, 0.0, 0.0, 0.0])
    spots = np.concatenate([look(vbar, toward, seed=1), look(vbar, stopped, seed=2)])
    solution = relnav.filter_epochs(vbar, np.concatenate([t[:50], late]), spots, method="spots")
    assert solution.state[50, 0] < -1.0
    assert solution.status[50:54].tolist() == [REJECTED, REJECTED, REJECTED, STARTED]
    assert solution.measurement_status[50] == Status.BEHIND
    assert solution.dof[50] == 0
    assert nees(solution.state[-1:] - stopped[-1:], solution.covariance[-1:])[0] < LIMIT


def test_one_beacon_at_a_time_is_taken_at_its_own_time(vbar, drift, look, nees):
    """Pulsed beacons: A, B, C in slots a third of a period apart, each spot at its own epoch."""
    t = np.arange(1500) / 30.0
    truth = drift(vbar, t, [7.0, 0.1, -0.1, -0.02, 0.0, 0.0])
    spots = look(vbar, truth, seed=7)
    slot = np.arange(len(t)) % 3
    for k in range(30, len(t)):
        spots[k, [i for i in range(3) if i != slot[k]]] = np.nan
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    assert np.mean(solution.status[30:] == UPDATED) > 0.99
    values = nees(solution.state[30:] - truth[30:], solution.covariance[30:])
    assert values.max() < LIMIT
    assert values.mean() < 9.0
