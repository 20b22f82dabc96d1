"""Poses that look like another in every image: found from predicted spots, and moving as these demand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.dynamics.rigid_body import lvlh_rate
from relnav.geometry.rotation_vector import attitude_error
from relnav.navigation.observation.marker_twins import twins_of
from relnav.navigation.pose_state import PoseState
from relnav.simulation.marker_flight import true_spots

ANY = 1e9


@pytest.fixture(scope="module")
def mission():
    """Any attitude is expected."""
    shipped = relnav.load_model("three_marker_vision")
    return replace(shipped, view=replace(shipped.view, attitude_sigma_rad=3.0))


@pytest.fixture(scope="module")
def lead(mission):
    """A target 7 m ahead, tilted, that turns at a tenth of a degree a second."""
    dcm = mission.dcm_chaser_from_lvlh.T @ mission.camera.dcm_cam_from_chaser.T @ mission.view.dcm_cam_from_target
    dcm = dcm @ Rotation.from_rotvec([0.05, -0.1, 0.08]).as_matrix()
    rate = lvlh_rate(dcm, mission.orbit.mean_motion_rad_s) + np.radians([0.05, -0.08, 0.04])
    root = np.random.default_rng(1).normal(size=(12, 12)) * np.repeat([1e-2, 1e-3, 1e-2, 1e-4], 3)[:, None]
    return PoseState(np.array([7.0, 0.2, -0.1, -0.03, 0.001, 0.002]), dcm, rate, root @ root.T)


def moved(state, mission, dt):
    """A state dt later, in free space."""
    slow = state.rate_rad_s - lvlh_rate(state.dcm_lvlh_from_target, mission.orbit.mean_motion_rad_s)
    motion = np.concatenate([state.motion[:3] + dt * state.motion[3:], state.motion[3:]])
    dcm = state.dcm_lvlh_from_target @ Rotation.from_rotvec(dt * slow).as_matrix()
    return replace(state, motion=motion, dcm_lvlh_from_target=dcm)


def spots(state, mission):
    return true_spots(
        mission, state.motion[None], state.dcm_lvlh_from_target[None], mission.dcm_chaser_from_lvlh[None]
    )[0]


def twins(lead, mission, least=ANY):
    return twins_of(lead, 100.0, mission, mission.dcm_chaser_from_lvlh, least)


def test_their_images_are_those_of_the_leading_one_and_stay_so(mission, lead):
    found = twins(lead, mission)
    assert 1 <= len(found) <= 3
    for twin in found:
        assert np.linalg.norm(attitude_error(twin.dcm_lvlh_from_target, lead.dcm_lvlh_from_target)) > 0.5
        np.testing.assert_allclose(spots(twin, mission), spots(lead, mission), atol=1e-6)
        went = np.abs(spots(moved(lead, mission, 2.0), mission) - spots(lead, mission)).max()
        off = np.abs(spots(moved(twin, mission, 2.0), mission) - spots(moved(lead, mission, 2.0), mission)).max()
        assert off < 0.03 * went  # of the second order in time


def test_a_twin_of_a_twin_is_the_leading_one(mission, lead):
    for twin in twins(lead, mission):
        back = min(
            np.linalg.norm(attitude_error(other.dcm_lvlh_from_target, lead.dcm_lvlh_from_target))
            for other in twins(twin, mission)
        )
        assert back < 1e-6


def test_their_covariance_is_that_of_the_leading_one_in_other_axes(mission, lead):
    for twin in twins(lead, mission):
        np.testing.assert_allclose(twin.covariance[:6, :6], lead.covariance[:6, :6])
        to_lvlh = [
            one.dcm_lvlh_from_target @ one.covariance[6:9, 9:] @ one.dcm_lvlh_from_target.T for one in (twin, lead)
        ]
        np.testing.assert_allclose(*to_lvlh, atol=1e-18)


def test_one_that_turns_or_stands_as_none_expects_is_left_out(mission, lead):
    assert twins(lead, mission)
    strict = replace(mission, view=replace(mission.view, attitude_sigma_rad=np.radians(5.0)))
    assert not twins(lead, strict, 27.6)
    slow = replace(mission, filter=replace(mission.filter, initial_rate_sigma_rad_s=1e-9))
    assert not twins(lead, slow, 27.6)


def test_four_markers_have_none(mission, lead):
    positions = (*mission.markers.positions_m, (0.1, 0.2, -0.3))
    four = replace(mission, markers=replace(mission.markers, positions_m=positions))
    assert not twins(lead, four, 27.6)


def test_a_leading_one_whose_markers_are_behind_the_camera_has_none(mission, lead):
    assert not twins(replace(lead, motion=-lead.motion), mission)
