"""Whether an image looks as the stated attitude says it should, for `engine="filterpy"`."""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection, central_projection_jacobian
from relnav.navigation.reference.beacon_rows import BeaconOptics


def attitude_is_credible(optics: BeaconOptics, limits: Vector, x: Vector, p: Matrix, spots: Matrix) -> bool:
    """Whether the mean of A, B and C, and the line from B to A, lie where an updated state (x, p) has them.

    True where no attitude is stated, or the fix is not the measurement. limits: chi-square, from one on.
    """
    if optics.method != "fix" or not optics.known:
        return True
    f, turn = optics.focal_length, optics.attitude_sigma**2
    points = (optics.beacons[:3] - x[:3]) @ optics.dcm.T - optics.lever
    predicted, slopes = f * central_projection(points), f * central_projection_jacobian(points)
    h = -np.mean(slopes @ optics.dcm, axis=0)
    turns = np.mean([slope @ cross_matrix(point) for slope, point in zip(slopes, points, strict=True)], axis=0)
    own = optics.spot_sigma[:3] ** 2 + optics.lasting[:3, None] ** 2
    s = h @ p[:3, :3] @ h.T + np.diag(np.sum(own, axis=0)) / 9.0 + turn * turns @ turns.T
    residual = np.mean(spots[:3] - predicted, axis=0)
    if residual @ np.linalg.solve(s, residual) > limits[1]:
        return False
    (x_said, y_said), (x_seen, y_seen) = predicted[0] - predicted[1], spots[0] - spots[1]
    length2 = x_said**2 + y_said**2
    roll = (x_said * y_seen - y_said * x_seen) / length2
    return bool(roll**2 <= limits[0] * (2.0 * np.mean(own) / length2 + turn))
