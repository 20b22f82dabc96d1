"""A gyro of a few samples a second on a chaser that wobbles: attitude between samples, and images of stars there.

Truth: an attitude that is a formula of time, by scipy; a sample is its turn over a period, divided by it.
"""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import stated_frames
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother

PERIOD_S, END_S = 0.2, 20.0
WOBBLE = np.radians([1.0, -0.8, 0.6])
FREQUENCY = np.array([1.0, 1.1, 0.9])
"""Rad/s. Held samples would be off by up to T^2 / 8 of the angular acceleration between them: 0.09 mrad."""
STAR_RAD = 1e-5


@pytest.fixture(scope="module")
def wobbling():
    """A chaser of which only the gyro, five times a second, and a star sensor tell."""
    changes = {"gyro.rate_hz": 1.0 / PERIOD_S, "gyro.bias_sigma_rad_s": 1e-5}
    vehicle = relnav.load_model("rendezvous_demo", changes=changes)
    star = dataclasses.replace(vehicle.sensor["star"], noise_rad=(STAR_RAD,) * 3, mount_sigma_rad=1e-9)
    start = dataclasses.replace(vehicle.hand_over, chaser_attitude_sigma_rad=1e-4)
    return dataclasses.replace(vehicle, sensor={"star": star}, models={"star": vehicle.models["star"]}, hand_over=start)


def turn_at(vehicle, t_s):
    """The chaser's true attitude, as it is held at the start but for the wobble."""
    first = vehicle.chaser.dcm_chaser_from_lvlh @ stated_frames(vehicle.orbit, np.zeros(1))[0]
    return Rotation.from_matrix(first.T) * Rotation.from_rotvec(WOBBLE * np.sin(FREQUENCY * t_s))


def samples_of(vehicle, rng, end_s=END_S):
    """The gyro's (t, rate), and its bias."""
    gyro = vehicle.gyro
    bias = gyro.bias_sigma_rad_s * rng.normal(size=3)
    edges = [turn_at(vehicle, PERIOD_S * k) for k in range(round(end_s / PERIOD_S) + 1)]
    means = [(a.inv() * b).as_rotvec() / PERIOD_S for a, b in itertools.pairwise(edges)]
    sigma = gyro.random_walk_rad_sqrt_s / PERIOD_S**0.5
    return [(PERIOD_S * k, mean + bias + sigma * rng.normal(size=3)) for k, mean in enumerate(means)], bias


def off_by(vehicle, estimate, error):
    """Error (3,) of the chaser's attitude; error (3,) of the hand-over."""
    true = turn_at(vehicle, estimate.t_s) * Rotation.from_rotvec(error)
    return (Rotation.from_matrix(estimate.dcm_inertial_from_chaser).inv() * true).as_rotvec()


def quiet(vehicle):
    gyro = dataclasses.replace(vehicle.gyro, bias_sigma_rad_s=1e-12, random_walk_rad_sqrt_s=1e-12)
    return dataclasses.replace(vehicle, gyro=gyro)


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_between_samples_the_attitude_is_that_of_a_rate_that_changes(wobbling, share):
    """Off by no more than what the change of the slope's change does: a tenth of what held samples do."""
    vehicle, worst = quiet(wobbling), 0.0
    nav = VehicleNavigator(vehicle, monitor=False)
    for t_s, rate in samples_of(vehicle, np.random.default_rng(0), 8.0)[0]:
        nav.observe("gyro", t_s, rate)
        if t_s > 3.0 * PERIOD_S:
            worst = max(worst, np.abs(off_by(vehicle, nav.state(t_s + share * PERIOD_S), np.zeros(3))).max())
    assert 1e-7 < worst < 0.1 * (WOBBLE * FREQUENCY**2).max() * PERIOD_S**2 / 8.0


def observed(vehicle, rng):
    """What is seen, (sensor, t s, value): stars between samples; the hand-over's error, and the gyro's bias."""
    samples, bias = samples_of(vehicle, rng)
    error, star = vehicle.hand_over.chaser_attitude_sigma_rad * rng.normal(size=3), vehicle.sensor["star"]
    sensor = Rotation.from_matrix(star.dcm_sensor_from_chaser)
    times = np.arange(0.05, END_S - PERIOD_S, 0.23)
    noise = Rotation.from_rotvec(STAR_RAD * rng.normal(size=(len(times), 3)))
    turns = [(turn_at(vehicle, t) * Rotation.from_rotvec(error)).inv() for t in times]
    stars = [
        ("star", t, (n * sensor * turn).as_quat()) for t, n, turn in zip(times.tolist(), noise, turns, strict=True)
    ]
    return sorted([*[("gyro", *one) for one in samples], *stars], key=lambda one: one[1]), error, bias


def nees(vehicle, estimate, error, bias):
    """Of the chaser's attitude and the gyro's bias, over six."""
    places = estimate.layout.by_name["chaser_attitude"], estimate.layout.by_name["gyro_bias"]
    of = np.r_[places]
    whole = np.concatenate([off_by(vehicle, estimate, error), bias - estimate.values[places[1]]])
    return float(whole @ np.linalg.solve(estimate.covariance[np.ix_(of, of)], whole)) / 6.0


def test_images_between_samples_are_believed_and_the_filter_is_honest(wobbling):
    """In every run no image is refused and nothing is in alarm; NEES/6 filtered, and smoothed within a period."""
    filtered, smoothed = [], []
    for seed in range(12):
        seen, error, bias = observed(wobbling, np.random.default_rng(seed))
        nav, smoother, last = VehicleNavigator(wobbling), VehicleSmoother(wobbling), 0
        for one in seen:
            last = max(last, int(nav.observe(*one)))
            smoother.observe(*one)
        now = nav.state()
        assert last == 0
        assert not now.alarms
        assert not now.first_alarm_s
        filtered.append(nees(wobbling, now, error, bias))
        smoothed.append(nees(wobbling, smoother.estimates([0.5 * END_S + 0.4 * PERIOD_S])[0], error, bias))
    low, high = chi_square_interval(6 * len(filtered), 0.9999)
    assert low < np.mean(filtered) < high
    assert low < np.mean(smoothed) < high


@pytest.mark.parametrize("seed", [1, 2])
def test_any_order_gives_the_same_bits(wobbling, seed):
    """With stars between samples, and two samples missing."""
    seen = [one for one in observed(wobbling, np.random.default_rng(seed))[0] if one[1] < 1.9]
    seen = [one for one in seen if one[0] != "gyro" or not 0.9 < one[1] < 1.3]
    in_order, shuffled = VehicleNavigator(wobbling), VehicleNavigator(wobbling)
    for one in seen:
        in_order.observe(*one)
    for k in np.random.default_rng(seed).permutation(len(seen)):
        shuffled.observe(*seen[k])
    a, b = in_order.state(), shuffled.state()
    assert a.covariance.tobytes() == b.covariance.tobytes()
    assert a.dcm_inertial_from_chaser.tobytes() == b.dcm_inertial_from_chaser.tobytes()
    assert a.port.covariance.tobytes() == b.port.covariance.tobytes()


def turned(vehicle, samples, begin_s, end_s):
    """How far (3,) the filter says that the chaser turns about x, y and z."""
    nav = VehicleNavigator(quiet(vehicle), monitor=False)
    for k, x in samples:
        nav.observe("gyro", PERIOD_S * k, np.array([x, 0.0, 0.0]))
    first, last = (Rotation.from_matrix(nav.state(t).dcm_inertial_from_chaser) for t in (begin_s, end_s))
    return (first.inv() * last).as_rotvec()[0]


SLOPES = {
    "an even change goes on": ([(0, 0.0), (1, 1e-3), (2, 2e-3), (3, 3e-3)], 1e-3),
    "one of any size": ([(0, 0.0), (1, 0.1), (2, 0.2), (3, 0.3)], 0.1),
    "that grows": ([(0, 0.0), (1, 1e-3), (2, 3e-3), (3, 6e-3)], 3.5e-3),
    "that grows a lot": ([(0, 0.0), (1, 0.1), (2, 0.3), (3, 0.6)], 0.3),
    "small, after none": ([(2, 0.0), (3, 1e-3)], 1e-3),
    "large, after none": ([(0, 0.0), (1, 0.0), (2, 0.0), (3, 0.3)], 0.0),
    "over a gap": ([(0, 0.0), (1, 1e-3), (3, 3e-3)], 0.0),
    "after a gap": ([(0, 0.0), (2, 2e-3), (3, 3e-3)], 1e-3),
    "after a wrong sample": ([(0, 0.0), (1, 0.0), (2, 1.0), (3, 0.0)], 0.0),
    "two after a wrong one": ([(0, 0.0), (1, 1.0), (2, 0.0), (3, 0.0)], 0.0),
    "the only one": ([(3, 1e-3)], 0.0),
}


@pytest.mark.parametrize("case", SLOPES)
def test_a_slope_is_that_of_the_samples_before(wobbling, case):
    """In the first half of the last period the turn lacks an eighth of the change; in the whole it lacks nothing."""
    samples, change = SLOPES[case]
    begin, mean = 3 * PERIOD_S, samples[-1][1]
    half = turned(wobbling, samples, begin, begin + 0.5 * PERIOD_S)
    assert half == pytest.approx((0.5 * mean - change / 8.0) * PERIOD_S, rel=1e-9, abs=1e-12)
    for end in (begin + PERIOD_S, begin + 1.5 * PERIOD_S):
        assert turned(wobbling, samples, begin, end) == pytest.approx(mean * (end - begin), rel=1e-9, abs=1e-12)


def test_an_uneven_period_ends_as_its_sample_says(wobbling):
    """Stamps off by a tenth of a period, and an estimate within it: what is turned in the end is the mean's."""
    samples = [(0, 0.0), (1, 1e-3), (2, 2e-3), (3.1, 3e-3)]
    nav = VehicleNavigator(quiet(wobbling), monitor=False)
    star = nav.state(0.0)
    for k, x in samples:
        nav.observe("gyro", PERIOD_S * k, np.array([x, 0.0, 0.0]))
        nav.state(PERIOD_S * (k + 0.5))
    end = nav.state(PERIOD_S * 3.1)
    first, last = (Rotation.from_matrix(one.dcm_inertial_from_chaser) for one in (star, end))
    assert (first.inv() * last).as_rotvec()[0] == pytest.approx((1e-3 + 1.1 * 2e-3) * PERIOD_S, rel=1e-9)
