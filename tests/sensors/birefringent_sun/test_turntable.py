"""Constants from known directions: what cannot be estimated is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.estimation.consistency import chi_square_interval
from relnav.geometry.rotation_vector import turned
from relnav.sensors.birefringent_sun.spots import project
from relnav.sensors.birefringent_sun.turntable import calibrate_known, direction_error


def test_wrong_use(sensor, cone):
    s = cone(30.0, 12)
    spots = project(sensor, s)
    with pytest.raises(ValueError, match="unknown parameter 'depth'; known are "):
        calibrate_known(sensor, spots, s, free=("depth",))
    with pytest.raises(ValueError, match=r"with a direction \(N, 3\) each are expected; got \(12, 2, 2\) and \(3, 3\)"):
        calibrate_known(sensor, spots, s[:3])
    with pytest.raises(ValueError, match="a direction shows no spots: it lies beside or behind the sensor"):
        calibrate_known(sensor, spots, -s)


def test_one_direction_determines_nothing(sensor, cone):
    s = np.repeat(cone(30.0, 1), 12, axis=0)
    with pytest.raises(ValueError, match=r"these directions do not determine .* together; spread them or free fewer"):
        calibrate_known(sensor, project(sensor, s), s)


def test_errors_are_of_pairs_held_out(sensor, cone):
    """Each of ten pairs left out by hand, everything fitted anew: the errors that are stated, larger than at once."""
    s = np.concatenate([cone(20.0, 5), cone(40.0, 5)])
    spots = project(sensor, s) + sensor.spot_noise_px * np.random.default_rng(6).normal(size=(10, 2, 2))
    made, anew = calibrate_known(sensor, spots, s), []
    for k in range(10):
        found = calibrate_known(sensor, np.delete(spots, k, axis=0), np.delete(s, k, axis=0))
        known = s[k : k + 1] @ turned(np.eye(3), found.alignment_rad).T
        anew.append(direction_error(found.constants.sensor, spots[k : k + 1], known)[0])
    np.testing.assert_allclose(made.error_rad, anew, rtol=0.03, atol=1e-6)
    own = direction_error(made.constants.sensor, spots, s @ turned(np.eye(3), made.alignment_rad).T)
    assert np.sqrt(np.mean(made.error_rad**2)) > 1.2 * np.sqrt(np.mean(own**2))


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_sigmas_are_of_the_noise_that_is_there(sensor, traced, times):
    """Whether the spots have the noise that the model states or three times as much; eight estimates a table."""
    rng, axis, tables = np.random.default_rng(81), np.tan(np.radians(np.linspace(-45.0, 45.0, 7))), 60
    x, y = (side.ravel() for side in np.meshgrid(axis, axis))
    s = np.column_stack([x, y, np.ones(49)]) / np.sqrt(1.0 + x**2 + y**2)[:, None]
    nees, sizes, factors = 0.0, [], []
    for _ in range(tables):
        zero, turn = np.array([511.5, 511.5]) + rng.normal(size=2), np.radians(0.3) * rng.normal(size=3)
        true = replace(
            sensor,
            zero_spot_px=tuple(zero),
            crystal_thickness_m=5e-3 * (1.0 + 0.005 * rng.normal()),
            axis_polar_rad=sensor.axis_polar_rad + 0.005 * rng.normal(),
            axis_azimuth_rad=0.005 * rng.normal(),
        )
        spots = traced(true, Rotation.from_rotvec(turn).apply(s))
        found = calibrate_known(sensor, spots + times * sensor.spot_noise_px * rng.normal(size=spots.shape), s)
        values = [*zero, true.crystal_thickness_m, true.axis_polar_rad, true.axis_azimuth_rad]
        error = found.constants.values - values
        nees += error @ np.linalg.solve(found.constants.covariance, error)
        sizes.append((found.alignment_rad - turn) / found.alignment_sigma_rad)
        factors.append(found.constants.covariance_factor)
    low, high = chi_square_interval(5 * tables, 0.999)
    assert low < nees / (5 * tables) < high
    assert np.sum(np.square(sizes), axis=0) / tables == pytest.approx(1.0, abs=0.6)  # 3.3 sigma of 60 squares
    assert np.median(factors) == pytest.approx(times**2, rel=0.05)
