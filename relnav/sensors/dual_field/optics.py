"""From detector pixels to unit rays and back: pinhole with radial distortion."""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector


def plane_points(spots_px: Matrix, focal_px: float, principal_px: ArrayLike, distortion: ArrayLike) -> Matrix:
    """Undistorted points (n, 2) on the plane z = 1 of spots (n, 2) px.

    p = d (1 + k1 |d|^2 + k2 |d|^4) with d = (spot - principal) / f: the distortion polynomial leads from the detector
    to the ray, so that no iteration is needed here.
    """
    d = (np.asarray(spots_px, dtype=np.float64) - np.asarray(principal_px)) / focal_px
    r2 = np.einsum("ij,ij->i", d, d)
    k1, k2 = np.asarray(distortion, dtype=np.float64)
    points: Matrix = d * (1.0 + r2 * (k1 + k2 * r2))[:, None]
    return points


def rays(points: Matrix) -> Matrix:
    """Unit vectors (n, 3) of points (n, 2) on the plane z = 1; camera axes x right, y down, z boresight."""
    u = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    unit: Matrix = u / np.linalg.norm(u, axis=1, keepdims=True)
    return unit


def project(
    directions: Matrix, focal_px: float, principal_px: ArrayLike = (0.0, 0.0), distortion: ArrayLike = (0.0, 0.0)
) -> Matrix:
    """Spots (n, 2) px of camera-frame directions (n, 3) with z > 0; NaN for the others. Inverse of `plane_points`."""
    u = np.asarray(directions, dtype=np.float64)
    front = u[:, 2] > 0.0
    p = np.where(front[:, None], u[:, :2] / np.where(front, u[:, 2], 1.0)[:, None], np.nan)
    k1, k2 = np.asarray(distortion, dtype=np.float64)
    r = np.linalg.norm(p, axis=1)
    s = r.copy()  # |d|, from |d| (1 + k1 |d|^2 + k2 |d|^4) = |p| by Newton
    for _ in range(20):
        s2 = s * s
        s -= (s * (1.0 + s2 * (k1 + k2 * s2)) - r) / (1.0 + s2 * (3.0 * k1 + 5.0 * k2 * s2))
    scale = np.where(r > 0.0, s / np.where(r > 0.0, r, 1.0), 1.0)
    spots: Matrix = p * (focal_px * scale)[:, None] + np.asarray(principal_px)
    return spots


def ray_sigma(points: Matrix, spot_sigma_px: float, focal_px: float) -> Vector:
    """1-sigma (n,) rad of each ray about each axis normal to it, for white noise of a spot coordinate in px.

    Across the radius the plane's scale is cos t, along it cos^2 t; the mean of both variances is used.
    """
    cos2 = 1.0 / (1.0 + np.einsum("ij,ij->i", points, points))
    sigma: Vector = spot_sigma_px / focal_px * np.sqrt(0.5 * cos2 * (1.0 + cos2))
    return sigma
