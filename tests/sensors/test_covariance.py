"""The covariance that `measure` reports against the scatter of fixes from noisy spots.

40 000 draws, fixed seed: a sample sigma is good to 0.35 % (1-sigma), a correlation to 0.005; the bounds are four times
that, plus 0.5 % of nonlinearity at the closest place.
"""

import dataclasses
import math

import numpy as np
import pytest

from relnav.sensors.three_beacon import measure

DRAWS = 40_000


def scatter(truth, sensor, p: np.ndarray, projection: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(covariance reported, covariance of the draws, mean error) of fixes at p."""
    rng = np.random.default_rng(seed)
    clean = truth.central(p, truth.look_at(p, 0.3)) if projection == "perspective" else truth.parallel(p, 0.3)
    noise = rng.normal(size=(DRAWS, 3, 2)) * sensor.spot_noise_m
    fixes = np.array([measure(clean + noise[i], sensor, projection=projection).value for i in range(DRAWS)])
    assert np.isfinite(fixes).all()
    return (
        measure(clean, sensor, projection=projection).covariance,
        np.cov(fixes.T),
        fixes.mean(axis=0) - truth.angles(p),
    )


@pytest.mark.parametrize(
    ("projection", "range_m", "azimuth_deg", "elevation_deg"),
    [
        ("perspective", 6.5, 0.0, 0.0),
        ("perspective", 6.5, 15.0, 10.0),
        ("perspective", 1.5, -12.0, 8.0),
        ("parallel", 6.5, 0.0, 0.0),
        ("parallel", 6.5, -10.0, 15.0),
    ],
)
def test_against_monte_carlo(truth, wide_sensor, projection, range_m, azimuth_deg, elevation_deg) -> None:
    p = truth.position(range_m, math.radians(azimuth_deg), math.radians(elevation_deg))
    reported, drawn, mean_error = scatter(truth, wide_sensor, p, projection, seed=17)
    sigma = np.sqrt(np.diag(reported))
    np.testing.assert_allclose(np.sqrt(np.diag(drawn)), sigma, rtol=0.02)
    correlation = reported / np.outer(sigma, sigma)
    np.testing.assert_allclose(drawn / np.outer(sigma, sigma), correlation, rtol=0.0, atol=0.04)
    assert (np.abs(mean_error) < 0.03 * sigma).all()  # unbiased: 4 sigma of a mean is 0.02


def test_range_and_angles_are_correlated_off_axis(truth, wide_sensor) -> None:
    """R is a full matrix: range with elevation 0.19 at 6.5 m (15, 10) deg, with azimuth 0.84 there at 0.8 m."""

    def correlation(range_m: float, azimuth_deg: float, elevation_deg: float) -> np.ndarray:
        p = truth.position(range_m, math.radians(azimuth_deg), math.radians(elevation_deg))
        c = measure(truth.central(p, truth.look_at(p)), wide_sensor).covariance
        return c / np.sqrt(np.outer(np.diag(c), np.diag(c)))

    assert abs(correlation(6.5, 15.0, 10.0)[0, 2]) == pytest.approx(0.19, abs=0.005)
    assert abs(correlation(0.801, 15.0, 10.0)[0, 1]) == pytest.approx(0.84, abs=0.005)


@pytest.mark.parametrize("projection", ["perspective", "parallel"])
def test_scales_with_the_noise_alone(truth, sensor, projection: str) -> None:
    p = truth.position(6.5, 0.1, -0.1)
    spots = truth.central(p, truth.look_at(p))
    noisier = dataclasses.replace(sensor, spot_noise_m=7.0 * sensor.spot_noise_m)
    one, two = (measure(spots, s, projection=projection) for s in (sensor, noisier))
    np.testing.assert_array_equal(one.value, two.value)
    np.testing.assert_allclose(two.covariance, 49.0 * one.covariance, rtol=1e-13)


def test_a_bigger_instrument_is_the_same_instrument(truth, sensor) -> None:
    """Only f a enters: twice the lens and half the target at the same shape gives the same angles' sigmas at r/2."""
    p = truth.position(6.5, 0.1, -0.1)
    spots = truth.central(p, truth.look_at(p))
    twice = dataclasses.replace(
        sensor, focal_length_m=2 * truth.f, detector_size_m=(16e-3, 16e-3), spot_noise_m=2 * sensor.spot_noise_m
    )
    same = measure(2.0 * spots, twice)
    np.testing.assert_allclose(same.value, measure(spots, sensor).value, rtol=1e-12)
    np.testing.assert_allclose(same.covariance, measure(spots, sensor).covariance, rtol=1e-10)
