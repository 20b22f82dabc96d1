"""The update of a pose state by any number of marker spots, to second order in position and attitude.

A spot's second order in the errors d = (drho, theta) is d^T B d / 2. Perspective: a spot moves by row d over the depth
p_z, which d changes itself, so that B = -(row^T g + g^T row), g = d(p_z)/p_z. A turn: p = C exp([theta x]) s has the
part C (theta theta^T - theta^T theta 1) s / 2, so that B = (q^T s^T + s q) / 2 - (q s) 1 with q the row by s. (The bend
of a lens's distortion is left out.) Its mean, tr(B P) / 2, shifts the expected spot, and its covariance,
tr(B_i P B_j P) / 2, is noise (Jazwinski 1970, ch. 9, Gaussian second-order filter): a filter of first order takes the
size of a turn that it sees by its square for knowledge of its sign, and after a gap in which the position has become
uncertain believes lines of sight that it has bent.
"""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.mission import VisionMission
from relnav.navigation.pose_correction import correct, gate
from relnav.navigation.pose_state import POSE, PoseState, camera_pose
from relnav.sensors.three_marker.camera import image_of, on_image
from relnav.sensors.three_marker.jacobians import SpotJacobians
from relnav.sensors.three_marker.pose import Pose


@dataclass(frozen=True)
class SpotUpdate:
    """What spots did to a state.

    Attributes
    ----------
    state : PoseState
        After the update.
    seen, accepted : (n,)
        Which markers had a spot, and of which it was used.
    nis, dof : float, int
        Of everything seen, before the gate; but not of a spot off the image, or of a marker expected behind the camera.
    score : float
        Minus twice the log-likelihood of the spots; a rejected spot costs what one at the gate's limit would.
    """

    state: PoseState
    seen: Flags
    accepted: Flags
    nis: float
    dof: int
    score: float


@dataclass(frozen=True)
class Prediction:
    """Markers (k,) whose spots can be used, and of these spots.

    `innovation` (2k,) px, `rows` (2k, 6) by (drho, theta), `noise` (2k, 2k) px^2: the covariance of all but the state's
    first order.
    """

    markers: Codes
    innovation: Vector
    rows: Matrix
    noise: Matrix


def spots_seen(spots_px: Matrix) -> Flags:
    """Which rows (n, 2) hold a spot, (n,)."""
    return np.asarray(np.isfinite(spots_px).all(axis=-1))


@kernel
def add_second_order(
    rows: Matrix, nearer: Matrix, by_marker: Matrix, points: Matrix, P: Matrix, mean: Vector, noise: Matrix, work: Stack
) -> None:
    """Write the mean (2k,) of the spots' second order and add its covariance to noise (2k, 2k).

    rows (2k, 6); nearer (k, 6): g; by_marker (2k, 3): q; points (k, 3): s, see the module's head; P (6, 6): covariance
    of (drho, theta); work (2k + 1, 6, 6): scratch.
    """
    B = work[len(rows)]
    for r in range(len(rows)):
        g, s, q = nearer[r // 2], points[r // 2], by_marker[r]
        along = q[0] * s[0] + q[1] * s[1] + q[2] * s[2]
        for i in range(6):
            for j in range(6):
                B[i, j] = -(rows[r, i] * g[j] + rows[r, j] * g[i])
        for i in range(3):
            for j in range(3):
                B[3 + i, 3 + j] += 0.5 * (q[i] * s[j] + q[j] * s[i])
            B[3 + i, 3 + i] -= along
        mean[r] = 0.0
        for i in range(6):
            for j in range(6):
                total = 0.0
                for m in range(6):
                    total += B[i, m] * P[m, j]
                work[r, i, j] = total
            mean[r] += 0.5 * work[r, i, i]
    for r in range(len(rows)):
        for c in range(r + 1):
            total = 0.0
            for i in range(6):
                for j in range(6):
                    total += work[r, i, j] * work[c, j, i]
            noise[r, c] += 0.5 * total
            if c < r:
                noise[c, r] += 0.5 * total


def predict_spots(
    state: PoseState,
    spots_px: Matrix,
    seen: Codes,
    mission: VisionMission,
    dcm_chaser_from_lvlh: Matrix,
    covariances: Stack | None = None,
) -> Prediction:
    """Of the markers seen (k,), those whose spot is on the image and that are expected before the camera."""
    camera, pose = mission.camera, camera_pose(state, mission, dcm_chaser_from_lvlh)
    points = mission.markers.points_m[seen]
    p = points @ pose[:3].T + pose[3]
    expected, by_point = image_of(p, camera)
    usable = np.isfinite(expected[:, 0]) & on_image(spots_px[seen], camera)
    if np.count_nonzero(usable) < len(usable):
        seen, points, p = seen[usable], points[usable], p[usable]
        expected, by_point = expected[usable], by_point[usable]
    J = SpotJacobians(by_point, points, p, pose[:3], camera)
    dcm_cam = camera.dcm_cam_from_chaser @ dcm_chaser_from_lvlh
    rows, nearer = np.empty((2 * len(seen), 6)), np.empty((len(seen), 6))
    rows[:, :3] = -(by_point @ dcm_cam).reshape(-1, 3)
    rows[:, 3:] = J.attitude.reshape(-1, 3)
    nearer[:, :3] = -dcm_cam[2]
    nearer[:, 3:] = cross_matrix(points) @ pose[2]
    nearer /= p[:, 2:]
    turns = J.chaser_attitude.reshape(-1, 3)
    noise = mission.chaser.attitude_sigma_rad**2 * turns @ turns.T
    if covariances is None:
        noise.flat[:: 2 * len(seen) + 1] += camera.spot_noise_px**2
    else:
        at = np.arange(2 * len(seen)).reshape(-1, 2)
        noise[at[:, :, None], at[:, None, :]] += covariances[seen]
    mean, work = np.empty(2 * len(seen)), np.empty((2 * len(seen) + 1, 6, 6))
    P = state.covariance[POSE[:, None], POSE]
    add_second_order(rows, nearer, J.marker.reshape(-1, 3), points, P, mean, noise, work)
    return Prediction(seen, (spots_px[seen] - expected).ravel() - mean, rows, noise)


def spot_update(
    state: PoseState,
    spots_px: Matrix,
    mission: VisionMission,
    dcm_chaser_from_lvlh: Matrix,
    limit: float,
    covariances: Stack | None = None,
) -> SpotUpdate:
    """Use the spots (n, 2) px of one image, one row a marker, NaN = not seen; limit: of each spot's own NIS.

    covariances (n, 2, 2) px^2 of the spots, positive definite; the camera's spot noise if left out.
    """
    seen, accepted = spots_seen(spots_px), np.zeros(len(spots_px), dtype=bool)
    markers = np.flatnonzero(seen)
    expected = predict_spots(state, spots_px, markers, mission, dcm_chaser_from_lvlh, covariances)
    lost = len(markers) - len(expected.markers)
    score = lost * (limit + 4.0 * math.log(mission.camera.spot_noise_px))
    if len(expected.markers) == 0:
        return SpotUpdate(state, seen, accepted, math.nan, 0, score)
    y, H, R = expected.innovation, expected.rows, expected.noise
    nis, own, areas = gate(state, H, R, y)
    good = own <= limit
    kept = np.count_nonzero(good)
    if kept < len(good):
        score += float(np.sum(limit + np.log(areas[~good])))
        of = np.repeat(good, 2)
        H, y, R = H[of], y[of], R[np.ix_(of, of)]
    updated, cost = (state, 0.0) if kept == 0 else correct(state, H, R, y)
    if math.isnan(
        cost
    ):  # spots against a prior without bounds: rounding has eaten the covariance, and nothing is learnt
        return SpotUpdate(state, seen, accepted, nis, len(own) * 2, score + limit * kept)
    accepted[expected.markers[good]] = True
    return SpotUpdate(updated, seen, accepted, nis, len(own) * 2, score + cost)


def _chaser_attitude_effect(state: PoseState, mission: VisionMission, dcm_chaser: Matrix) -> Matrix:
    """How a chaser attitude error alpha moves (r, theta) of the pose that is seen, (6, 3)."""
    out = np.empty((6, 3))
    out[:3] = mission.camera.dcm_cam_from_chaser @ cross_matrix(-dcm_chaser @ state.motion[:3])
    out[3:] = -(dcm_chaser @ state.dcm_lvlh_from_target).T
    return out


def pose_update(state: PoseState, pose: Pose, mission: VisionMission, dcm_chaser_from_lvlh: Matrix) -> PoseState:
    """Use a finished pose of one image (loosely coupled): what needs three spots, for comparison with `spot_update`."""
    expected = camera_pose(state, mission, dcm_chaser_from_lvlh)
    turn = rotation_vector_between(pose.dcm_cam_from_target, expected[:3])
    rows = np.zeros((6, 6))
    rows[:3, :3] = -mission.camera.dcm_cam_from_chaser @ dcm_chaser_from_lvlh
    rows[3:, 3:] = np.eye(3)
    alpha = _chaser_attitude_effect(state, mission, dcm_chaser_from_lvlh)
    R = pose.covariance + mission.chaser.attitude_sigma_rad**2 * alpha @ alpha.T
    return correct(state, rows, R, np.concatenate([pose.position_m - expected[3], turn]))[0]
