"""Unknown cameras: solved with the focal length estimated, or refused; never a wrong attitude."""

import numpy as np

from relnav.accuracy.dual_field_blind import fly_blind, fly_hidden
from relnav.sensors.dual_field.blind import Blind, solve_blind


def test_cameras_of_many_kinds(sensor):
    """5 to 60 deg wide, distorted, noisy; true, false, mirrored and scrambled frames."""
    result = fly_blind(sensor.catalogue, 6, 3)
    assert result["wrong"] == 0
    assert result["solved"] >= 0.9 * result["true_frames"]


def test_skies_half_hidden_by_a_roof(sensor):
    """Fourteen stars or more in sight; without a light on the roof all are solved."""
    result = fly_hidden(sensor.catalogue, 4, 5, 0)
    assert (result["solved"], result["wrong"]) == (4, 0)


def test_too_few_spots(sensor):
    solution = solve_blind(Blind(np.zeros((5, 2)), None, 1000.0), sensor.catalogue, 2020.0)
    assert solution.status == "too_few"
    assert "6 or more are needed" in solution.reason


def test_spots_all_in_one_place(sensor):
    assert solve_blind(Blind(np.zeros((20, 2)), None, 1000.0), sensor.catalogue, 2020.0).status == "no_match"
    line = np.column_stack([np.linspace(-40, 400, 8), np.zeros(8)])
    assert solve_blind(Blind(line, None, 5000.0), sensor.catalogue, 2020.0).status == "no_match"
