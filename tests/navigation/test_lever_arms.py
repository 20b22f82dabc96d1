"""Lever arms of camera and port, and a camera attitude that differs from row to row."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import relnav

LIMIT = chi2.isf(1e-6, 6)
N = 900
PORT = (0.4, -0.3, 0.25)
CAMERA = (0.6, 0.2, -0.35)


@pytest.fixture(scope="module", params=["vbar", "rbar"])
def mission(request):
    """A real vehicle: neither lens nor port at a centre of mass, the camera mounted askew."""
    model = request.getfixturevalue(request.param)
    mount = tuple(Rotation.from_euler("zyx", [80.0, -20.0, 35.0], degrees=True).as_quat().tolist())
    return replace(
        model,
        docking=replace(model.docking, port_position_m=PORT),
        camera=replace(model.camera, position_m=CAMERA, q_cam_from_chaser=mount),
    )


@pytest.fixture(scope="module")
def flight(mission, drift, look, rotation_of):
    """The chaser holds 8.5 m from the port and turns by a degree."""
    rng = np.random.default_rng(2)
    t = 0.1 * np.arange(N)
    turn = Rotation.from_rotvec(np.radians(1.0) * rng.uniform(-1, 1, size=(N, 3)))
    attitude = turn * Rotation.from_quat(mission.attitude.q_cam_from_lvlh)
    dock = rotation_of(np.array(mission.docking.q_dock_from_lvlh))
    mount = rotation_of(np.array(mission.camera.q_cam_from_chaser))
    held_lever = mission.dcm_cam_from_lvlh.T @ mount @ np.array(CAMERA)
    start = np.array(PORT) + dock.T @ [8.5, 0.1, -0.1] - held_lever
    truth = drift(mission, t, np.concatenate([start, np.zeros(3)]))
    dcm = attitude.as_matrix()
    spots = look(mission, truth, seed=3, dcm=dcm)
    lens = truth[:, :3] + np.einsum("nji,jk,k->ni", dcm, mount, CAMERA)  # C^T mount lever
    p = (lens - PORT) @ dock.T
    horizontal = np.hypot(p[:, 0], p[:, 1])
    angles = np.arctan2(p[:, 1], p[:, 0]), np.arctan2(-p[:, 2], horizontal)
    view = np.stack([np.hypot(horizontal, p[:, 2]), *angles], axis=1)
    return t, truth, spots, attitude, view


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_rows_of_quaternions(mission, flight, nees, method):
    t, truth, spots, attitude, view = flight
    solution = relnav.filter_epochs(mission, t, spots, q_cam_from_lvlh=attitude.as_quat(), method=method)
    assert solution.restarts == 0
    values = nees((solution.state - truth)[200:], solution.covariance[200:])
    assert values.max() < LIMIT
    assert values.mean() < 9.0
    off = np.abs(solution.docking - view)[200:] / solution.docking_sigma[200:]
    assert off.max() < 5.0


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_matrix_per_step(mission, flight, nees, method):
    t, truth, spots, attitude, view = flight
    navigator = relnav.Navigator(mission, method)
    dcm = attitude.as_matrix()
    for k in range(300):
        record = navigator.step(t[k], spots[k], dcm_cam_from_lvlh=dcm[k])
    assert nees((record.state - truth[299])[None], record.covariance[None])[0] < LIMIT
    seen = [record.range_m, record.azimuth_rad, record.elevation_rad]
    sigma = [record.sigma_range_m, record.sigma_azimuth_rad, record.sigma_elevation_rad]
    assert np.all(np.abs(view[299] - seen) < 5.0 * np.array(sigma))


@pytest.mark.parametrize("ignored", ["camera", "port", "attitude"])
def test_each_of_them_matters(mission, flight, nees, ignored):
    t, truth, spots, attitude, _ = flight
    model, rows = mission, attitude.as_quat()
    if ignored == "camera":
        model = replace(mission, camera=replace(mission.camera, position_m=(0.0, 0.0, 0.0)))
    if ignored == "port":
        model = replace(mission, docking=replace(mission.docking, port_position_m=(0.0, 0.0, 0.0)))
    solution = relnav.filter_epochs(
        model, t, spots, q_cam_from_lvlh=None if ignored == "attitude" else rows, method="spots"
    )
    running = np.isfinite(solution.state).all(axis=1)
    values = nees((solution.state - truth)[running], solution.covariance[running])
    assert values.size == 0 or np.median(values) > 100.0


def test_a_held_attitude_with_lever_arms(mission, drift, look, nees):
    t = 0.1 * np.arange(400)
    dcm = mission.dcm_cam_from_lvlh
    start = np.array(PORT) + mission.dcm_dock_from_lvlh.T @ [8.5, 0.1, -0.1] - dcm.T @ mission.camera_lever_cam_m
    truth = drift(mission, t, np.concatenate([start, np.zeros(3)]))
    solution = relnav.filter_epochs(mission, t, look(mission, truth, seed=4), method="spots")
    assert nees((solution.state - truth)[100:], solution.covariance[100:]).max() < LIMIT
    assert abs(solution.range_m[-1] - 8.5) < 0.2


def test_a_quaternion_a_little_off_unit_length_is_normalised(vbar, drift, look):
    """Six decimals in a log: the rotation is that of the unit quaternion."""
    t = 0.1 * np.arange(50)
    spots = look(vbar, drift(vbar, t, [8.5, 0.1, -0.1, 0.0, 0.0, 0.0]))
    q = np.tile(vbar.attitude.q_cam_from_lvlh, (50, 1))
    exact = relnav.filter_epochs(vbar, t, spots, q_cam_from_lvlh=q, method="spots")
    rough = relnav.filter_epochs(vbar, t, spots, q_cam_from_lvlh=1.0005 * q, method="spots")
    np.testing.assert_allclose(rough.state[2:], exact.state[2:], rtol=0.0, atol=1e-11)
