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
from relnav.estimation.attitude import joseph
from relnav.mission import VisionMission
from relnav.navigation.pose_state import POSE, PoseState, camera_pose
from relnav.sensors.three_marker.camera import image_of, on_image
from relnav.sensors.three_marker.jacobians import SpotJacobians, cross_matrix


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


def second_order(rows: Matrix, nearer: Matrix, by_marker: Matrix, points: Matrix, P: Matrix) -> tuple[Vector, Matrix]:
    """Mean (2k,) and covariance (2k, 2k) of the spots' second order, P (6, 6) being the covariance of (drho, theta).

    rows (2k, 6); nearer (2k, 6): g; by_marker (2k, 3): q; points (2k, 3): s; see the module's head.
    """
    bent = rows[:, :, None] * nearer[:, None, :]
    B = -(bent + bent.transpose(0, 2, 1))
    turned = 0.5 * by_marker[:, :, None] * points[:, None, :]
    B[:, 3:, 3:] += turned + turned.transpose(0, 2, 1)
    B[:, [3, 4, 5], [3, 4, 5]] -= np.sum(by_marker * points, axis=-1)[:, None]
    spread = B @ P
    flat = spread.reshape(-1, 36)
    across = np.swapaxes(spread, 1, 2).reshape(-1, 36)
    return 0.5 * np.trace(spread, axis1=1, axis2=2), 0.5 * flat @ across.T


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
    if not usable.all():
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
    at = np.arange(2 * len(seen)).reshape(-1, 2)
    noise[at[:, :, None], at[:, None, :]] += (
        camera.spot_noise_px**2 * np.eye(2) if covariances is None else covariances[seen]
    )
    mean, curved = second_order(
        rows,
        np.repeat(nearer, 2, axis=0),
        J.marker.reshape(-1, 3),
        np.repeat(points, 2, axis=0),
        state.covariance[POSE[:, None], POSE],
    )
    innovation = (spots_px[seen] - expected).ravel() - mean
    return Prediction(seen, innovation, rows, noise + curved)


def _spot_blocks(S: Matrix) -> tuple[Vector, Vector, Vector]:
    """Elements xx, xy and yy of each spot's own block of S (2k, 2k)."""
    diagonal = np.diagonal(S)
    return diagonal[::2], np.diagonal(S, 1)[::2], diagonal[1::2]


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
    y, P_rows = expected.innovation, state.covariance[:, POSE] @ expected.rows.T
    S = expected.rows @ P_rows[POSE] + expected.noise
    nis, dof = float(y @ np.linalg.solve(S, y)), len(y)
    xx, xy, yy = _spot_blocks(S)
    areas, even, odd = xx * yy - xy * xy, y[::2], y[1::2]
    good = (yy * even * even - 2.0 * xy * even * odd + xx * odd * odd) / areas <= limit
    score += float(np.sum(limit + np.log(areas[~good])))
    accepted[expected.markers[good]] = True
    if not good.any():
        return SpotUpdate(state, seen, accepted, nis, dof, score)
    H, R = np.zeros((dof, 12)), expected.noise
    H[:, POSE] = expected.rows
    if not good.all():
        kept = np.repeat(good, 2)
        H, y, P_rows, S, R = H[kept], y[kept], P_rows[:, kept], S[kept][:, kept], R[kept][:, kept]
    gain = np.asarray(np.linalg.solve(S, P_rows.T).T, dtype=np.float64)
    own = nis if good.all() else float(y @ np.linalg.solve(S, y))
    score += own + float(np.linalg.slogdet(S)[1])
    updated = state.corrected(gain @ y, joseph(state.covariance, gain, H, R))
    return SpotUpdate(updated, seen, accepted, nis, dof, score)
