"""A smoothed flight: the textbook's formula, the filter's own end, tighter and honest before, and no order but time."""

import dataclasses
import random

import numpy as np
import pytest

from relnav.accuracy.rendezvous import checkpoint, honesty, port_figures
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle import smoothing
from relnav.vehicle.layout import DRIVING, MOVING, layout_of
from relnav.vehicle.motion import Step
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother, step_back

TIMES_S = (2.0, 10.0)
FLIGHT = Rendezvous(start_m=5.5, final_m=4.2, slow_m_s=0.06, as_believed=True)


def smoothed(vehicle, observations, times):
    smoother = VehicleSmoother(vehicle)
    for seen in observations:
        smoother.observe(seen.sensor, seen.t_s, seen.value)
    return smoother.estimates(times)


def in_time(run):
    return sorted(run.observations, key=lambda seen: seen.t_s)


@pytest.fixture(scope="module")
def flights(slow):
    return [simulate_rendezvous(slow, FLIGHT, seed=300 + k) for k in range(6)]


def test_a_step_back_is_the_textbooks(navigator):
    """P + G (P_s+ - P-) G^T with dense matrices, where the code keeps what lasts apart and never subtracts.

    All about the prediction: what is given is referred to the moved estimate, and what is found referred back.
    """
    rng, start = np.random.default_rng(4), navigator._timeline.newest.estimates
    n = start.values.shape[1]
    root = rng.normal(size=(n, n)) * np.sqrt(np.diagonal(start.covariance[0]))[:, None]
    P = root @ root.T / n + start.covariance[0]
    F = np.eye(MOVING, DRIVING) + 0.1 * rng.normal(size=(MOVING, DRIVING))
    Q = np.diag(np.diagonal(P)[:MOVING]) * 0.1
    whole = np.eye(n)
    whole[:MOVING, :DRIVING] = F
    predicted = whole @ P @ whole.T
    predicted[:MOVING, :MOVING] += Q
    known = predicted - 0.3 * predicted[:, :5] @ np.linalg.solve(predicted[:5, :5], predicted[:5])
    G = P @ whole.T @ np.linalg.inv(predicted)
    before = start._replace(covariance=P[None].copy())
    end = start.values[0], (start.dcm_lvlh_from_target[0], start.dcm_inertial_from_chaser[0])
    scale = np.sqrt(np.diagonal(P))
    change = scale * rng.normal(size=n)
    found = step_back(Step(before, F, Q, *end), start._replace(covariance=known[None]).corrected(change[None]))
    expected = P + G @ (known - predicted) @ G.T
    off = (found.referred(end[0], *end[1]).of(0).covariance - expected) / np.outer(scale, scale)
    assert np.abs(off).max() < 1e-9
    additive = np.r_[0:6, 9:12, 15:n]
    off = (found.values[0] - start.values[0] - G @ change) / scale
    assert np.abs(off[additive]).max() < 1e-9 * np.abs(G @ change / scale).max() + 1e-12


def test_the_end_is_the_filters_and_no_order_matters(slow, flights, monkeypatch):
    """Rows in any order, and wherever the kept states stand: the same bits."""
    seen = in_time(flights[0])
    nav = VehicleNavigator(slow)
    for one in seen:
        nav.observe(one.sensor, one.t_s, one.value)
    times = [*TIMES_S, nav.newest_s]
    found, last = smoothed(slow, seen, times), nav.state()
    np.testing.assert_allclose(found[-1].values, last.values, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found[-1].covariance, last.covariance, rtol=1e-6, atol=1e-15)
    assert [one.t_s for one in found] == times
    assert dict(found[-1].sensors) == dict(last.sensors)
    mixed = [*seen, *seen[:40]]
    random.Random(1).shuffle(mixed)
    monkeypatch.setattr(smoothing, "CHUNK", 23)
    for one, other in zip(found, smoothed(slow, mixed, times), strict=True):
        assert one.covariance.tobytes() == other.covariance.tobytes()
        assert one.values.tobytes() == other.values.tobytes()
        assert one.port.position_m.tobytes() == other.port.position_m.tobytes()


def test_it_is_tighter_and_honest(slow, flights):
    """Truth as the filter believes it: errors shrink, and stay what the covariance says; considered ones never move."""
    forward, back = {t: [] for t in TIMES_S}, {t: [] for t in TIMES_S}
    layout = layout_of(slow)
    for run in flights:
        seen, nav, left = in_time(run), VehicleNavigator(slow, monitor=False), list(TIMES_S)
        for one in seen:
            while left and one.t_s >= left[0]:
                forward[left[0]].append(checkpoint(run, nav.state(left.pop(0))))
            nav.observe(one.sensor, one.t_s, one.value)
        for estimate in smoothed(slow, seen, TIMES_S):
            back[estimate.t_s].append(checkpoint(run, estimate))
            assert not estimate.values[layout.considered].any()
    places = layout.by_name
    for t in TIMES_S:
        (error, sigma), (error_back, sigma_back) = port_figures(forward[t]), port_figures(back[t])
        assert (sigma_back < sigma).all()
        assert np.linalg.norm(error_back[3:6]) < 0.7 * np.linalg.norm(error[3:6])
        for names in ("port", "position velocity", "target_attitude target_rate", "camera.points psd.points"):
            ratio, dof = honesty(back[t], places, names)
            low, high = chi_square_interval(dof, 0.9999)
            assert low <= ratio <= high, (t, names, ratio)


def test_a_lost_gyro_is_gone_back_over(slow, flights):
    """Half a second without samples: covariances stay positive, and those in the gap are the widest in rate."""
    seen = [one for one in in_time(flights[1]) if one.sensor != "gyro" or not 5.0 < one.t_s < 9.0]
    found = smoothed(slow, seen, [4.0, 7.0, 12.0])
    assert [one.gyro_lost for one in found] == [False, True, False]
    for one in found:
        assert np.linalg.eigvalsh(one.port.covariance / np.outer(one.port.sigma, one.port.sigma)).min() > 0.0
    rate = [one.port.sigma[9] for one in found]
    assert rate[1] > 1.2 * max(rate[0], rate[2])


def test_a_covariance_that_is_none_cannot_be_smoothed(navigator):
    start = navigator._timeline.newest.estimates
    P = start.covariance.copy()
    P[0, 0, 1] = P[0, 1, 0] = 2.0 * P[0, 0, 0]
    ends = start.values[0], (start.dcm_lvlh_from_target[0], start.dcm_inertial_from_chaser[0])
    step = Step(start._replace(covariance=P), np.eye(MOVING, DRIVING), np.zeros((MOVING, MOVING)), *ends)
    with pytest.raises(ValueError, match="no longer positive definite: it cannot be smoothed"):
        step_back(step, start)


def test_what_is_refused(vehicle):
    smoother = VehicleSmoother(vehicle, t_s=1.0)
    smoother.observe("gyro", 2.0, [0.0, 0.0, 0.0])
    for times in ([0.5], [2.5], [2.0, 1.5], [[1.5]]):
        with pytest.raises(ValueError, match=r"between the start \(1 s\) and the last observation \(2 s\)"):
            smoother.estimates(times)
    with pytest.raises(ValueError, match="no sensor 'lidar'"):
        smoother.observe("lidar", 2.0, 1.0)
    with pytest.raises(ValueError, match="after such a gap start anew"):
        smoother.observe("gyro", 1e6, [0.0, 0.0, 0.0])
    assert smoother.estimates([]) == []
    assert dataclasses.is_dataclass(smoother.estimates([2.0])[0])
