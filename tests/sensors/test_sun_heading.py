"""A rover's yaw from the sun and the vertical, and its gyro's drift: against truth by rotations, with honest sigmas."""

import numpy as np
import pytest

from relnav.sensors.sun_direction import direction_with_covariance
from relnav.sensors.sun_heading import gyro_drift, yaw_from_sun

DEG = np.pi / 180.0


def rover(yaw, pitch, roll):
    """Rows forward, left, up of a rover in north, west, up axes; yaw clockwise from north seen from above."""
    c, s = np.cos(yaw), np.sin(yaw)
    level = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    tilt = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    lean = np.array([[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]])
    return lean @ tilt @ level


def sun_at(azimuth, elevation):
    """North, west, up."""
    return np.array([np.cos(azimuth) * np.cos(elevation), -np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5, 3.0])
def test_yaw_of_a_tilted_rover(yaw):
    """Forward, projected on the ground, points `yaw` clockwise from north, whatever pitch and roll."""
    B = rover(yaw, 0.2, -0.15)
    forward = B[0]
    true = np.arctan2(-forward[1], forward[0])
    s = direction_with_covariance(B @ sun_at(2.0, 0.6), 1e-8 * np.eye(3))
    found, _ = yaw_from_sun(s, B @ [0.0, 0.0, 1.0], 2.0)
    assert np.remainder(found - true + np.pi, 2.0 * np.pi) - np.pi == pytest.approx(0.0, abs=1e-9)


def test_sigma_is_the_scatter():
    rng, sigma_s, sigma_u, elevation = np.random.default_rng(1), 0.02 * DEG, 0.05 * DEG, 50.0 * DEG
    B, errors = rover(0.7, 0.1, 0.05), []
    up, sun = B @ [0.0, 0.0, 1.0], B @ sun_at(1.2, elevation)
    for _ in range(2000):
        s = sun + sigma_s * rng.normal(size=3)
        u = up + sigma_u * rng.normal(size=3)
        s, u = s / np.linalg.norm(s), u / np.linalg.norm(u)
        seen = direction_with_covariance(s, sigma_s**2 * (np.eye(3) - np.outer(s, s)))
        yaw, sigma = yaw_from_sun(seen, u, 1.2, up_sigma_rad=sigma_u)
        errors.append((yaw - np.arctan2(-B[0, 1], B[0, 0])) / sigma)
    expected = np.sqrt(sigma_s**2 / np.cos(elevation) ** 2 + np.tan(elevation) ** 2 * sigma_u**2)
    assert sigma == pytest.approx(expected, rel=0.01)
    assert np.std(errors) == pytest.approx(1.0, abs=0.07)


def test_drift_of_a_gyro_over_an_hour():
    """A drift of 0.1 deg/h from yaws of 0.03 deg a minute, one of them wrong by 20 deg: sigma 0.014 deg/h."""
    rng, t, z = np.random.default_rng(2), np.arange(0.0, 3600.0, 60.0), []
    for _ in range(200):
        true = 3.0 + 0.4 * np.sin(t / 500.0)  # passes through pi
        gyro = true + 0.2 - 0.1 * DEG / 3600.0 * t
        sun = np.remainder(true + 0.03 * DEG * rng.normal(size=len(t)) + np.pi, 2.0 * np.pi) - np.pi
        sun[17] += 20.0 * DEG
        fit = gyro_drift(t, gyro, sun, 0.03 * DEG)
        assert not fit.used[17]
        assert fit.used.sum() >= len(t) - 2
        error = np.array([fit.offset_rad + 0.2, fit.drift_rad_s - 0.1 * DEG / 3600.0])
        z.append(error @ np.linalg.solve(fit.covariance, error))
    assert np.sqrt(fit.covariance[1, 1]) * 3600.0 / DEG == pytest.approx(0.0137, rel=0.1)
    assert np.mean(z) == pytest.approx(2.0, abs=0.5)


def test_wrong_use():
    s = direction_with_covariance(np.array([0.0, 0.0, 1.0]), 1e-8 * np.eye(3))
    with pytest.raises(ValueError, match="along the vertical"):
        yaw_from_sun(s, [0.0, 0.0, 1.0], 0.0)
    with pytest.raises(ValueError, match="up_body is a unit vector"):
        yaw_from_sun(s, [0.0, 0.0, 2.0], 0.0)
    with pytest.raises(ValueError, match="three yaws or more"):
        gyro_drift([0.0, 1.0], [0.0, 0.0], [0.0, 0.0], 1.0)
    with pytest.raises(ValueError, match="sigmas are above zero"):
        gyro_drift([0.0, 1.0, 2.0], [0.0] * 3, [0.0] * 3, 0.0)
