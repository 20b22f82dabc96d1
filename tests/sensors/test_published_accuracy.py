"""The published accuracy (0.02 m, 0.176 deg, 0.182 deg) from spot noise and geometry alone.

The paper is Cai, Zhao, Sun, Qiao, Dai (1996),
"Determination of target relative position and range by PSD optical sensor system".
"""

import math

import numpy as np
import pytest

from relnav.sensors.three_beacon import measure


def sigmas(fix) -> np.ndarray:
    """1-sigma of (range m, azimuth deg, elevation deg)."""
    return np.sqrt(np.diag(fix.covariance)) * [1.0, math.degrees(1.0), math.degrees(1.0)]


@pytest.mark.parametrize(
    ("range_m", "expected", "half_digit"),
    [
        (3.75, (0.0066, 0.084, 0.087), (5e-5, 5e-4, 5e-4)),
        (6.5, (0.0199, 0.158, 0.162), (5e-5, 5e-4, 5e-4)),
        (10.0, (0.047, 0.252, 0.256), (5e-4, 5e-4, 5e-4)),
    ],
)
def test_perspective_on_the_axis(truth, wide_sensor, range_m: float, expected, half_digit) -> None:
    p = np.array([range_m, 0.0, 0.0])
    got = sigmas(measure(truth.central(p, truth.look_at(p)), wide_sensor))
    assert (np.abs(got - expected) <= np.array(half_digit) * 1.01).all(), got


@pytest.mark.parametrize("range_m", [3.75, 6.5, 10.0])
def test_perspective_formulas(truth, wide_sensor, range_m: float) -> None:
    """sigma_az = 1.2247 (s/f)(r-b)/(b + a^2/r), sigma_el = 1.2247 (s/f)(r-b)/b, sigma_r = 0.707 s r^2/(f a)."""
    s, f, a, b, r = wide_sensor.spot_noise_m, truth.f, truth.a, truth.b, range_m
    p = np.array([r, 0.0, 0.0])
    got = np.sqrt(np.diag(measure(truth.central(p, truth.look_at(p)), wide_sensor).covariance))
    side = math.sqrt(1.5) * s / f * (r - b)
    assert got[0] == pytest.approx(math.sqrt(0.5) * s * r * r / (f * a), rel=1e-9)
    # C is nearer by b/r and looks larger; A and B also turn with azimuth, by a/r each.
    assert got[1] == pytest.approx(side / (b + a * a / r), rel=0.005)
    assert got[2] == pytest.approx(side / b, rel=0.005)


@pytest.mark.parametrize(
    ("range_m", "expected"),
    [(3.75, (0.0067, 0.100, 0.100)), (6.5, (0.020, 0.176, 0.176)), (10.0, (0.048, 0.27, 0.27))],
)
def test_parallel_on_the_axis(truth, wide_sensor, range_m: float, expected) -> None:
    """The published figures meet at 6.5 m."""
    got = sigmas(measure(truth.parallel(np.array([range_m, 0.0, 0.0])), wide_sensor, projection="parallel"))
    np.testing.assert_allclose(got, expected, rtol=0.02)


def test_range_and_angle_accuracy_are_one_number(truth, wide_sensor) -> None:
    """sigma_r / r = sigma_az = sigma_el = 0.707 s r / (f a) for parallel projection of the equilateral triangle."""
    for range_m in (3.75, 6.5, 10.0):
        fix = measure(truth.parallel(np.array([range_m, 0.0, 0.0])), wide_sensor, projection="parallel")
        expected = math.sqrt(0.5) * wide_sensor.spot_noise_m * range_m / (truth.f * truth.a)
        got = np.sqrt(np.diag(fix.covariance)) / [range_m, 1.0, 1.0]
        np.testing.assert_allclose(got, expected, rtol=1e-9)


def test_monte_carlo_of_the_published_figures(truth, wide_sensor) -> None:
    """20 000 images of the paper's own projection at 6.5 m: 0.020 m, 0.176 deg, 0.176 deg within 5 %."""
    p = np.array([6.5, 0.0, 0.0])
    noise = np.random.default_rng(1996).normal(size=(20_000, 3, 2)) * wide_sensor.spot_noise_m
    clean = truth.parallel(p)
    fixes = np.array([measure(clean + n, wide_sensor, projection="parallel").value for n in noise])
    got = fixes.std(axis=0) * [1.0, math.degrees(1.0), math.degrees(1.0)]
    np.testing.assert_allclose(got, [0.020, 0.176, 0.176], rtol=0.05)


@pytest.mark.parametrize(("range_m", "seen"), [(3.74, False), (3.76, True)])
def test_a_and_b_leave_the_detector_at_3_75_m(truth, sensor, range_m: float, seen: bool) -> None:
    p = np.array([range_m, 0.0, 0.0])
    assert measure(truth.central(p, truth.look_at(p)), sensor).ok is seen
