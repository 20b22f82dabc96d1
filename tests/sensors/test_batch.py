"""Many images at once are the same images one by one."""

import numpy as np
import pytest

from relnav.sensors.three_beacon import measure
from relnav.sensors.three_beacon.fix import MEASURE_ROWS, PARALLEL, PERSPECTIVE, measure_batch


@pytest.mark.parametrize(("name", "code"), [("perspective", PERSPECTIVE), ("parallel", PARALLEL)])
def test_batch(truth, sensor, name: str, code: int) -> None:
    rng = np.random.default_rng(6)
    p = truth.position(5.0, 0.05, -0.08)
    spots = truth.central(p, truth.look_at(p)) + rng.normal(size=(50, 3, 2)) * 10e-6
    spots[3, 1] = np.nan
    spots[7, 2, 0] = 1.0
    spots[11, 0] = spots[11, 1]
    rae, covariance, status = np.zeros((50, 3)), np.zeros((50, 3, 3)), np.full(50, -1)
    half = 0.5 * sensor.detector_size_m[0]
    values = (truth.f, half, half, sensor.spot_noise_m, truth.a, truth.b, code)
    measure_batch(spots, *values, rae, covariance, status, np.zeros((MEASURE_ROWS, 6)))
    for i in range(50):
        one = measure(spots[i], sensor, projection=name)
        assert one.status == status[i]
        assert one.ok is (i not in (3, 7, 11))
        np.testing.assert_array_equal(rae[i], one.value)
        np.testing.assert_array_equal(covariance[i], one.covariance)
