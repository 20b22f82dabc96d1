"""The innovation of an angle is the short way round: +179.9 deg measured, -179.9 deg predicted, is -0.2 deg."""

import numpy as np
import pytest

from relnav.geometry.spherical import position_from_angles
from relnav.navigation.arguments import choose
from relnav.navigation.memory import views
from relnav.navigation.observation.beacon_rows import linearise_position


def innovation(model, measured_rae, position):
    """Residual rows (3,) of `fix` for a measured range, azimuth, elevation at a predicted docking-frame position."""
    memory = views(choose(model, "fix", "perspective", "compiled"))
    group = memory.groups[0]
    group["variance"] = 1.0
    position_from_angles(np.array(measured_rae), memory.fix["position"])
    assert linearise_position(memory, np.concatenate([position, np.zeros(3)]), np.zeros((3, 2)))
    np.testing.assert_array_equal(group["residual"], group["innovation"])
    return group["residual"].copy()


@pytest.mark.parametrize("measured_deg", [-179.95, -10.0, 0.0, 10.0, 179.95])
@pytest.mark.parametrize("predicted_deg", [-179.9, -90.0, 0.0, 90.0, 179.9])
def test_azimuth_innovation_is_wrapped(vbar, measured_deg, predicted_deg):
    predicted = np.radians(predicted_deg)
    position = 5.0 * np.array([np.cos(predicted), np.sin(predicted), 0.0])
    residual = innovation(vbar, [5.0, np.radians(measured_deg), 0.0], position)
    expected = (measured_deg - predicted_deg + 180.0) % 360.0 - 180.0
    assert np.degrees(residual[1]) == pytest.approx(expected, abs=1e-12 * 360)
    assert abs(residual[1]) <= np.pi
    assert residual[0] == pytest.approx(0.0, abs=1e-14)


def test_range_is_not_wrapped(vbar):
    residual = innovation(vbar, [17.0, 0.0, 0.0], np.array([5.0, 0.0, 0.0]))
    np.testing.assert_allclose(residual, [12.0, 0.0, 0.0], atol=1e-14)


def test_at_the_pole_the_azimuth_is_undefined_and_the_image_refused(vbar):
    memory = views(choose(vbar, "fix", "perspective", "compiled"))
    memory.groups[0]["variance"] = 1.0
    assert not linearise_position(memory, np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0]), np.zeros((3, 2)))
