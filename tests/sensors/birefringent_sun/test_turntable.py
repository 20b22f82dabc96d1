"""Constants from known directions: what cannot be estimated is refused."""

import numpy as np
import pytest

from relnav.sensors.birefringent_sun.spots import project
from relnav.sensors.birefringent_sun.turntable import calibrate_known


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
