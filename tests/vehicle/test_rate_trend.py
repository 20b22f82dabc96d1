"""A chaser whose turn speeds up within a gyro's period: what the port's rate and velocity are off by is in their sigma.

Truth is a rate that grows evenly, of which a sample is the mean over its period.
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
