"""A gyro whose scale and axes are off: what is stated of them, what the filter learns, and honesty with and without.

Truth: a chaser that turns evenly about an axis of its own and about another one, by scipy; samples by a matrix.
"""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import stated_frames
from relnav.vehicle import gyro_errors
from relnav.vehicle.acquisition import locked_out
from relnav.vehicle.layout import CHASER_ATTITUDE, DRIVING, GYRO_BIAS, GYRO_ERRORS, MOVING, layout_of
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother

PERIOD_S, END_S = 0.05, 20.0
FIRST, LATER = np.radians([4.0, -2.0, 2.5]), np.radians([-1.0, 4.5, 2.0])
"""Rates in the first half of a flight and in the second, rad/s: some 5 deg/s."""
OFF = {"scale_sigma": 3e-4, "misalignment_sigma_rad": 5e-4}
STAR_RAD = 1e-5


def with_gyro(vehicle, **keys):
    return dataclasses.replace(vehicle, gyro=dataclasses.replace(vehicle.gyro, **keys))


@pytest.fixture(scope="module")
def turning():
    """A chaser of which only the gyro, twenty times a second, and a star sensor tell."""
    vehicle = relnav.load_model("rendezvous_demo", changes={"gyro.rate_hz": 1.0 / PERIOD_S})
    star = dataclasses.replace(vehicle.sensor["star"], noise_rad=(STAR_RAD,) * 3, mount_sigma_rad=1e-9)
    start = dataclasses.replace(vehicle.hand_over, chaser_attitude_sigma_rad=1e-4)
    return dataclasses.replace(vehicle, sensor={"star": star}, models={"star": vehicle.models["star"]}, hand_over=start)


def turn_at(vehicle, t_s):
    """The chaser's true attitude, but for the hand-over's error."""
    first = vehicle.chaser.dcm_chaser_from_lvlh @ stated_frames(vehicle.orbit, np.zeros(1))[0]
    half = 0.5 * END_S
    turned = Rotation.from_rotvec(FIRST * min(t_s, half)) * Rotation.from_rotvec(LATER * max(t_s - half, 0.0))
    return Rotation.from_matrix(first.T) * turned


def drawn(rng):
    """Errors (9,) of a gyro, and their matrix: scales on the diagonal, the others beside it by row."""
    errors = np.concatenate(
        [OFF["scale_sigma"] * rng.normal(size=3), OFF["misalignment_sigma_rad"] * rng.normal(size=6)]
    )
    return errors, np.array([errors[[0, 3, 4]], errors[[5, 1, 6]], errors[[7, 8, 2]]])


def flown(vehicle, rng, end_s=END_S):
    """What is seen, (sensor, t s, value), of a turning chaser; error of the hand-over, bias and errors of the gyro."""
    gyro, star = vehicle.gyro, vehicle.sensor["star"]
    bias, (errors, off) = gyro.bias_sigma_rad_s * rng.normal(size=3), drawn(rng)
    start = vehicle.hand_over.chaser_attitude_sigma_rad * rng.normal(size=3)
    edges = [turn_at(vehicle, PERIOD_S * k) for k in range(round(end_s / PERIOD_S) + 1)]
    seen, walk = [], gyro.random_walk_rad_sqrt_s / PERIOD_S**0.5
    for k, (a, b) in enumerate(itertools.pairwise(edges)):
        turned = Rotation.from_rotvec(start).inv() * a.inv() * b * Rotation.from_rotvec(start)  # in its own axes
        rate = turned.as_rotvec() / PERIOD_S
        seen.append(("gyro", PERIOD_S * k, rate + off @ rate + bias + walk * rng.normal(size=3)))
    sensor = Rotation.from_matrix(star.dcm_sensor_from_chaser)
    for t in np.arange(0.25, end_s, 0.5).tolist():
        true = turn_at(vehicle, t) * Rotation.from_rotvec(start)
        noise = Rotation.from_rotvec(STAR_RAD * rng.normal(size=3))
        seen.append(("star", t, (noise * sensor * true.inv()).as_quat()))
    return sorted(seen, key=lambda one: one[1]), start, bias, errors


def nees(vehicle, estimate, start, bias, errors):
    """Over their number: of attitude and bias, and of the gyro's errors too where these are states."""
    true = turn_at(vehicle, estimate.t_s) * Rotation.from_rotvec(start)
    angle = (Rotation.from_matrix(estimate.dcm_inertial_from_chaser).inv() * true).as_rotvec()
    places, whole = [CHASER_ATTITUDE, GYRO_BIAS], [angle, bias - estimate.values[GYRO_BIAS]]
    if vehicle.gyro.is_off:
        places, whole = [*places, GYRO_ERRORS], [*whole, errors - estimate.values[GYRO_ERRORS]]
    of, error = np.r_[tuple(places)], np.concatenate(whole)
    return float(error @ np.linalg.solve(estimate.covariance[np.ix_(of, of)], error)) / len(of)


@pytest.mark.parametrize("role", ["estimated", "considered"])
def test_what_is_stated_is_honest(turning, role):
    """In no flight is a star refused or anything in alarm; NEES at the end, and smoothed in the first half."""
    vehicle, filtered, smoothed = with_gyro(turning, **OFF, role=role), [], []
    for seed in range(12):
        seen, *truth = flown(vehicle, np.random.default_rng(seed))
        nav, smoother = VehicleNavigator(vehicle), VehicleSmoother(vehicle)
        refused = 0
        for one in seen:
            refused += int(nav.observe(*one)) != 0
            smoother.observe(*one)
        now = nav.state()
        assert refused == 0
        assert not now.first_alarm_s
        filtered.append(nees(vehicle, now, *truth))
        smoothed.append(nees(vehicle, smoother.estimates([8.1])[0], *truth))
        left = np.sqrt(np.diagonal(now.covariance)[GYRO_ERRORS] / np.diagonal(now.layout.prior)[GYRO_ERRORS])
        assert (left.max() == left.min() == 1.0) if role == "considered" else (left.max() < 0.9 and left.min() < 0.5)
    low, high = chi_square_interval(15 * len(filtered), 0.9999)
    assert low < np.mean(filtered) < high
    assert low < np.mean(smoothed) < high


def test_what_is_not_stated_is_not_honest(turning):
    """The same flights with a filter that takes the gyro for right: alarms, and NEES tens of times too large."""
    alarms, found = 0, []
    for seed in range(6):
        seen, *truth = flown(turning, np.random.default_rng(seed))
        nav = VehicleNavigator(turning)
        for one in seen:
            nav.observe(*one)
        alarms += {"gyro", "star"} <= nav.state().first_alarm_s.keys()
        found.append(nees(turning, nav.state(), *truth))
    assert alarms == 6
    assert np.mean(found) > 20.0


def test_the_port_s_rate_is_honest(turning):
    """Of a chaser whose rate is known but for the gyro's errors, which are far larger than its noise."""
    keys = {"bias_sigma_rad_s": 1e-12, "random_walk_rad_sqrt_s": 1e-9, "bias_walk_rad_s_sqrt_s": 0.0}
    known = dataclasses.replace(turning.hand_over, target_rate_sigma_rad_s=1e-12, target_attitude_sigma_rad=1e-9)
    calm = dataclasses.replace(turning.target, rate_noise_density_rad2_s3=1e-22)
    vehicle = dataclasses.replace(with_gyro(turning, **OFF, **keys), hand_over=known, target=calm)
    rng, found, target = np.random.default_rng(3), [], np.array([0.0, -turning.orbit.mean_motion_rad_s, 0.0])
    for _ in range(40):
        nav, (_, off) = VehicleNavigator(vehicle, monitor=False), drawn(rng)
        for k in range(4):
            nav.observe("gyro", PERIOD_S * k, FIRST + off @ FIRST)
        port = nav.state().port
        error = (target - port.dcm_target_from_chaser @ FIRST) - port.rate_rad_s
        found.append(error @ np.linalg.solve(port.covariance[9:, 9:], error) / 3.0)
    low, high = chi_square_interval(3 * len(found), 0.9999)
    assert low < np.mean(found) < high


def test_a_rate_is_what_was_measured_without_the_errors():
    """But for the third power of errors of a per cent."""
    rng = np.random.default_rng(4)
    errors, rate = 0.01 * rng.normal(size=9), rng.normal(size=3)
    off = np.array([errors[[0, 3, 4]], errors[[5, 1, 6]], errors[[7, 8, 2]]])
    np.testing.assert_allclose(gyro_errors.by_errors(rate) @ errors, off @ rate, rtol=1e-12)
    np.testing.assert_allclose(gyro_errors.true_rate(errors, rate + off @ rate), rate, atol=1e-5)
    assert not np.allclose(gyro_errors.true_rate(errors, rate + off @ rate), rate, atol=1e-8)


def test_the_attitude_is_driven_as_by_a_matrix():
    """What stands left of the diagonal below the first rows is neither read nor needed."""
    rng, n = np.random.default_rng(5), 40
    root, turn = rng.normal(size=(n, n)), gyro_errors.by_errors(rng.normal(size=3))
    P, T = root @ root.T, np.eye(n)
    T[CHASER_ATTITUDE, GYRO_ERRORS] = -turn
    given = P.copy()
    left = np.tril_indices(n, -1)
    given[left] = np.where(left[0] < DRIVING, given[left], np.nan)
    gyro_errors.drive_attitude(given, turn, np.empty((3, n)))
    right = np.triu(given)
    np.testing.assert_allclose(right + np.triu(right, 1).T, T @ P @ T.T, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(given[:DRIVING], (T @ P @ T.T)[:DRIVING], rtol=1e-12, atol=1e-12)
    sums = rng.normal(size=(n, 4))
    driven = sums.copy()
    gyro_errors.drive_sensitivities(driven, turn)
    np.testing.assert_allclose(driven, T @ sums, rtol=1e-12, atol=1e-12)


def test_a_step_turns_by_the_errors_as_its_transition_says(turning):
    """Attitudes after a step of two estimates that differ in the gyro's errors, against F of the smoother's step."""
    vehicle = with_gyro(turning, **OFF)
    nav, steps = VehicleNavigator(vehicle, monitor=False), []
    for k in range(4):
        nav.observe("gyro", PERIOD_S * k, FIRST)
    filters = nav._filters
    begin, change = filters.start.estimates, 1e-4 * np.arange(1.0, 10.0)
    other = begin.copied()
    other.values[0, GYRO_ERRORS] = change
    filters.motion.on_step = steps.append
    ends = [filters.motion.settled(at, filters.samples, 0.1).dcm_inertial_from_chaser[0] for at in (begin, other)]
    turn = Rotation.from_matrix(ends[0].T @ ends[1]).as_rotvec()
    F = steps[0].F
    assert F.shape == (MOVING, GYRO_ERRORS.stop)
    np.testing.assert_allclose(turn, F[CHASER_ATTITUDE, GYRO_ERRORS] @ change, atol=0.01 * np.abs(turn).max())


def test_without_them_there_are_no_such_states(turning):
    """And as many more with one of both as with both."""
    assert layout_of(turning).by_name["star.mount"].start == DRIVING
    for keys in (OFF, {"scale_sigma": 1e-4}, {"misalignment_sigma_rad": 1e-4}):
        layout = layout_of(with_gyro(turning, **keys, role="considered"))
        assert layout.size == layout_of(turning).size + 9
        assert layout.considered[GYRO_ERRORS].all()
        sigmas = layout.sigmas(layout.prior)
        assert sigmas["gyro.scale"].tolist() == [keys.get("scale_sigma", 0.0)] * 3
        assert sigmas["gyro.misalignment"].tolist() == [keys.get("misalignment_sigma_rad", 0.0)] * 6


@pytest.mark.parametrize("seed", [1, 2])
def test_any_order_gives_the_same_bits(turning, seed):
    """With a gyro that is lost for 0.2 s, and all the filters there are."""
    vehicle = with_gyro(turning, **OFF)
    seen = flown(vehicle, np.random.default_rng(seed), 1.9)[0]
    seen = [one for one in seen if one[0] != "gyro" or not 0.9 < one[1] < 1.1]
    in_order, shuffled = (VehicleNavigator(vehicle, separation=True) for _ in range(2))
    alone = VehicleNavigator(vehicle, monitor=False)
    for one in seen:
        in_order.observe(*one)
        alone.observe(*one)
    for k in np.random.default_rng(seed).permutation(len(seen)):
        shuffled.observe(*seen[k])
    a, b, c = (nav.state() for nav in (in_order, shuffled, alone))
    for other in (b, c):
        assert a.covariance.tobytes() == other.covariance.tobytes()
        assert a.values.tobytes() == other.values.tobytes()
        assert a.port.covariance.tobytes() == other.port.covariance.tobytes()
    assert a.without["star"].covariance.tobytes() == b.without["star"].covariance.tobytes()


def test_a_lock_out_keeps_what_lights_do_not_tell(turning):
    vehicle = with_gyro(turning, **OFF)
    nav = VehicleNavigator(vehicle, monitor=False)
    for one in flown(vehicle, np.random.default_rng(6), 6.0)[0]:
        nav.observe(*one)
    before = nav._timeline.newest.estimates
    after = locked_out(before, [nav.layout], vehicle)
    assert after.values[0, GYRO_ERRORS].tolist() == before.values[0, GYRO_ERRORS].tolist()
    assert after.values[0, GYRO_ERRORS].any()
    for place in (GYRO_ERRORS, GYRO_BIAS):
        assert np.diagonal(after.covariance[0])[place].tolist() == np.diagonal(before.covariance[0])[place].tolist()
