"""Where the closed form stops: the true position is among those that P3P lists, at any angle and range."""

import math

import numpy as np
import pytest

from relnav.sensors.measurement import Status
from relnav.sensors.three_beacon import measure
from relnav.sensors.three_beacon.off_nominal import positions


@pytest.mark.parametrize("off_axis_deg", [0.0, 20.0, 45.0, 70.0, 89.0, 120.0, 170.0])
@pytest.mark.parametrize("range_m", [0.7, 1.0, 3.0, 10.0])
def test_the_truth_is_among_them(truth, wide_sensor, off_axis_deg, range_m):
    for around in np.linspace(-3.0, 3.0, 13):
        side = math.sin(math.radians(off_axis_deg))
        axis = np.array([math.cos(math.radians(off_axis_deg)), side * math.cos(around), side * math.sin(around)])
        p = range_m * axis
        spots = truth.central(p, truth.look_at(p, 0.4))
        if not np.isfinite(spots).all():
            continue
        found = positions(spots, wide_sensor)
        assert 1 <= len(found) <= 4
        assert np.linalg.norm(found - p, axis=1).min() < 1e-9 * range_m
        assert sorted(found[:, 0] <= 0.0) == list(found[:, 0] <= 0.0)


def test_where_the_closed_form_answers_it_is_one_of_them(truth, sensor):
    p = truth.position(6.5, 0.05, -0.08)
    spots = truth.central(p, truth.look_at(p))
    assert measure(spots, sensor).status is Status.OK
    assert np.linalg.norm(positions(spots, sensor)[0] - p) < 1e-9


def test_a_missing_spot_leaves_none(sensor):
    assert positions(np.full((3, 2), np.nan), sensor).shape == (0, 3)


def test_another_shape_is_wrong_use(sensor):
    with pytest.raises(ValueError, match=r"spots_m has shape \(3, 2\)"):
        positions(np.zeros((2, 3)), sensor)
