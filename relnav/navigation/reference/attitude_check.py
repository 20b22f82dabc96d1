"""Whether an image looks as the stated attitude says it should, for `engine="filterpy"`."""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.estimation.reference import ReferenceTrack
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection, central_projection_jacobian
from relnav.navigation.blocks import ATTITUDE_ERRORS, FIELD_ERRORS
from relnav.navigation.reference.beacon_rows import POSITION, TURN, BeaconOptics
from relnav.navigation.reference.lasting_errors import errors_of_all_coordinates


def attitude_is_credible(optics: BeaconOptics, limits: Vector, track: ReferenceTrack, spots: Matrix) -> bool:
    """Whether the mean of A, B and C, and the line from B to A, lie where an updated track has them.

    True where no attitude is stated, or the fix is not the measurement. limits: chi-square, from one on. What is
    considered is in the track as it was predicted.
    """
    if optics.method != "fix" or not optics.known:
        return True
    x, p, f, turn = track.state, track.covariance[:3, :3], optics.focal_length, optics.attitude_sigma**2
    points = (optics.beacons[:3] - x[:3]) @ optics.dcm.T - optics.lever
    predicted, slopes = f * central_projection(points), f * central_projection_jacobian(points)
    turns = np.mean([slope @ cross_matrix(point) for slope, point in zip(slopes, points, strict=True)], axis=0)
    along = predicted[0] - predicted[1]
    across = np.array([-along[1], along[0]]) / (along @ along)

    def numbers(coordinates: Matrix) -> Matrix:
        """What coordinates (3, 2, ...) do to mean and roll, (3, ...)."""
        roll = np.tensordot(across, coordinates[0] - coordinates[1], axes=1)
        return np.concatenate([coordinates.mean(axis=0), roll[None]])

    by_error = optics.coordinate_slopes(x)[2][:3]
    h, fresh = numbers(by_error[..., POSITION]), optics.attitude_noise * numbers(by_error[..., TURN])
    whole = errors_of_all_coordinates(optics, x, spots)[:6].reshape(3, 2, -1)
    left = numbers(whole)[:, optics.wanted] - h @ track.considered[:, :3].T
    of_attitude = np.arange(ATTITUDE_ERRORS) + FIELD_ERRORS - optics.wanted.start
    left = np.delete(left, of_attitude[of_attitude < left.shape[1]], axis=1)
    shown = left @ left.T + fresh @ fresh.T
    own = optics.spot_sigma[:3] ** 2
    s = h[:2] @ p @ h[:2].T + shown[:2, :2] + np.diag(np.sum(own, axis=0)) / 9.0 + turn * turns @ turns.T
    residual = numbers(spots[:3] - predicted)
    if residual[:2] @ np.linalg.solve(s, residual[:2]) > limits[1]:
        return False
    return bool(residual[2] ** 2 <= limits[0] * (2.0 * np.mean(own) / (along @ along) + turn + shown[2, 2]))
