"""What lasts in a marker mission: considered errors against differences of the whole filter, and NEES with them."""

import dataclasses
import math

import numpy as np
import pytest

import relnav
from relnav.accuracy.pose_filter import PoseErrors, joined, smoothed_errors, tight_errors
from relnav.estimation.consistency import nees
from relnav.geometry.rotation import quaternion_from_dcm
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import MarkerTolerances
from relnav.navigation.blocks import CHASER_ATTITUDE, FOCAL_LENGTH, MOUNTING, PLACEMENT
from relnav.navigation.observation.marker_poses import WIDENED
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.pose_memory import pose_views
from relnav.navigation.relative_pose import PoseNavigator
from relnav.simulation.as_built import markers_as_built
from relnav.simulation.marker_flight import MarkerFlight, simulate_flight, true_spots
from relnav.simulation.trajectory import Approach

APPROACH = Approach(40.0, 4.0, start_m=(6.8, 0.25, -0.15), final_range_m=3.0, speed_m_s=0.1, assumed_noise=True)


def with_lasting(attitude_deg, *, tolerances):
    """The shipped model with a chaser attitude sigma, its tolerances considered or not."""
    model = relnav.load_model("three_marker_vision")
    chaser = dataclasses.replace(model.chaser, attitude_sigma_rad=math.radians(attitude_deg))
    return dataclasses.replace(
        model, chaser=chaser, tolerances=dataclasses.replace(model.tolerances, considered=tolerances)
    )


@pytest.fixture(scope="module")
def mission():
    model = with_lasting(0.05, tolerances=True)
    camera = dataclasses.replace(model.camera, position_m=(0.1, -0.2, 0.4))
    return dataclasses.replace(model, camera=camera)


@pytest.fixture(scope="module")
def flight(mission):
    return simulate_flight(mission, APPROACH, seed=3)


def at_the_end(mission, flight, built, alpha=(0.0, 0.0, 0.0)):
    """The navigator of `mission` after spots without noise of what was built, the chaser turned by alpha."""
    true = np.array([turned(dcm.T, np.array(alpha)).T for dcm in flight.dcm_chaser_from_lvlh])
    spots = true_spots(built, flight.motion, flight.dcm_lvlh_from_target, true)
    nav = PoseNavigator(mission)
    for k, t in enumerate(flight.t_s):
        record = nav.step(
            t,
            spots[k],
            acceleration_m_s2=flight.acceleration_m_s2[k],
            dcm_chaser_from_lvlh=flight.dcm_chaser_from_lvlh[k],
        )
    return nav, record


def difference(record, nominal):
    turn = rotation_vector_between(record.dcm_lvlh_from_target, nominal.dcm_lvlh_from_target)
    return np.concatenate([record.state - nominal.state, turn, record.rate_rad_s - nominal.rate_rad_s])


def built_with(mission, which, size):
    """What was built, with one considered error of so many sigmas; and the turn of the chaser."""
    t, camera, alpha = mission.tolerances, mission.camera, np.zeros(3)
    if which < MOUNTING:
        alpha[which - CHASER_ATTITUDE] = size * mission.chaser.attitude_sigma_rad
    elif which < FOCAL_LENGTH:
        theta = np.zeros(3)
        theta[which - MOUNTING] = size * t.camera_mounting_sigma_rad
        dcm = turned(camera.dcm_cam_from_chaser.T, theta).T
        quaternion = quaternion_from_dcm(dcm)
        camera = dataclasses.replace(camera, q_cam_from_chaser=tuple(quaternion))
    elif which < PLACEMENT:
        scale = 1.0 + size * t.focal_length_relative_sigma
        camera = dataclasses.replace(camera, focal_length_px=tuple(scale * f for f in camera.focal_length_px))
    points = mission.markers.points_m.copy()
    if which >= PLACEMENT:
        points.ravel()[which - PLACEMENT] += size * t.marker_placement_sigma_m
    markers = dataclasses.replace(mission.markers, positions_m=tuple(map(tuple, points)))
    return dataclasses.replace(mission, camera=camera, markers=markers), alpha


def test_sensitivities_are_derivatives_of_the_whole_filter(mission, flight):
    """Start, prediction, updates and resets: the estimate with a tenth of a sigma of each error, to either side.

    The gain depends on the estimate, which begins at rest: 2.2 % of a reported sigma were seen (the rate, by a marker's
    place). 3 % of a sigma is 0.1 % of a variance; the errors here do up to one sigma.
    """
    nav, nominal = at_the_end(mission, flight, mission)
    s = pose_views(nav.memory).bank_sensitivities[0]
    scale = np.sqrt(np.diag(nominal.covariance))
    for which in range(len(s)):
        there, back = (at_the_end(mission, flight, *built_with(mission, which, size))[1] for size in (0.1, -0.1))
        expected = difference(there, back) / 0.2
        np.testing.assert_allclose(s[which] / scale, expected / scale, rtol=0.0, atol=0.03, err_msg=f"error {which}")
    assert np.abs(s / scale).max(axis=1).min() > 0.02  # each of them is felt, so that the comparison can fail


def errors_of(mission, *, built, runs, way):
    parts = []
    for run in range(runs):
        flown = simulate_flight(markers_as_built(mission, run) if built else mission, APPROACH, seed=100 + run)
        parts.append(way(mission, flown))
    errors: PoseErrors = joined(parts)
    return errors.where(errors.t_s > 5.0)


@pytest.mark.parametrize(
    ("attitude_deg", "built"),
    [(0.1, False), (0.01, False), (0.01, True)],
    ids=["attitude off", "as shipped", "as built"],
)
@pytest.mark.parametrize("way", [tight_errors, smoothed_errors], ids=["filtered", "smoothed"])
def test_honest_with_what_lasts(attitude_deg, built, way):
    """Drawn once a flight; mean NEES of each three components (taken for noise: 33 and 150).

    Twelve flights have 36 independent turns or places: the mean of 36 squares lies within 1 -+ 0.6 at 2.5 sigma.
    """
    mission = with_lasting(attitude_deg, tolerances=built)
    errors = errors_of(mission, built=built, runs=12, way=way)
    for part in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)):
        assert 0.4 <= nees(errors.error[:, part], errors.covariance[:, part, part]).mean() / 3.0 <= 1.6
    assert 0.6 <= errors.nees_ratio <= 1.3


def test_the_port_does_not_feel_the_attitude_of_the_chaser():
    """Seen by the camera, port from port does not depend on how the chaser stands in its orbit: the errors cancel."""
    told, plain = with_lasting(0.5, tolerances=False), with_lasting(0.0, tolerances=False)
    flown: MarkerFlight = simulate_flight(plain, APPROACH, seed=4)
    records = [at_the_end(one, flown, plain)[1] for one in (told, plain)]
    sigmas = [np.sqrt(np.diag(record.docking.covariance)) for record in records]
    np.testing.assert_allclose(sigmas[0][:3], sigmas[1][:3], rtol=0.1)
    np.testing.assert_allclose(sigmas[0][6:9], sigmas[1][6:9], rtol=0.1)
    state = [np.sqrt(np.diag(record.covariance)) for record in records]
    assert (state[0][6:9] > 2.0 * state[1][6:9]).all()


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_head_on_a_start_is_no_wider_than_the_expected_view(engine):
    """A flat pattern from 25 m, the view stated to 1 deg: a turn of the camera turns a start no farther than itself.

    The pose of the spots alone may be 10 deg off the one that it is joined to with the view. With slopes of the latter
    and the covariance of the former one sigma of the camera's mounting turned a start by 10 deg.
    """
    flat, mounting = relnav.load_model("three_marker_vision_flat"), math.radians(0.2)
    view = dataclasses.replace(flat.view, attitude_sigma_rad=math.radians(1.0))
    built = MarkerTolerances(1e-3, 2e-4, mounting, considered=True)
    markers = dataclasses.replace(flat.markers, positions_m=((0.0, 0.3, 0.3), (0.0, -0.3, 0.3), (0.0, 0.0, -0.3)))
    flat, known = dataclasses.replace(flat, view=view, tolerances=built, markers=markers), 0
    for seed in range(8):
        far = simulate_flight(flat, dataclasses.replace(APPROACH, duration_s=2.0, start_m=(25.0, 0.3, -0.2)), seed=seed)
        said = filter_marker_epochs(flat, far.t_s, far.spots_px, acceleration_m_s2=far.acceleration_m_s2, engine=engine)
        attitudes = said.covariance[said.hypotheses > 0][:, 6:9, 6:9]
        lasting = built.camera_mounting_sigma_rad**2 + flat.chaser.attitude_sigma_rad**2
        assert (np.linalg.eigvalsh(attitudes) < 1.1 * (WIDENED * view.attitude_sigma_rad**2 + 4.0 * lasting)).all()
        known += len(attitudes)
    assert known > 20
