"""What the filters say they estimate and consider, against what they carry."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.dynamics.error_state import MOTION, POSE, RATE, THETA, VELOCITY
from relnav.navigation import blocks
from relnav.navigation.memory import new_memory, views
from relnav.navigation.observation.beacon_lasting_errors import TOLERANCES
from relnav.navigation.pose_memory import new_pose_memory, pose_views


@pytest.fixture(scope="module")
def beacons():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def markers():
    return relnav.load_model("three_marker_vision")


def with_tolerances(model):
    return dataclasses.replace(model, tolerances=dataclasses.replace(model.tolerances, considered=True))


@pytest.mark.parametrize("method", ["fix", "spots"])
@pytest.mark.parametrize("considered", [False, True])
def test_beacons(beacons, method, considered):
    model = with_tolerances(beacons) if considered else beacons
    layout = blocks.beacon_layout(model, method)
    carried = len(views(new_memory(model, method, "perspective")).sensitivities)
    assert np.count_nonzero(layout.considered) == layout.size - MOTION == carried
    assert layout.by_name["velocity"] == slice(VELOCITY, MOTION)
    if considered:
        first = MOTION + TOLERANCES
        assert layout.by_name["focal_length"] == slice(first, first + 1)
        assert layout.by_name["beacon_placement"].start == first + blocks.TOLERANCES_SHARED


@pytest.mark.parametrize("considered", [False, True])
def test_markers(markers, considered):
    mission = with_tolerances(markers) if considered else markers
    layout = blocks.marker_layout(mission)
    assert layout.size - POSE == len(pose_views(new_pose_memory(mission)).bank_sensitivities[0])
    assert layout.by_name["target_attitude"] == slice(THETA, RATE)
    assert layout.by_name["chaser_attitude"].start == POSE + blocks.CHASER_ATTITUDE
    if considered:
        starts = {"camera_mounting": blocks.MOUNTING, "focal_length": blocks.FOCAL_LENGTH}
        starts["marker_placement"] = blocks.PLACEMENT
        assert {name: layout.by_name[name].start - POSE for name in starts} == starts


def test_a_filter_without_lasting_errors(beacons):
    exact = dataclasses.replace(beacons, attitude=dataclasses.replace(beacons.attitude, sigma_rad=0.0))
    assert relnav.Navigator(exact, "spots").layout.size == MOTION
    assert blocks.considered_errors(exact, "spots") == (blocks.FIELD_ERRORS, blocks.FIELD_ERRORS)


def test_a_reader_sees_the_blocks(beacons, markers):
    navigator = relnav.Navigator(beacons, "spots")
    lines = str(navigator.layout).splitlines()
    assert [line.split()[0] for line in lines] == ["error", "position", "velocity", "chaser_attitude"]
    assert lines[1].endswith("of the first image    estimated")
    assert lines[3].endswith("considered")
    assert f"{beacons.attitude.sigma_rad:.3g}" in lines[3]
    prior = relnav.PoseNavigator(markers).layout.prior
    assert np.isnan(prior[0, 0])
    assert prior[RATE, RATE] == markers.filter.initial_rate_sigma_rad_s**2


def test_sigmas_of_a_covariance_by_name(beacons):
    sigmas = relnav.Navigator(beacons).layout.sigmas(np.diag([4.0, 4.0, 4.0, 1.0, 1.0, 9.0]))
    assert sigmas["position"].tolist() == [2.0, 2.0, 2.0]
    assert sigmas["velocity"].tolist() == [1.0, 1.0, 3.0]
    assert set(sigmas) == {"position", "velocity"}
