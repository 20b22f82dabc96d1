"""A turn of the target about the light that is seen is not learnt from images of it."""

import dataclasses

import numpy as np
import pytest

from relnav.accuracy.rendezvous import checkpoint, honesty
from relnav.estimation.consistency import chi_square_interval
from relnav.geometry.linear_algebra import cross_matrix
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import (
    CHASER_ATTITUDE,
    DRIVING,
    POSITION,
    TARGET_ATTITUDE,
    TARGET_RATE,
    VELOCITY,
    layout_of,
)
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.reset import is_pivot_felt, refer_rows_into, reset_scratch
from relnav.vehicle.smoothing import VehicleSmoother

RUNS = 16
FLIGHT = Rendezvous(start_m=12.0, final_m=8.5, fast_m_s=0.1, as_believed=True)
WHOLE_S = 30.0
"""From here on all lights are seen, at 9 m."""


def seen(vehicle, *lights):
    """Spots of a camera of which these lights are seen."""
    spots = np.full((len(vehicle.points_m("camera")), 2), np.nan)
    spots[list(lights)] = 100.0
    return spots.ravel()


@pytest.fixture(params=[(1,), (0, 2)])
def pivoted(vehicle, odd_state, navigator, request):
    """The odd state after an image of one light or two, and their mean stated place, weights and columns."""
    sensor, lights = navigator._filters.sensors["camera"], list(request.param)
    at = odd_state._replace(pivot=sensor.pivot(seen(vehicle, *lights))[None])
    return at, vehicle.points_m("camera")[lights].mean(axis=0), sensor._lights[lights]


def place_of(at, stated, lights):
    """The mean of the lights' places, target axes."""
    return stated + np.mean([at.values[0, first : first + 3] for first in lights], axis=0)


def invariants(at, stated, lights):
    """What is the same about every estimate, by the errors about this one, (n, n): `relnav.vehicle.pivot`, `reset`.

    Of a light's own error, m + b x p, the stated place is left out: that is the same anyway.
    """
    values, errors = at.values[0], np.eye(at.values.shape[1])
    C, A = at.dcm_lvlh_from_target[0], at.frame @ at.dcm_inertial_from_chaser[0]
    phi, b = A @ errors[CHASER_ATTITUDE], errors[TARGET_ATTITUDE] - C.T @ A @ errors[CHASER_ATTITUDE]
    m = np.mean([errors[first : first + 3] for first in lights], axis=0)
    out = errors.copy()
    out[CHASER_ATTITUDE], out[TARGET_ATTITUDE] = phi, b
    for place in (POSITION, VELOCITY):
        out[place] += cross_matrix(values[place]) @ phi
    out[POSITION] -= C @ (m - cross_matrix(place_of(at, stated, lights)) @ b)
    out[TARGET_RATE] -= cross_matrix(values[TARGET_RATE]) @ b
    for first in at.lights:
        out[first : first + 3] -= cross_matrix(values[first : first + 3]) @ b
    return out


def changed(at, new, turn, stated, lights):
    """G (n, n) of errors about `new` by those about `at`, where the path turns by (3, 3)."""
    both = np.eye(at.values.shape[1])
    for place in (POSITION, VELOCITY):
        both[place, place] = turn
    return np.linalg.solve(invariants(new, stated, lights), both @ invariants(at, stated, lights))


def far_step(at, rng):
    """A correction by a tenth of a radian and of a metre, (1, n)."""
    blocks = np.zeros(at.values.shape[1], dtype=bool)
    blocks[:DRIVING] = blocks[at.lights[:, None] + np.arange(3)] = True
    return np.where(blocks, 0.1 * rng.normal(size=at.values.shape), 0.0)


def test_a_turn_about_the_light_leaves_it_where_it_is_seen(vehicle, odd_state, navigator):
    """By a radian, with the path that belongs to it to first order: the residuals of one light stay, exactly."""
    sensor, spots = navigator._filters.sensors["camera"], seen(vehicle, 1)
    at, noise = odd_state._replace(pivot=sensor.pivot(spots)[None]), np.eye(len(spots))
    psi, C, correction = np.array([0.5, -0.6, 0.7]), at.dcm_lvlh_from_target[0], np.zeros(at.values.shape)
    place = place_of(at, vehicle.points_m("camera")[1], sensor._lights[1:2])
    correction[0, TARGET_ATTITUDE], correction[0, POSITION] = psi, np.cross(C @ psi, C @ place)
    before, new = sensor.rows(at, spots, noise).residual[0].copy(), at.corrected(correction)
    assert np.linalg.norm(new.values[0, POSITION] - at.values[0, POSITION]) > 0.05
    np.testing.assert_allclose(sensor.rows(new, spots, noise).residual[0], before, rtol=1e-9)
    plain = odd_state.corrected(correction)
    assert np.nanmax(np.abs(sensor.rows(plain, spots, noise).residual[0] - before)) > 1.0  # px


def test_errors_referred_by_what_is_the_same(pivoted):
    """Of estimates far apart, by numpy's matrices; the correction between them is the one that was made."""
    at, stated, lights = pivoted
    rng, n = np.random.default_rng(5), at.values.shape[1]
    root = rng.normal(size=(n, n + 3))
    at, step = at._replace(covariance=(root @ root.T)[None]), far_step(at, rng)
    new = at.corrected(step)
    own, other = ((e.values[0], e.dcm_lvlh_from_target[0], e.dcm_inertial_from_chaser[0]) for e in (at, new))
    np.testing.assert_allclose(new.correction_from(*own), step[0], atol=1e-6)
    G = changed(at, new, at._led_from(*other)[1]["turn"].T, stated, lights)
    expected = G @ at.covariance[0] @ G.T
    np.testing.assert_allclose(at.referred(*other).of(0).covariance, expected, atol=1e-10 * np.abs(expected).max())
    assert np.abs(G[POSITION, lights[0] : lights[0] + 3]).max() > 0.01  # errors of lights have a part in it


def test_a_correction_refers_as_the_estimates_are(pivoted):
    """Covariance after it, and rows about it told of the errors before, where the path takes half of the turn."""
    at, stated, lights = pivoted
    rng, n = np.random.default_rng(6), at.values.shape[1]
    step, turn = far_step(at, rng), np.array([0.1, -0.07, 0.13])
    step[0, CHASER_ATTITUDE] = (at.frame @ at.dcm_inertial_from_chaser[0]).T @ turn
    step[0, POSITION] = 0.5 * np.cross(turn, at.values[0, POSITION])
    root = rng.normal(size=(n, n + 3))
    at = at._replace(covariance=(root @ root.T)[None])
    new, H = at.corrected(step), rng.normal(size=(1, 5, n))
    own = at.values[0], at.dcm_lvlh_from_target[0], at.dcm_inertial_from_chaser[0]
    G = changed(at, new, new._led_from(*own)[1]["turn"], stated, lights)
    expected = G @ at.covariance[0] @ G.T
    np.testing.assert_allclose(new.of(0).covariance, expected, atol=1e-6 * np.abs(expected).max())
    told, attitudes = H.copy(), [e.dcm_lvlh_from_target for e in (at, new)]
    chasers = [e.dcm_inertial_from_chaser for e in (at, new)]
    ends = attitudes[0], chasers[0], attitudes[1], chasers[1]
    refer_rows_into(told, step, at.values, *ends, at.frame, at.lights, at.pivot, reset_scratch(n))
    np.testing.assert_allclose(told[0], H[0] @ G, atol=1e-6 * np.abs(told).max())


def test_what_is_not_felt_is_left_out(odd_state):
    """By what an error of the attitude, or half of the turn itself, moves the path: a thousandth of its sigma."""
    at, n = odd_state, odd_state.values.shape[1]
    scratch, here = reset_scratch(n)[0], (at.values[0], at.dcm_lvlh_from_target[0], at.dcm_inertial_from_chaser[0])
    scratch["middle"] = [0.0, 0.5, 0.0]
    for sigma, turn in (
        (0.02, 1.01e-3 * 0.1 / (0.5 * 0.02 * np.sqrt(2.0))),
        (1e-6, np.sqrt(2.0 * 1.01e-3 * 0.1 / 0.5)),
    ):
        P, correction = 0.1**2 * np.eye(n), np.zeros(n)
        P[TARGET_ATTITUDE, TARGET_ATTITUDE] = P[CHASER_ATTITUDE, CHASER_ATTITUDE] = sigma**2 * np.eye(3)
        correction[TARGET_ATTITUDE] = [turn, 0.0, 0.0]
        assert is_pivot_felt(P, correction, *here, at.frame, scratch)
        assert not is_pivot_felt(P, 0.3 * correction, *here, at.frame, scratch)
    assert not is_pivot_felt(P, np.zeros(n), *here, at.frame, scratch)


@pytest.fixture(scope="module")
def turned_away(slow):
    """A camera that sees one light for a while, and a star sensor; the target's attitude handed over to 5 deg."""
    begin = dataclasses.replace(
        slow.hand_over, port_distance_m=(12.0, 0.0, 0.0), target_attitude_sigma_rad=np.radians(5.0)
    )
    sensors = {name: slow.sensor[name] for name in ("camera", "star")}
    return dataclasses.replace(slow, hand_over=begin, sensor=sensors)


@pytest.fixture(scope="module")
def flights(turned_away):
    """The runs, and what of each is seen in time."""
    found = []
    for k in range(RUNS):
        run, shown = simulate_rendezvous(turned_away, FLIGHT, seed=800 + k), []
        for one in sorted(run.observations, key=lambda observation: observation.t_s):
            value = one.value
            if one.sensor == "camera" and one.t_s < WHOLE_S:
                value = np.where(np.arange(len(value))[:, None] == 1, value, np.nan)
            shown.append((one.sensor, one.t_s, value))
        found.append((run, shown))
    return found


@pytest.mark.parametrize("smoothed", [False, True])
def test_one_light_in_view_for_a_while(turned_away, flights, smoothed):
    """NEES/n while one is seen, and after all are; no healthy sensor is alarmed, nothing is begun anew."""
    times, places = (15.0, WHOLE_S - 0.1, WHOLE_S + 5.0), layout_of(turned_away).by_name
    points = {t: [] for t in times}
    for run, shown in flights[: RUNS // 2] if smoothed else flights:
        if smoothed:
            smoother = VehicleSmoother(turned_away, monitor=False)
            for one in shown:
                smoother.observe(*one)
            estimates = smoother.estimates(times)
        else:
            nav, estimates = VehicleNavigator(turned_away), []
            for sensor, t_s, value in shown:
                while len(estimates) < len(times) and t_s > times[len(estimates)]:
                    estimates.append(nav.state(times[len(estimates)]))
                nav.observe(sensor, t_s, value)
        for t, estimate in zip(times, estimates, strict=True):
            points[t].append(checkpoint(run, estimate))
        assert not estimates[-1].first_alarm_s
        assert estimates[-1].restarts == 0
    for t, found in points.items():
        for name in ("position", "target_attitude", "port"):
            ratio, dof = honesty(found, places, name)
            lower, upper = chi_square_interval(dof, 0.9999)
            assert lower < ratio < upper, (t, name, ratio)
