"""Markers far away, seen with a chaser attitude and a camera mounting that are wrong by what is stated, once a run.

The truth is written here: Hill's equations with the filter's white acceleration, a target of three equal moments of
inertia whose rate walks as the filter assumes.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import relnav
from relnav.mission import MarkerTolerances
from relnav.navigation.pose_log import filter_marker_epochs

RANGE_M, STEP_S, IMAGES, RUNS = 50.0, 0.2, 100, 100
SIGMA_RAD = np.radians(0.35)


def mission_with(chaser_share, camera_share):
    """Shares of SIGMA_RAD that are the chaser's attitude and the camera's mounting."""
    model = relnav.load_model("three_marker_vision")
    body = tuple(tuple(3000.0 * row) for row in np.eye(3))
    return replace(
        model,
        chaser=replace(model.chaser, attitude_sigma_rad=chaser_share * SIGMA_RAD, attitude_noise_rad=0.0),
        target=replace(model.target, inertia_kg_m2=body),
        tolerances=MarkerTolerances(0.0, 0.0, camera_share * SIGMA_RAD, considered=True),
    )


def flown(truth, mission, seed):
    """Times, spots, and the truth: motion, attitude lvlh from target, inertial rate in target axes."""
    rng, dt = np.random.default_rng((5, seed)), STEP_S
    q, spin = mission.process_noise.acceleration_noise_density_m2_s3, mission.target.rate_noise_density_rad2_s3
    noise = np.linalg.cholesky(np.kron([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]], q * np.eye(3)))
    phi, of_frame = expm(truth.hill_matrix(truth.n) * dt), np.array([0.0, -truth.n, 0.0])
    x = np.concatenate([[RANGE_M, 0.0, 0.0], mission.filter.initial_velocity_sigma_m_s * rng.normal(size=3)])
    attitude = Rotation.from_rotvec(np.radians(3.0) * rng.normal(size=3))
    rate = attitude.inv().apply(of_frame) + mission.filter.initial_rate_sigma_rad_s * rng.normal(size=3)
    camera = Rotation.from_rotvec(SIGMA_RAD * rng.normal(size=3)).as_matrix() @ mission.view.dcm_cam_from_target
    spots, truths = [], []
    for k in range(IMAGES):
        if k > 0:
            x, before = phi @ x + noise @ rng.normal(size=6), rate
            rate = rate + np.sqrt(spin * dt) * rng.normal(size=3)
            attitude *= Rotation.from_rotvec(dt * (0.5 * (before + rate) - attitude.inv().apply(of_frame)))
        seen = (mission.markers.points_m @ attitude.as_matrix().T - x[:3]) @ camera.T
        spots.append(np.array(mission.camera.focal_length_px) * seen[:, :2] / seen[:, 2:])
        truths.append((x, attitude, rate))
    spots = np.array(spots) + np.array(mission.camera.principal_point_px)
    return dt * np.arange(IMAGES), spots + mission.camera.spot_noise_px * rng.normal(size=spots.shape), truths


def squared(solution, truths, k):
    """NEES per component of epoch k."""
    x, attitude, rate = truths[k]
    turn = (Rotation.from_matrix(solution.dcm_lvlh_from_target[k]).inv() * attitude).as_rotvec()
    error = np.concatenate([x - solution.state[k], turn, rate - solution.rate_rad_s[k]])
    return error @ np.linalg.solve(solution.covariance[k], error) / len(error)


@pytest.mark.parametrize("shares", [(1.0, 0.0), (0.6, 0.8)], ids=["attitude", "attitude and mounting"])
def test_honest_far_away(truth, shares):
    """Of 100 runs, 3 sigma is 0.12. A Schmidt filter without `refer_turns` has 1.2 to 1.3."""
    mission, ratios = mission_with(*shares), []
    for seed in range(RUNS):
        t, spots, truths = flown(truth, mission, seed)
        for smooth in (False, True):
            solution = filter_marker_epochs(mission, t, spots, smooth=smooth)
            ratios.append([squared(solution, truths, k) for k in (IMAGES // 2, IMAGES - 1)])
    filtered, smoothed = np.mean(ratios[::2], axis=0), np.mean(ratios[1::2], axis=0)
    assert (np.abs(filtered - 1.0) < 0.12).all()
    assert (np.abs(smoothed - 1.0) < 0.12).all()
