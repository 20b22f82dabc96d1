"""Position, velocity, attitude and rate of chaser and target in one filter: its state, its time and spot updates.

State: rho, v (chaser's centre of mass from the target's, `lvlh_ccsds`; Clohessy-Wiltshire), C = dcm_lvlh_from_target
and w (the target's inertial rate, target axes; rigid body). Twelve errors (drho, dv, theta, dw) with
C = C_hat exp([theta x]). Marker i is seen at

    p_i = C_KB (C_BL (C s_i - rho) - c_B)        K camera, B chaser, L lvlh_ccsds, c_B the lens in the chaser

so that any number of spots, one included, tells what it can. The chaser's own attitude error turns all spots of an
image together: it is considered in their covariance and not estimated.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.dynamics.clohessy_wiltshire import propagate, transition
from relnav.dynamics.process_noise import acceleration_noise
from relnav.dynamics.rigid_body import RigidBody, cross
from relnav.estimation.attitude import joseph, reset, turned
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.mission import ProcessNoise, VisionMission
from relnav.sensors.three_marker.camera import project
from relnav.sensors.three_marker.jacobians import spot_jacobians
from relnav.sensors.three_marker.pose import Pose


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

    def corrected(self, correction: Vector, covariance: Matrix) -> "PoseState":
        """With a correction (12,) taken in, covariance being about the present state."""
        return PoseState(
            self.motion + correction[:6],
            turned(self.dcm_lvlh_from_target, correction[6:9]),
            self.rate_rad_s + correction[9:],
            reset(covariance, correction[6:9], at=6),
        )

    def error_of(self, truth: "PoseState") -> Vector:
        """(drho, dv, theta, dw) (12,) by which the truth is off this estimate."""
        turn = rotation_vector_between(truth.dcm_lvlh_from_target, self.dcm_lvlh_from_target)
        return np.concatenate([truth.motion - self.motion, turn, truth.rate_rad_s - self.rate_rad_s])


def control_noise(control: Vector, noise: ProcessNoise) -> Matrix:
    """Covariance (3, 3) of what is executed of a control vector (3,), by its errors in size and direction."""
    along = np.outer(control, control)
    across = float(control @ control) * np.eye(3) - along
    spread: Matrix = noise.control_magnitude_sigma**2 * along + noise.control_direction_sigma_rad**2 * across
    return spread


def time_update(
    state: PoseState,
    dt_s: float,
    body: RigidBody,
    mission: VisionMission,
    acceleration_m_s2: Vector,
    delta_v_m_s: Vector,
) -> PoseState:
    """Go on by dt_s under an acceleration (3,) held over it and an impulse (3,) at its end, `lvlh_ccsds`."""
    n, noise, size = mission.orbit.mean_motion_rad_s, mission.process_noise, 12
    dcm, rate, turn, turn_noise = body.propagate_with_errors(
        state.dcm_lvlh_from_target, state.rate_rad_s, dt_s, mission.target.rate_noise_density_rad2_s3
    )
    density = noise.acceleration_noise_density_m2_s3 * np.eye(3)
    density += noise.control_correlation_time_s * control_noise(acceleration_m_s2, noise)
    phi, added = np.zeros((size, size)), np.zeros((size, size))
    phi[:6, :6], phi[6:, 6:] = transition(n, dt_s), turn
    added[:6, :6], added[6:, 6:] = acceleration_noise(n, dt_s, density), turn_noise
    added[3:6, 3:6] += control_noise(delta_v_m_s, noise)
    covariance = phi @ state.covariance @ phi.T + added
    motion = propagate(state.motion, n, dt_s, acceleration_m_s2, delta_v_m_s)
    return PoseState(motion, dcm, rate, 0.5 * (covariance + covariance.T))


def camera_pose(state: PoseState, mission: VisionMission, dcm_chaser_from_lvlh: Matrix) -> Matrix:
    """Pose (4, 3) of the target seen from the camera: rows C_KT, r."""
    mount = mission.camera.dcm_cam_from_chaser
    position = mount @ (-dcm_chaser_from_lvlh @ state.motion[:3] - np.array(mission.camera.position_m))
    return np.vstack([mount @ dcm_chaser_from_lvlh @ state.dcm_lvlh_from_target, position])


@dataclass(frozen=True)
class SpotUpdate:
    """What spots did to a state.

    Attributes
    ----------
    state : PoseState
        After the update.
    accepted : (n,)
        Which markers' spots were used.
    nis, dof : float, int
        Of everything seen, before the gate.
    score : float
        Minus twice the log-likelihood of the spots used; a rejected spot costs what the gate's limit would.
    """

    state: PoseState
    accepted: Flags
    nis: float
    dof: int
    score: float


@dataclass(frozen=True)
class _Prediction:
    """Markers used, and of their spots: innovation px, rows by the 12 errors, covariance of all but the state."""

    seen: Codes
    innovation: Vector
    rows: Matrix
    noise: Matrix


def _curved(rows: Matrix, points: Matrix, covariance: Matrix) -> tuple[Vector, Matrix]:
    """Mean (2k,) and covariance (2k, 2k) of the spots' second order in the attitude error.

    p = C exp([theta x]) s has the second-order part C (theta theta^T - theta^T theta 1) s / 2. A plane that faces the
    camera shows a turn by its square alone: a filter of first order takes its size for knowledge of its sign.
    """
    s = np.repeat(points, 2, axis=0)
    qs = rows[:, :, None] * s[:, None, :]
    bend = 0.5 * (qs + qs.transpose(0, 2, 1)) - np.einsum("ij,ij->i", rows, s)[:, None, None] * np.eye(3)
    spread = bend @ covariance
    return 0.5 * np.trace(spread, axis1=1, axis2=2), 0.5 * np.einsum("iab,jba->ij", spread, spread)


def _predict_spots(
    state: PoseState, spots: Matrix, seen: Codes, mission: VisionMission, dcm_chaser: Matrix, covariances: Stack | None
) -> _Prediction:
    """Of those seen that are expected on the image."""
    camera = mission.camera
    pose = camera_pose(state, mission, dcm_chaser)
    expected = project(mission.markers.points_m @ pose[:3].T + pose[3], camera)
    seen = seen[expected.visible[seen]]
    points = mission.markers.points_m[seen]
    J = spot_jacobians(points, pose, camera)
    rows = np.zeros((2 * len(seen), 12))
    rows[:, :3] = -(J.position @ camera.dcm_cam_from_chaser @ dcm_chaser).reshape(-1, 3)
    rows[:, 6:9] = J.attitude.reshape(-1, 3)
    chaser = J.chaser_attitude.reshape(-1, 3)
    noise = mission.chaser.attitude_sigma_rad**2 * chaser @ chaser.T
    for k in range(len(seen)):
        own = camera.spot_noise_px**2 * np.eye(2) if covariances is None else covariances[seen[k]]
        noise[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += own
    mean, curved = _curved(J.marker.reshape(-1, 3), points, state.covariance[6:9, 6:9])
    innovation = (spots[seen] - expected.spots_px[seen]).ravel() - mean
    return _Prediction(seen, innovation, rows, noise + curved)


def spot_update(
    state: PoseState,
    spots_px: Matrix,
    mission: VisionMission,
    dcm_chaser_from_lvlh: Matrix,
    limit: float,
    covariances: Stack | None = None,
) -> SpotUpdate:
    """Use the spots (n, 2) px of one image, one row a marker, NaN = not seen; limit: of each spot's own NIS.

    covariances (n, 2, 2) px^2 of the spots; the camera's spot noise if left out.
    """
    accepted = np.zeros(len(spots_px), dtype=bool)
    usable = np.isfinite(spots_px).all(axis=-1)
    if covariances is not None:
        usable &= np.isfinite(covariances).all(axis=(1, 2))
    seen = np.flatnonzero(usable)
    if len(seen) == 0:
        return SpotUpdate(state, accepted, math.nan, 0, 0.0)
    expected = _predict_spots(state, spots_px, seen, mission, dcm_chaser_from_lvlh, covariances)
    missed, seen = len(seen) - len(expected.seen), expected.seen
    if len(seen) == 0:
        return SpotUpdate(state, accepted, math.nan, 0, limit * missed)
    S = expected.rows @ state.covariance @ expected.rows.T + expected.noise
    nis = float(expected.innovation @ np.linalg.solve(S, expected.innovation))
    good = []
    for k in range(len(seen)):
        at = slice(2 * k, 2 * k + 2)
        if expected.innovation[at] @ np.linalg.solve(S[at, at], expected.innovation[at]) <= limit:
            good += [2 * k, 2 * k + 1]
            accepted[seen[k]] = True
    score = limit * (missed + len(seen) - len(good) // 2)
    if not good:
        return SpotUpdate(state, accepted, nis, 2 * len(seen), score)
    H, y = expected.rows[good], expected.innovation[good]
    S, R = S[np.ix_(good, good)], expected.noise[np.ix_(good, good)]
    score += float(y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
    gain = np.asarray(np.linalg.solve(S, H @ state.covariance).T, dtype=np.float64)
    updated = state.corrected(gain @ y, joseph(state.covariance, gain, H, R))
    return SpotUpdate(updated, accepted, nis, 2 * len(seen), score)


def _chaser_attitude_effect(state: PoseState, mission: VisionMission, dcm_chaser: Matrix) -> Matrix:
    """How a chaser attitude error alpha moves (r, theta) of the pose that is seen, (6, 3)."""
    out = np.empty((6, 3))
    out[:3] = mission.camera.dcm_cam_from_chaser @ cross(-dcm_chaser @ state.motion[:3])
    out[3:] = -(dcm_chaser @ state.dcm_lvlh_from_target).T
    return out


def pose_update(state: PoseState, pose: Pose, mission: VisionMission, dcm_chaser_from_lvlh: Matrix) -> PoseState:
    """Use a finished pose of one image (loosely coupled): what needs three spots, for comparison with `spot_update`."""
    expected = camera_pose(state, mission, dcm_chaser_from_lvlh)
    turn = rotation_vector_between(pose.dcm_cam_from_target, expected[:3])
    H = np.zeros((6, 12))
    H[:3, :3] = -mission.camera.dcm_cam_from_chaser @ dcm_chaser_from_lvlh
    H[3:, 6:9] = np.eye(3)
    alpha = _chaser_attitude_effect(state, mission, dcm_chaser_from_lvlh)
    R = pose.covariance + mission.chaser.attitude_sigma_rad**2 * alpha @ alpha.T
    S = H @ state.covariance @ H.T + R
    gain = np.asarray(np.linalg.solve(S, H @ state.covariance).T, dtype=np.float64)
    innovation = np.concatenate([pose.position_m - expected[3], turn])
    return state.corrected(gain @ innovation, joseph(state.covariance, gain, H, R))


def state_from_pose(
    pose: Pose, mission: VisionMission, dcm_chaser_from_lvlh: Matrix, *, widened: float = 1.0
) -> PoseState:
    """State of a first pose: at rest in the rotating frame, but for the initial sigmas of velocity and rate.

    widened: factor on the pose's covariance.
    """
    seen = pose.seen_from_chaser(mission.camera)
    back = dcm_chaser_from_lvlh.T
    motion = np.concatenate([-back @ seen.position_m, np.zeros(3)])
    dcm = back @ seen.dcm_cam_from_target
    rate = -mission.orbit.mean_motion_rad_s * dcm[1]
    state = PoseState(motion, dcm, rate, np.zeros((12, 12)))
    spread = np.eye(6)
    spread[:3, :3] = -back
    alpha = np.empty((6, 3))
    alpha[:3], alpha[3:] = spread[:3, :3] @ cross(-seen.position_m), (dcm_chaser_from_lvlh @ dcm).T
    covariance = widened * spread @ seen.covariance @ spread.T
    covariance += mission.chaser.attitude_sigma_rad**2 * alpha @ alpha.T
    here = [0, 1, 2, 6, 7, 8]
    whole = np.zeros((12, 12))
    whole[np.ix_(here, here)] = covariance
    whole[3:6, 3:6] = mission.filter.initial_velocity_sigma_m_s**2 * np.eye(3)
    whole[9:, 9:] = mission.filter.initial_rate_sigma_rad_s**2 * np.eye(3)
    return replace(state, covariance=whole)
