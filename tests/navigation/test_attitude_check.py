"""A fix needs no attitude, but an image that contradicts the stated one is not believed without a word."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.status import PARTIAL, STARTED, UPDATED

RELIED_ON = (UPDATED, PARTIAL, STARTED)
T_S = 0.25 * np.arange(480)


@pytest.fixture(scope="module")
def vbar():
    """As shipped: the attitude with its sigma."""
    return relnav.load_model("three_beacon_psd")


def yawed_spots(vbar, look, truth, angle_rad, seed):
    """Images of a target that is turned by angle (n,) about its z axis, and so is the chaser's place in its frame."""
    about_z = Rotation.from_rotvec(np.outer(angle_rad, [0.0, 0.0, 1.0])).as_matrix()
    seen = np.array(truth)
    seen[:, :3] = np.einsum("nji,nj->ni", about_z, truth[:, :3])  # C^T r: target axes
    return look(vbar, seen, seed=seed, dcm=vbar.dcm_cam_from_lvlh @ about_z)


@pytest.fixture(scope="module")
def truth(vbar, drift):
    return drift(vbar, T_S, [8.0, 0.05, -0.1, -0.01, 0.0, 0.0])


@pytest.mark.parametrize("seed", range(12))
def test_a_target_that_yaws_is_told_before_the_track_is_one_degree_off(vbar, look, truth, seed):
    """0.1 deg/s from 20 s on: 10 deg in the end, which the fix alone would follow."""
    yaw = np.radians(0.1) * np.maximum(T_S - 20.0, 0.0)
    solution = relnav.filter_epochs(vbar, T_S, yawed_spots(vbar, look, truth, yaw, seed))
    relied_on = np.isin(solution.status, RELIED_ON)
    assert relied_on[(T_S > 2.0) & (T_S < 20.0)].mean() > 0.98
    off = np.degrees(np.abs(solution.azimuth_rad - np.arctan2(truth[:, 1], truth[:, 0])))
    told = int(np.argmax((yaw > 0.0) & (solution.measurement_status == int(relnav.Status.MISALIGNED))))
    assert off[told] < 0.8
    assert np.degrees(yaw[told]) < 1.5  # the track lags behind the target's turn
    assert np.mean(off[relied_on & (T_S > 2.0)] > 1.1) < 0.02
    assert relied_on[told + 20 :].mean() < 0.02


def test_without_the_attitude_nothing_tells_a_yaw(vbar, look, truth):
    """That is why it is checked: the very images, the attitude not stated, are believed, and the track is 1 m off."""
    yaw = np.radians(0.1) * np.maximum(T_S - 20.0, 0.0)
    unknown = replace(vbar, attitude=replace(vbar.attitude, mode="unknown"))
    solution = relnav.filter_epochs(unknown, T_S, yawed_spots(vbar, look, truth, yaw, 1))
    assert np.isin(solution.status[20:], RELIED_ON).mean() > 0.95
    assert np.abs(solution.state[-1, 1] - truth[-1, 1]) > 0.8


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_an_attitude_one_degree_off_is_told_about_every_axis_at_5_m(vbar, look, truth, axis, engine):
    turn = np.zeros(3)
    turn[axis] = np.radians(1.0)
    dcm = Rotation.from_rotvec(turn).as_matrix() @ vbar.dcm_cam_from_lvlh
    n, near = 120, truth - [3.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    spots = look(vbar, near[:n], seed=5, dcm=np.broadcast_to(dcm, (n, 3, 3)))
    solution = relnav.filter_epochs(vbar, T_S[:n], spots, engine=engine)
    assert np.isin(solution.status, RELIED_ON).mean() < 0.1


def test_errors_within_what_is_stated_are_not_told(vbar, look, truth):
    """Attitudes drawn once a flight from the stated sigma: no more refusals than the gate's and a lone 4.3 sigma."""
    rng, refused, epochs = np.random.default_rng(4), 0, 0
    for seed in range(30):
        dcm = Rotation.from_rotvec(rng.normal(0.0, vbar.attitude.sigma_rad, 3)).as_matrix() @ vbar.dcm_cam_from_lvlh
        spots = look(vbar, truth[:160], seed=seed, dcm=np.broadcast_to(dcm, (160, 3, 3)))
        solution = relnav.filter_epochs(vbar, T_S[:160], spots)
        refused += np.count_nonzero(solution.measurement_status == int(relnav.Status.MISALIGNED))
        epochs += 160
    assert refused <= 0.001 * epochs
