"""Constants from known directions: what cannot be estimated is refused."""

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
