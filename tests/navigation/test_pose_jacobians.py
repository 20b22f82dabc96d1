"""Every derivative of the six-degree filter against differences of what it derives, and filterpy's arithmetic."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.dynamics.docking_port import port_geometry_into
from relnav.estimation.attitude import reset
from relnav.geometry.rotation_vector import turned
from relnav.navigation.blocks import FOCAL_LENGTH, MOUNTING, PLACEMENT
from relnav.navigation.observation.marker_poses import write_state
from relnav.navigation.observation.marker_rows import aim_camera, observe_markers
from relnav.navigation.pose_memory import new_pose_memory, pose_views
from relnav.navigation.pose_state import (
    PoseState,
    camera_pose,
    state_from_pose,
)
from relnav.sensors.three_marker import Pose, project, spot_jacobians

QUIET = 1e-9


@pytest.fixture(scope="module")
def mission():
    """Everything off its default: lever arm, mounting, lens, ports, chaser attitude."""
    model = relnav.load_model("three_marker_vision")
    mount = Rotation.from_rotvec([0.1, -0.2, 0.3])
    camera = dataclasses.replace(
        model.camera,
        position_m=(0.4, -0.2, 0.6),
        q_cam_from_chaser=tuple(mount.as_quat()),
        distortion=(-0.1, 0.02, 1e-3, -5e-4, 0.0),
    )
    chaser = dataclasses.replace(
        model.chaser, port_position_m=(0.2, -0.1, 0.9), attitude_noise_rad=2e-3, attitude_sigma_rad=0.0
    )
    return dataclasses.replace(model, camera=camera, chaser=chaser)


def a_state(seed=1, scale=1e-3):
    rng = np.random.default_rng(seed)
    root = scale * rng.normal(size=(12, 12))
    return PoseState(
        np.array([6.0, 0.3, -0.2, -0.05, 0.01, 0.02]),
        Rotation.from_rotvec([0.05, -0.08, 0.1]).as_matrix(),
        np.array([0.01, -0.02, 0.015]),
        root @ root.T,
    )


def moved(state, error):
    return PoseState(
        state.motion + error[:6],
        turned(state.dcm_lvlh_from_target, error[6:9]),
        state.rate_rad_s + error[9:],
        state.covariance,
    )


def spots(state, mission, dcm_chaser):
    pose = camera_pose(state, mission, dcm_chaser)
    return project(mission.markers.points_m @ pose[:3].T + pose[3], mission.camera).spots_px.ravel()


def differences(function, size, eps):
    return np.stack([(function(eps * u) - function(-eps * u)) / (2 * eps) for u in np.eye(size)], axis=-1)


def chaser_attitude(mission):
    return turned(mission.dcm_chaser_from_lvlh, np.array([0.02, -0.03, 0.01]))


def test_the_pose_seen_is_that_of_the_formula(mission):
    """P = C_KB (C_BL (C s - rho) - c_B), one marker at a time."""
    state, dcm = a_state(), chaser_attitude(mission)
    pose = camera_pose(state, mission, dcm)
    for s in mission.markers.points_m:
        p = mission.camera.dcm_cam_from_chaser @ (
            dcm @ (state.dcm_lvlh_from_target @ s - state.motion[:3]) - np.array(mission.camera.position_m)
        )
        np.testing.assert_allclose(pose[:3] @ s + pose[3], p, atol=1e-13)


def test_spot_rows(mission, marker_image):
    """By the state and by the chaser's attitude error, through a lens that distorts."""
    state, dcm = a_state(), chaser_attitude(mission)
    seen = spots(state, mission, dcm).reshape(-1, 2)
    rows = marker_image(state, seen, mission, dcm).rows
    expected = differences(lambda e: spots(moved(state, e), mission, dcm), 12, 1e-5)
    np.testing.assert_allclose(rows, expected, atol=1e-7 * np.abs(expected).max())
    pose = camera_pose(state, mission, dcm)
    rows = spot_jacobians(mission.markers.points_m, pose, mission.camera).chaser_attitude.reshape(-1, 3)
    expected = differences(lambda a: spots(state, mission, turned(np.eye(3), -a) @ dcm), 3, 1e-5)
    np.testing.assert_allclose(rows, expected, atol=1e-7 * np.abs(expected).max())


def test_spot_rows_are_the_derived_ones(mission, derivatives):
    """Rows of the filter, and what lasts: chaser's attitude, mounting, focal length and the markers' places."""
    sizes = dataclasses.replace(mission.tolerances, considered=True)
    chaser = dataclasses.replace(mission.chaser, attitude_sigma_rad=2e-3)
    told = dataclasses.replace(mission, tolerances=sizes, chaser=chaser)
    state, dcm, camera, m = a_state(), chaser_attitude(told), told.camera, pose_views(new_pose_memory(told))
    write_state(m.bank[0], state)
    aim_camera(m.camera, dcm)
    seen = spots(state, told, dcm).reshape(-1, 2)
    observe_markers(m, m.bank[0], m.bank_sensitivities[0], seen, np.empty((0, 2, 2)))
    derived = derivatives.derivative(derivatives.spot_of_light, "spot", "errors", at_zero=True, **derivatives.LIGHT)
    own = [np.array(x) for x in (camera.position_m, camera.focal_length_px, camera.distortion)]
    for k, s in enumerate(told.markers.points_m):
        by = derived(state.dcm_lvlh_from_target, dcm, camera.dcm_cam_from_chaser, s, state.motion[:3], *own)
        both, place = slice(2 * k, 2 * k + 2), slice(PLACEMENT + 3 * k, PLACEMENT + 3 * k + 3)
        rows, lasting = m.groups[k]["gradient"][:2], m.by_error[both]
        for got, expected in (
            (rows[:, :3], by[:, :3]),
            (rows[:, 6:9], by[:, 3:6]),
            (m.turns[both], by[:, 6:9]),
            (lasting[:, :3], 2e-3 * by[:, 6:9]),
            (lasting[:, MOUNTING : MOUNTING + 3], sizes.camera_mounting_sigma_rad * by[:, 9:12]),
            (lasting[:, FOCAL_LENGTH], sizes.focal_length_relative_sigma * by[:, 18]),
            (lasting[:, place], sizes.marker_placement_sigma_m * by[:, 15:18]),
        ):
            np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


def test_the_ports_are_the_derived_ones(derivatives):
    rng, shapes = np.random.default_rng(5), {"C_TL": (3, 3), "C_TB": (3, 3), "motion": (6,), "errors": (15,)}
    shapes |= {"w_T": (3,), "w_B": (3,), "d": (3,), "out": (12,)}
    C_TL, C_TB = Rotation.random(2, rng=rng).as_matrix()
    motion, rates, d, turn = rng.normal(size=6), rng.normal(size=(2, 3)), rng.normal(size=3), 0.7
    by_target, by_chaser, work = np.empty((12, 12)), np.empty((12, 3)), np.empty((4, 3))
    port_geometry_into(C_TL, C_TB, motion, rates, turn, d, np.empty((3, 3)), by_target, by_chaser, work)
    derived = derivatives.derivative(derivatives.port_from_port, "out", "errors", at_zero=True, **shapes)
    expected = derived(C_TL, C_TB, motion, *rates, turn, d)
    np.testing.assert_allclose(np.hstack([by_target, by_chaser]), expected, rtol=1e-11, atol=1e-13)


def docking_error(one, reference):
    """Of docking states, in the order of the covariance."""
    turn = Rotation.from_matrix(reference.dcm_target_from_chaser @ one.dcm_target_from_chaser.T).as_rotvec()
    return np.concatenate(
        [
            one.position_m - reference.position_m,
            one.velocity_m_s - reference.velocity_m_s,
            turn,
            one.rate_rad_s - reference.rate_rad_s,
        ]
    )


def test_docking_covariance(mission, docking_of):
    """To second order by differences, the chaser's attitude error with it."""
    state, dcm, own = a_state(), chaser_attitude(mission), np.array([0.003, -0.004, 0.002])
    reference = docking_of(state, mission, dcm, own)

    def error(e):
        seen = docking_of(moved(state, e[:12]), mission, turned(np.eye(3), -e[12:]) @ dcm, own)
        return docking_error(seen, reference)

    rows, step = differences(error, 15, 1e-5), 1e-3 * np.eye(15)
    bend = [[error(a + b) - error(a - b) - error(b - a) + error(-a - b) for b in step] for a in step]
    P = np.zeros((15, 15))
    P[:12, :12], P[12:, 12:] = state.covariance, (2e-3) ** 2 * np.eye(3)
    HP = np.moveaxis(np.array(bend) / 4e-6, 2, 0) @ P
    mean = 0.5 * np.trace(HP, axis1=1, axis2=2)
    expected = rows @ P @ rows.T + 0.5 * np.einsum("ikl,jlk->ij", HP, HP) + np.outer(mean, mean)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        reference.covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-7
    )


def test_docking_velocity_is_the_rate_of_its_position(mission, docking_of):
    """Carried on by a short step of chaser and target, from inertial motion alone."""
    state, dcm, own = a_state(), chaser_attitude(mission), np.array([0.003, -0.004, 0.002])
    orbit, h = np.array([0.0, -mission.orbit.mean_motion_rad_s, 0.0]), 1e-4

    def at(t):
        lvlh = Rotation.from_rotvec(-orbit * t).as_matrix()  # components turn against the frame
        target = PoseState(
            state.motion + t * np.concatenate([state.motion[3:], np.zeros(3)]),
            lvlh @ state.dcm_lvlh_from_target @ Rotation.from_rotvec(state.rate_rad_s * t).as_matrix(),
            state.rate_rad_s,
            state.covariance,
        )
        chaser = (lvlh @ dcm.T @ Rotation.from_rotvec(own * t).as_matrix()).T
        return docking_of(target, mission, chaser, own)

    velocity = (at(h).position_m - at(-h).position_m) / (2 * h)
    np.testing.assert_allclose(at(0.0).velocity_m_s, velocity, atol=1e-8)


def test_start_covariance(mission):
    """By differences: the state of a pose that is off, and of a chaser attitude that is off."""
    dcm, rng = chaser_attitude(mission), np.random.default_rng(2)
    root = 1e-3 * rng.normal(size=(6, 6))
    seen = camera_pose(a_state(), mission, dcm)
    pose = Pose(seen[3], seen[:3], root @ root.T)

    def started(pose, chaser=dcm):
        return state_from_pose(pose, mission, chaser, t_s=0.0)

    reference = started(pose)

    def by_pose(e):
        off = Pose(pose.position_m + e[:3], turned(pose.dcm_cam_from_target, e[3:]), pose.covariance)
        return reference.error_of(started(off))[[0, 1, 2, 6, 7, 8]]

    def by_chaser(a):
        return reference.error_of(started(pose, turned(np.eye(3), -a) @ dcm))[[0, 1, 2, 6, 7, 8]]

    P, A = differences(by_pose, 6, 1e-5), differences(by_chaser, 3, 1e-5)
    expected = P @ pose.covariance @ P.T + (2e-3) ** 2 * A @ A.T
    here = np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])
    np.testing.assert_allclose(reference.covariance[here], expected, atol=1e-7 * expected.max())


def test_the_update_is_filterpys(mission, marker_image):
    """One image: gain, state and covariance of filterpy's EKF with the same rows, then folded alike."""
    from filterpy.kalman import ExtendedKalmanFilter

    state, dcm = a_state(3, 2e-4), chaser_attitude(mission)
    seen = spots(state, mission, dcm).reshape(-1, 2) + 0.3
    ours = marker_image(state, seen, mission, dcm)
    other = ExtendedKalmanFilter(dim_x=12, dim_z=6)
    other.x, other.P = np.zeros(12), state.covariance.copy()
    other.update(ours.innovation, HJacobian=lambda _: ours.rows, Hx=lambda _: np.zeros(6), R=ours.noise)
    theirs = state.moved(other.x, reset(other.P, other.x[6:9], at=6))
    np.testing.assert_allclose(state.error_of(ours.state), state.error_of(theirs), rtol=1e-9, atol=1e-14)
    scale = np.sqrt(np.outer(np.diag(theirs.covariance), np.diag(theirs.covariance)))
    np.testing.assert_allclose(ours.state.covariance / scale, theirs.covariance / scale, atol=1e-10)


@pytest.mark.parametrize("sigmas", [(0.0, 0.05), (0.15, 0.0), (0.1, 0.04)], ids=["turn", "position", "both"])
def test_second_order(mission, marker_image, sigmas):
    """Mean and covariance by sampling: of pairs of opposite errors the odd orders cancel."""
    rng = np.random.default_rng(4)
    root = np.zeros((12, 12))
    root[:3, :3], root[6:9, 6:9] = sigmas[0] * rng.normal(size=(3, 3)), sigmas[1] * rng.normal(size=(3, 3))
    root[6:9, :3] = 0.3 * sigmas[1] * rng.normal(size=(3, 3))  # correlated
    camera = dataclasses.replace(mission.camera, distortion=(0.0,) * 5, image_size_px=(9000, 9000))
    plain = dataclasses.replace(
        mission, camera=camera, chaser=dataclasses.replace(mission.chaser, attitude_noise_rad=0.0)
    )
    state, dcm = dataclasses.replace(a_state(), covariance=root @ root.T), chaser_attitude(mission)
    still = spots(state, plain, dcm)
    expected = marker_image(state, still.reshape(-1, 2), plain, dcm)
    draws = rng.normal(size=(8000, 12)) @ root.T
    even = np.array([0.5 * (spots(moved(state, e), plain, dcm) + spots(moved(state, -e), plain, dcm)) for e in draws])
    sampled = np.cov(even.T)
    sigma = np.sqrt(np.diag(sampled))
    assert sigma.min() > 0.3
    np.testing.assert_allclose((even.mean(axis=0) - still) / sigma, -expected.innovation / sigma, atol=0.06)
    curved = expected.noise - plain.camera.spot_noise_px**2 * np.eye(6)
    np.testing.assert_allclose(curved / np.outer(sigma, sigma), sampled / np.outer(sigma, sigma), atol=0.15)
