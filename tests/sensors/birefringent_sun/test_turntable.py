"""Constants from known directions: what cannot be estimated is refused."""

import numpy as np
import pytest

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
