"""A vehicle that takes over what another navigation system knows: a joint covariance, attitudes, the target's rate."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from relnav.accuracy.rendezvous import checkpoint, honesty
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import layout_of
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother

RUNS = 24
FLIGHT = Rendezvous(start_m=20.0, final_m=19.3, as_believed=True)
TIMES_S = 0.05, 0.6, 3.0
"""At the start, after the first image, and after some ten."""
COASTED_S = 60.0
MOTION = "position velocity"
ALL = "position velocity target_attitude target_rate chaser_attitude"


def coasted(vehicle):
    """Covariance (6, 6) of relative GPS, 20 to 50 mm and 5 to 15 mm/s, after a minute without it: Clohessy-Wiltshire.

    By the exponential of the equations of motion, of which the filter has its own solution.
    """
    n, A = vehicle.orbit.mean_motion_rad_s, np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 5], A[5, 3], A[4, 1], A[5, 2] = 2.0 * n, -2.0 * n, -(n**2), 3.0 * n**2
    F = expm(COASTED_S * A)
    return F @ np.diag([0.05, 0.02, 0.03, 0.015, 0.005, 0.01]) ** 2 @ F.T


def joint(seed, degrees=1.0):
    """Covariance (15, 15) in which all hangs together with all, correlated by up to 0.8."""
    rng = np.random.default_rng(seed)
    P = np.cov(rng.normal(size=(15, 25)))
    sigma = [0.3] * 3 + [0.01] * 3 + [np.radians(degrees)] * 3 + [np.radians(0.02)] * 3 + [np.radians(0.2)] * 3
    scale = np.array(sigma) / np.sqrt(np.diagonal(P))
    return scale[:, None] * P * scale


def told(run, covariance, seed):
    """What another system says of the start: truth is off it by an error drawn from its covariance."""
    error, now = np.zeros(15), np.zeros(1)
    error[: len(covariance)] = np.random.default_rng(seed).multivariate_normal(np.zeros(len(covariance)), covariance)
    back = [Rotation.from_rotvec(-error[k : k + 3]).as_matrix() for k in (6, 12)]
    motion, known = run.truth.motion(now)[0] - error[:6], {}
    if len(covariance) > 6:
        known["dcm_lvlh_from_target"] = run.truth.dcm_frame_from_target(now)[0] @ back[0]
        known["target_rate_rad_s"] = run.truth.target_rate(now)[0] - error[9:12]
    if len(covariance) > 12:
        known["dcm_inertial_from_chaser"] = run.truth.dcm_chaser_from_inertial(now)[0].T @ back[1]
    return {"position_m": motion[:3], "velocity_m_s": motion[3:], "covariance": covariance, **known}


def filtered(vehicle, run, start, times_s=TIMES_S, **options):
    nav, found = VehicleNavigator(vehicle, **start, **options), []
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        while len(found) < len(times_s) and seen.t_s > times_s[len(found)]:
            found.append(nav.state(times_s[len(found)]))
        nav.observe(seen.sensor, seen.t_s, seen.value)
    return found


def smoothed(vehicle, run, start, times_s=TIMES_S):
    smoother = VehicleSmoother(vehicle, **start)
    for seen in run.observations:
        smoother.observe(seen.sensor, seen.t_s, seen.value)
    return smoother.estimates(times_s)


def points_of(vehicle, runs, starts, way=filtered, **options):
    """Errors at each time, a list of runs each."""
    found = [way(vehicle, run, start, **options) for run, start in zip(runs, starts, strict=True)]
    return [[checkpoint(run, es[k]) for run, es in zip(runs, found, strict=True)] for k in range(len(found[0]))]


def rms(points, name, layout):
    return np.sqrt(np.mean([p.error[layout.by_name[name]] ** 2 for p in points]))


@pytest.fixture(scope="module")
def far(slow):
    """Told of by its file to half a metre and 10 mm/s, from 20 m."""
    begin = dataclasses.replace(
        slow.hand_over, port_distance_m=(20.0, 0.0, 0.0), position_sigma_m=0.5, velocity_sigma_m_s=0.01
    )
    return dataclasses.replace(slow, hand_over=begin)


@pytest.fixture(scope="module")
def steady(far):
    return [simulate_rendezvous(far, FLIGHT, seed=2000 + k) for k in range(RUNS)]


@pytest.fixture(scope="module")
def tumbling(far):
    """A target turned by tens of degrees that tumbles at 0.5 to 2.6 deg/s, and a chaser turned likewise: no file's."""
    wild = dataclasses.replace(
        far.hand_over,
        target_attitude_sigma_rad=0.5,
        target_rate_sigma_rad_s=np.radians(1.0),
        chaser_attitude_sigma_rad=0.5,
    )
    flown = dataclasses.replace(far, hand_over=wild)
    return [simulate_rendezvous(flown, FLIGHT, seed=2100 + k) for k in range(RUNS)]


def check_honest(points, layout, names, probability=0.9999):
    for at in points:
        for name in names:
            ratio, dof = honesty(at, layout.by_name, name)
            lower, upper = chi_square_interval(dof, probability)
            assert lower < ratio < upper, name


@pytest.mark.parametrize("way", [filtered, smoothed])
def test_position_and_velocity_that_hang_together(far, steady, way):
    """The first image tells the velocity too, ten times as well as with the same sigmas and nothing of how they hang.

    Honest at the start, after the first image and later, velocity and position each and together.
    """
    covariance, layout = coasted(far), layout_of(far)
    starts = [told(run, covariance, seed) for seed, run in enumerate(steady)]
    apart = [start | {"covariance": np.diag(np.diag(covariance))} for start in starts]
    points, others = (points_of(far, steady, each, way) for each in (starts, apart))
    check_honest(points, layout, ["position", "velocity", MOTION, "port"])
    k = TIMES_S.index(0.6)
    gain = rms(others[k], "velocity", layout) / rms(points[k], "velocity", layout)
    assert gain > (8.0 if way is filtered else 5.0)


@pytest.mark.parametrize("way", [filtered, smoothed])
def test_a_tumbling_target_and_a_turned_chaser(far, tumbling, way):
    """All fifteen drawn together, and the file tells of a held target and a held chaser: it is not asked."""
    layout, covariance = layout_of(far), joint(5)
    starts = [told(run, covariance, seed) for seed, run in enumerate(tumbling)]
    points = points_of(far, tumbling, starts, way)
    check_honest(points, layout, [*ALL.split(), ALL, "port"])
    rates = [np.linalg.norm(run.truth.target_rate(np.zeros(1))) for run in tumbling]
    assert min(rates) < np.radians(0.5)
    assert max(rates) > np.radians(2.0)


def test_the_same_with_a_held_rate_is_wrong(far, tumbling):
    """The rate alone left out: after three seconds the target's attitude and rate are off by tens of sigmas."""
    starts = [told(run, joint(5), seed) for seed, run in enumerate(tumbling)]
    held = [{k: value for k, value in start.items() if k != "target_rate_rad_s"} for start in starts]
    ratio, _ = honesty(points_of(far, tumbling, held)[0], layout_of(far).by_name, "target_rate")
    assert ratio > 100.0


@pytest.mark.parametrize("believed", [False, True])
def test_a_target_whose_file_says_that_it_tumbles(far, believed):
    """At 1.1 deg/s: filtered by that file NEES/n is honest, whatever else truth is; and the target is left alone."""
    rate = tuple(np.radians([0.5, -0.8, 0.6]).tolist())
    vehicle = dataclasses.replace(far, hand_over=dataclasses.replace(far.hand_over, target_rate_rad_s=rate))
    flight, layout = dataclasses.replace(FLIGHT, as_believed=believed), layout_of(vehicle)
    runs = [simulate_rendezvous(vehicle, flight, seed=2200 + k) for k in range(RUNS)]
    check_honest(points_of(vehicle, runs, [{}] * RUNS), layout, ["target_attitude target_rate", "port"])
    fast = [np.linalg.norm(run.truth.target_rate(np.array([0.0, 6.9])), axis=1) for run in runs]
    assert max(abs(end / begin - 1.0) for begin, end in fast) < 0.05  # a target that controls itself loses a tenth
    ratio, _ = honesty(points_of(far, runs, [{}] * RUNS)[0], layout.by_name, "target_rate")
    assert ratio > 100.0
    now = [VehicleNavigator(each).state() for each in (vehicle, far)]
    argued = VehicleNavigator(far, target_rate_rad_s=rate).state()
    assert now[0].values.tobytes() == argued.values.tobytes() != now[1].values.tobytes()
