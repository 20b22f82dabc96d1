"""Sensors drawn within their tolerances."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.simulation.as_built import as_built
from relnav.simulation.detector import project_beacons


@pytest.fixture(scope="module")
def model():
    drawn = relnav.load_model("three_beacon_psd")
    lever = dataclasses.replace(drawn.camera, position_m=(1.0, 0.2, -0.1))
    return dataclasses.replace(drawn, camera=lever)


def test_errors_are_spread_as_the_model_says(model):
    """Four hundred sensors: every 1-sigma within 10 %, 2.8 of its own sigmas."""
    t, rows = model.tolerances, []
    for seed in range(400):
        built = as_built(model, seed)
        turn = Rotation.from_matrix(built.dcm_cam_from_lvlh @ model.dcm_cam_from_lvlh.T).as_rotvec()
        moved = built.sensor.beacons_dock_m - model.sensor.beacons_dock_m
        rows.append([built.sensor.focal_length_m / model.sensor.focal_length_m - 1.0, *turn, *moved.ravel()])
        position = built.dcm_cam_from_lvlh.T @ built.camera_lever_cam_m
        np.testing.assert_allclose(position, model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m, atol=1e-12)
    spread = np.sqrt(np.mean(np.square(rows), axis=0))
    arm2 = np.sum(model.sensor.beacons_dock_m**2, axis=1)[:, None] - model.sensor.beacons_dock_m**2
    places = np.sqrt(t.beacon_placement_sigma_m**2 + t.beacon_mounting_sigma_rad**2 * arm2)
    sigma = [t.focal_length_relative_sigma, *[t.camera_mounting_sigma_rad] * 3, *places.ravel()]
    np.testing.assert_allclose(spread, sigma, rtol=0.1)


def test_the_image_is_that_of_the_built_sensor(model):
    built, state = as_built(model, 3), np.array([[7.0, 0.1, -0.2, 0.0, 0.0, 0.0]])
    sight = built.port_position_m + built.sensor.beacons_dock_m @ model.dcm_dock_from_lvlh - state[:, :3]
    c = sight @ built.dcm_cam_from_lvlh.T - built.camera_lever_cam_m
    expected = built.sensor.focal_length_m * c[:, :2] / c[:, 2:]
    np.testing.assert_allclose(project_beacons(built, state)[0], expected, rtol=1e-12)
    assert np.abs(expected - project_beacons(model, state)[0]).max() > 1e-6


def test_without_tolerances(model):
    with pytest.raises(ValueError, match=r"model three_beacon_psd has no \[tolerances\]"):
        as_built(dataclasses.replace(model, tolerances=None))
