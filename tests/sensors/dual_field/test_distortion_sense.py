"""Coefficients of the other sense, from ray to spot as OpenCV's: the frame is not solved, and the reason names them."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.files.star_catalogue import load_star_catalogue
from relnav.sensors.dual_field.blind import Blind, solve_blind
from relnav.sensors.dual_field.measure import measure
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

SAID = "distortion (here from spot to ray, the inverse of OpenCV's)"


@pytest.fixture(scope="module")
def frame():
    return StarFieldSimulator(relnav.load_model("ground_camera"), SkyConditions(false_spots=0)).frame(
        np.random.default_rng(4)
    )


def with_distortion(k1):
    model = relnav.load_model("ground_camera")
    return dataclasses.replace(model, camera=dataclasses.replace(model.camera, distortion=(k1, 0.0)))


@pytest.mark.parametrize("k1", [0.05, 0.3, 1.0])
def test_the_reason_names_the_sense(frame, k1):
    """The shipped lens has -0.12197; whether stars are found beside the spots or none, it is said."""
    solution = measure(frame.spots_px, with_distortion(k1), magnitude=frame.magnitude)
    assert solution.status == "no_match"
    assert SAID in solution.reason


def test_with_its_focal_length_alone(frame):
    blind = Blind(frame.spots_px, frame.magnitude, 5114.4, distortion=(20.0, 0.0), lens_known=True)
    solution = solve_blind(blind, load_star_catalogue(), 2019.6)
    assert solution.status == "no_match"
    assert SAID in solution.reason


def test_without_distortion_there_is_nothing_to_say(frame):
    rng = np.random.default_rng(5)
    chance = rng.uniform(-350.0, 350.0, frame.spots_px.shape)
    solution = measure(chance, with_distortion(0.0), magnitude=frame.magnitude)
    assert solution.status == "no_match"
    assert "distortion" not in solution.reason
