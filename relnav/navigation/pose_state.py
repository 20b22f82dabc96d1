"""Position, velocity, attitude and rate of chaser and target in one filter: its state, its prediction, its start.

State: rho, v (chaser's centre of mass from the target's, `lvlh_ccsds`; Clohessy-Wiltshire), C = dcm_lvlh_from_target
and w (the target's inertial rate, target axes; rigid body). Twelve errors (drho, dv, theta, dw) with
C = C_hat exp([theta x]). Marker i is seen at

    p_i = C_KB (C_BL (C s_i - rho) - c_B)        K camera, B chaser, L lvlh_ccsds, c_B the lens in the chaser

so that any number of spots, one included, tells what it can (`spot_update`). What lasts (the chaser's attitude error,
and on request what was built) is considered and not estimated: `sensitivities` (m, 12) of a state.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Flags, Matrix, Stack, Vector
from relnav.dynamics.clohessy_wiltshire import propagate, transition
from relnav.dynamics.error_state import MOTION, POSE, RATE, THETA, VELOCITY
from relnav.dynamics.process_noise import acceleration_noise, add_execution_error
from relnav.dynamics.relative_motion import frame_rate
from relnav.dynamics.rigid_body import RigidBody, lvlh_rate
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import VisionMission
from relnav.navigation.memory import orbit_values
from relnav.sensors.three_marker.camera import project
from relnav.sensors.three_marker.jacobians import spot_jacobians
from relnav.sensors.three_marker.pose import Pose

SHOWN = np.r_[0:VELOCITY, THETA:RATE]
"""Position and attitude among the twelve errors: all that an image shows."""


@dataclass(frozen=True)
class PoseState:
    """One estimate.

    Attributes
    ----------
    motion : (6,)
        rho m, v m/s, `lvlh_ccsds`.
    dcm_lvlh_from_target : (3, 3)
    rate_rad_s : (3,)
        Inertial, target axes.
    covariance : (12, 12)
        Of (drho, dv, theta, dw).
    """

    motion: Vector
    dcm_lvlh_from_target: Matrix
    rate_rad_s: Vector
    covariance: Matrix

    def moved(self, correction: Vector, covariance: Matrix) -> "PoseState":
        """With a correction (12,) taken in, covariance being about the state that results."""
        return PoseState(
            self.motion + correction[:MOTION],
            turned(self.dcm_lvlh_from_target, correction[THETA:RATE]),
            self.rate_rad_s + correction[RATE:],
            covariance,
        )

    def error_of(self, truth: "PoseState") -> Vector:
        """(drho, dv, theta, dw) (12,) by which the truth is off this estimate."""
        turn = rotation_vector_between(truth.dcm_lvlh_from_target, self.dcm_lvlh_from_target)
        return np.concatenate([truth.motion - self.motion, turn, truth.rate_rad_s - self.rate_rad_s])


def time_update(
    state: PoseState,
    dt_s: float,
    body: RigidBody,
    mission: VisionMission,
    acceleration_m_s2: Vector,
    delta_v_m_s: Vector,
) -> tuple[PoseState, Matrix, Matrix]:
    """Go on by dt_s under an acceleration (3,) held over it and an impulse (3,) at its end, `lvlh_ccsds`.

    Returns the predicted state, and Phi and Q (12, 12) by which its covariance is Phi P Phi^T + Q.
    """
    n, noise, size = mission.orbit.mean_motion_rad_s, mission.process_noise, POSE
    dcm, rate, turn, turn_noise = body.propagate_with_errors(
        state.dcm_lvlh_from_target, state.rate_rad_s, dt_s, mission.target.rate_noise_density_rad2_s3
    )
    along, across = noise.control_magnitude_sigma, noise.control_direction_sigma_rad
    root = math.sqrt(noise.control_correlation_time_s)
    density = noise.acceleration_noise_density_m2_s3 * np.eye(3)
    add_execution_error(acceleration_m_s2, along * root, across * root, density)
    phi, added = np.zeros((size, size)), np.zeros((size, size))
    phi[:MOTION, :MOTION], phi[MOTION:, MOTION:] = transition(n, dt_s), turn
    added[:MOTION, :MOTION], added[MOTION:, MOTION:] = acceleration_noise(n, dt_s, density), turn_noise
    if np.count_nonzero(delta_v_m_s):
        add_execution_error(delta_v_m_s, along, across, added[VELOCITY:MOTION, VELOCITY:MOTION])
    covariance = phi @ state.covariance @ phi.T + added
    motion = propagate(state.motion, n, dt_s, acceleration_m_s2, delta_v_m_s)
    return PoseState(motion, dcm, rate, 0.5 * (covariance + covariance.T)), phi, added


def camera_pose(state: PoseState, mission: VisionMission, dcm_chaser_from_lvlh: Matrix) -> Matrix:
    """Pose (4, 3) of the target seen from the camera: rows C_KT, r."""
    mount, pose = mission.camera.dcm_cam_from_chaser, np.empty((4, 3))
    pose[:3] = mount @ dcm_chaser_from_lvlh @ state.dcm_lvlh_from_target
    pose[3] = mount @ (-dcm_chaser_from_lvlh @ state.motion[:3] - np.array(mission.camera.position_m))
    return pose


def state_from_pose(
    pose: Pose, mission: VisionMission, dcm_chaser_from_lvlh: Matrix, *, t_s: float, widened: float = 1.0
) -> PoseState:
    """State of a first pose, of t_s: at rest in the rotating frame, but for the initial sigmas of velocity and rate.

    widened: factor on the pose's covariance.
    """
    seen = pose.seen_from_chaser(mission.camera)
    back = dcm_chaser_from_lvlh.T
    motion = np.concatenate([-back @ seen.position_m, np.zeros(3)])
    dcm = back @ seen.dcm_cam_from_target
    rate = lvlh_rate(dcm, frame_rate(orbit_values(mission.orbit), t_s))
    state = PoseState(motion, dcm, rate, np.zeros((POSE, POSE)))
    spread = np.eye(len(SHOWN))
    spread[:3, :3] = -back
    alpha = np.empty((len(SHOWN), 3))
    alpha[:3], alpha[3:] = spread[:3, :3] @ cross_matrix(-seen.position_m), (dcm_chaser_from_lvlh @ dcm).T
    covariance = widened * spread @ seen.covariance @ spread.T
    covariance += mission.chaser.attitude_noise_rad**2 * alpha @ alpha.T
    whole = np.zeros((POSE, POSE))
    whole[SHOWN[:, None], SHOWN] = covariance
    whole[VELOCITY:MOTION, VELOCITY:MOTION] = mission.filter.initial_velocity_sigma_m_s**2 * np.eye(3)
    whole[RATE:, RATE:] = mission.filter.initial_rate_sigma_rad_s**2 * np.eye(3)
    return replace(state, covariance=whole)


def lasting_by_spot(pose: Pose, mission: VisionMission) -> Stack:
    """What one sigma of each considered error does to each spot of a target at a pose, px, (n, 2, m).

    Errors: turns of the chaser; then, with tolerances considered, turns of the camera, focal length, every marker.
    """
    points, camera, tolerances = mission.markers.points_m, mission.camera, mission.tolerances
    by = spot_jacobians(points, np.vstack([pose.dcm_cam_from_target, pose.position_m]), camera)
    columns = [mission.chaser.attitude_sigma_rad * by.chaser_attitude]
    if tolerances is not None and tolerances.considered:
        spots = project(by.in_camera_m, camera).spots_px - np.array(camera.principal_point_px)
        own = np.einsum("nij,nk->nikj", by.marker, np.eye(len(points))).reshape(len(points), 2, -1)
        columns.append(tolerances.camera_mounting_sigma_rad * by.mounting)
        columns.append(tolerances.focal_length_relative_sigma * spots[:, :, None])
        columns.append(tolerances.marker_placement_sigma_m * own)
    return np.concatenate(columns, axis=2)


def sensitivities_from_pose(
    pose: Pose,
    joint: Matrix,
    mission: VisionMission,
    dcm_chaser_from_lvlh: Matrix,
    used: Flags,
    covariances: Stack | None,
) -> Matrix:
    """What considered errors do to the state of a first pose, (m, 12): dx/dz E, z the spots that were used.

    joint (6, 6): covariance of the pose joined with the expected view. Slopes are those of the pose of the spots alone,
    of which it was made: seen head-on, those of another attitude multiply errors by hundreds. covariances (n, 2, 2)
    px^2 of the spots; the camera's noise if None.
    """
    rows = 2 * int(np.count_nonzero(used))
    by = spot_jacobians(
        mission.markers.points_m, np.vstack([pose.dcm_cam_from_target, pose.position_m]), mission.camera
    )
    h = np.concatenate([by.position, by.attitude], axis=2)[used]
    noise = np.broadcast_to(mission.camera.spot_noise_px**2 * np.eye(2), (*h.shape[:1], 2, 2))
    weighted = np.linalg.solve(noise if covariances is None else covariances[used], h)
    by_error = lasting_by_spot(pose, mission)[used].reshape(rows, -1)
    of_pose = joint @ weighted.reshape(rows, len(SHOWN)).T @ by_error
    out = np.zeros((by_error.shape[1], POSE))
    out[:, :3] = of_pose[:3].T @ (-dcm_chaser_from_lvlh.T @ mission.camera.dcm_cam_from_chaser.T).T
    out[:, THETA:RATE] = of_pose[3:].T
    return out
