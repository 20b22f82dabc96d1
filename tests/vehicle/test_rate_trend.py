"""A chaser whose turn changes within a gyro's period: what the port's rate and velocity are off by is in their sigma.

Truth is a rate that grows evenly, or one that goes to and fro, of which a sample is the mean over its period.
"""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.vehicle import gyro
from relnav.vehicle.gyro import GyroSamples
from relnav.vehicle.navigator import VehicleNavigator

PERIOD_S = 0.1
GAINED = np.array([1.0, -0.7, 0.4]) * 1e-3
"""Of the chaser's rate, rad/s^2."""


@pytest.fixture(scope="module")
def knowing():
    """A vehicle of which all is known but for the noise of the gyro, ten times a second."""
    vehicle = relnav.load_model(
        "rendezvous_demo", changes={"gyro.rate_hz": 1.0 / PERIOD_S, "gyro.bias_sigma_rad_s": 1e-12}
    )
    known = dataclasses.replace(
        vehicle.hand_over,
        velocity_sigma_m_s=1e-9,
        position_sigma_m=1e-9,
        chaser_attitude_sigma_rad=1e-9,
        target_attitude_sigma_rad=1e-9,
        target_rate_sigma_rad_s=1e-12,
    )
    calm = dataclasses.replace(vehicle.target, rate_noise_density_rad2_s3=1e-22)
    return dataclasses.replace(vehicle, hand_over=known, target=calm)


def flown(vehicle, gained, rng, t_s=1.5):
    """The estimate of a filter that had samples up to t_s, and the chaser's true rate then."""
    nav, first = VehicleNavigator(vehicle, monitor=False), np.array([0.0, -vehicle.orbit.mean_motion_rad_s, 0.0])
    sigma = vehicle.gyro.random_walk_rad_sqrt_s / np.sqrt(PERIOD_S)
    for k in range(round(t_s / PERIOD_S)):
        mean = first + gained * PERIOD_S * (k + 0.5)
        nav.observe("gyro", PERIOD_S * k, mean + sigma * rng.normal(size=3))
    return nav


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_within_a_period_the_rate_is_honest(knowing, share):
    """NEES/n of the port's rate, at the begin of a sample's period, within it and at its end."""
    runs, rng, ratios, first = 40, np.random.default_rng(51), [], np.array([0.0, -knowing.orbit.mean_motion_rad_s, 0.0])
    for _ in range(runs):
        now = flown(knowing, GAINED, rng).state(1.4 + PERIOD_S * share)
        error = now.port.dcm_target_from_chaser @ (now.chaser_rate_rad_s - first - GAINED * now.t_s)
        ratios.append(error @ np.linalg.solve(now.port.covariance[9:, 9:], error) / 3.0)
    lower, upper = chi_square_interval(3 * runs, 0.9999)
    assert lower < np.mean(ratios) < upper


def test_a_steady_turn_is_known_as_before(knowing):
    """What looks like a change is noise: less than a hundredth of the variance."""
    rng, ratios = np.random.default_rng(52), []
    alone = knowing.gyro.random_walk_rad_sqrt_s / np.sqrt(PERIOD_S)
    for _ in range(60):
        ratios.append((flown(knowing, np.zeros(3), rng).state(1.4).port.sigma[9:] / alone) ** 2)
    assert 1.0 < np.mean(ratios) < 1.012


def test_a_trend_is_that_of_the_samples_before():
    samples = GyroSamples(np.zeros(3))
    for k in range(12):
        samples.insert((0.5 * k, 0.1 * k * k, -0.1 * k, 0.0))
    change = np.array([0.1 * (10**2 - 2**2), -0.8, 0.0]) / gyro.TREND
    np.testing.assert_allclose(samples.trend_at(5.0), -0.5 * change)
    np.testing.assert_allclose(samples.trend_at(5.4), 0.3 * change)
    assert not samples.trend_at(3.9).any()  # seven samples before it alone, and the rate before any
    late = GyroSamples(np.zeros(3))
    for k in range(12):
        late.insert((1.0, 0.1 * k, 0.0, 0.0))
    assert not late.trend_at(1.0).any()


def test_what_is_lost_is_no_trend(knowing):
    """A lost gyro's rate is held, and its walk is in the covariance of the bias."""
    rng = np.random.default_rng(53)
    at = [flown(knowing, gained, rng).state(4.0) for gained in (GAINED, np.zeros(3))]
    assert at[0].gyro_lost
    np.testing.assert_allclose(at[0].port.sigma[9:], at[1].port.sigma[9:], rtol=1e-3)


WOBBLE, FREQUENCY = np.radians([1.0, -0.7, 0.5]), np.array([1.0, 1.2, 0.8])
"""Of a chaser's attitude, rad, and how fast, rad/s."""


@pytest.mark.parametrize("samples", [3, 5, 14])
@pytest.mark.parametrize("share", [0.0, 0.6, 0.9999])
def test_a_rate_that_goes_to_and_fro_is_honest_from_the_third_sample_on(knowing, samples, share):
    """NEES/n of the port's rate over all phases: where the rate turns back the last changes say more than is so."""
    runs, rng, ratios = 60, np.random.default_rng(54), []
    first = np.array([0.0, -knowing.orbit.mean_motion_rad_s, 0.0])
    sigma = knowing.gyro.random_walk_rad_sqrt_s / np.sqrt(PERIOD_S)
    for _ in range(runs):
        nav, phase = VehicleNavigator(knowing, monitor=False), rng.uniform(0.0, 2.0 * np.pi, 3)
        for k in range(samples):
            turns = WOBBLE * np.sin(FREQUENCY * PERIOD_S * np.array([[k], [k + 1]]) + phase)
            nav.observe("gyro", PERIOD_S * k, first + (turns[1] - turns[0]) / PERIOD_S + sigma * rng.normal(size=3))
        now = nav.state(PERIOD_S * (samples - 1 + share))
        rate = first + WOBBLE * FREQUENCY * np.cos(FREQUENCY * now.t_s + phase)
        error = now.port.dcm_target_from_chaser @ (now.chaser_rate_rad_s - rate)
        ratios.append(error @ np.linalg.solve(now.port.covariance[9:, 9:], error) / 3.0)
    lower, upper = chi_square_interval(3 * runs, 0.9999)
    assert 0.7 * lower < np.mean(ratios) < upper


def test_changes_are_squared_with_their_noise_taken_off():
    """The mean over eight, or the last where it is more; none over a gap, and none before two samples."""
    samples, sigma = GyroSamples(np.zeros(3)), 1e-4
    samples.insert((0.0, 0.0, 0.0, 0.0))
    assert not samples.unsteady_at(0.4, 0.5, sigma).any()
    for k, x in enumerate([0.1, -0.1, 0.1, -0.1, 0.1, -0.1, 0.1, 0.1], start=1):
        samples.insert((0.5 * k, x, 1e-6 * k, 0.01 * k * k))
    mean, last = np.array([(0.1**2 + 6 * 0.2**2) / 8.0, (2 * 8 - 1.0) ** 2 * 1e-4]) - 2.0 * sigma**2
    for share in (0.0, 0.3, 1.0):
        told = samples.unsteady_at(4.0 + 0.5 * share, 0.5, sigma)
        np.testing.assert_allclose(told, abs(share - 0.5) * np.sqrt([mean, 0.0, last]), rtol=1e-12)
    samples.insert((5.0, 9.0, 9.0, 9.0))
    np.testing.assert_allclose(samples.unsteady_at(5.0, 0.5, sigma)[0], 0.5 * np.sqrt(6 * 0.2**2 / 7.0 - 2 * sigma**2))
    late = GyroSamples(np.zeros(3))
    late.insert((0.0, 0.0, 0.0, 0.0))
    late.insert((1.0, 9.0, 9.0, 9.0))
    assert not late.unsteady_at(1.0, 0.5, sigma).any()


def test_noise_alone_is_no_change():
    """Of 3000 axes of each length at most three are taken for a change: one in ten thousand are."""
    rng, sigma = np.random.default_rng(55), 1e-4
    for count in (2, 3, 9):
        told = 0
        for _ in range(1000):
            samples = GyroSamples(np.zeros(3))
            for k in range(count):
                samples.insert((0.5 * k, *(sigma * rng.normal(size=3))))
            told += np.count_nonzero(samples.unsteady_at(0.5 * count, 0.5, sigma))
        assert told <= 3
