"""From detector pixels to unit rays and back: pinhole with radial distortion."""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.geometry.distortion import undistort
from relnav.geometry.pinhole import central_projection


@kernel
def plane_point(x: float, y: float, focal: float, cx: float, cy: float, k1: float, k2: float) -> tuple[float, float]:
    """Undistorted point on the plane z = 1 of a spot (x, y) px.

    p = d (1 + k1 |d|^2 + k2 |d|^4) with d = (spot - principal) / f: the distortion polynomial leads from the detector
    to the ray, so that no iteration is needed here.
    """
    u, v = (x - cx) / focal, (y - cy) / focal
    r2 = u * u + v * v
    scale = 1.0 + r2 * (k1 + k2 * r2)
    return u * scale, v * scale


@kernel
def ray_and_variance(x: float, y: float, sigma: float) -> tuple[float, float, float, float]:
    """Unit ray of a point on the plane z = 1, and its variance about an axis normal to it for spot noise sigma (rad).

    Across the radius the plane's scale is cos t, along it cos^2 t; the mean of both variances is used.
    """
    cos2 = 1.0 / (1.0 + x * x + y * y)
    cosine = math.sqrt(cos2)
    return x * cosine, y * cosine, cosine, sigma * sigma * 0.5 * cos2 * (1.0 + cos2)


@entry
def _plane_points_into(spots: Matrix, focal: float, cx: float, cy: float, k1: float, k2: float, out: Matrix) -> None:
    """Write the plane points (n, 2) of spots (n, 2)."""
    for k in range(spots.shape[0]):
        out[k, 0], out[k, 1] = plane_point(spots[k, 0], spots[k, 1], focal, cx, cy, k1, k2)


@entry
def _rays_into(points: Matrix, sigma: float, u: Matrix, variance: Vector) -> None:
    """Write the rays (n, 3) of plane points (n, 2) and their variances."""
    for k in range(points.shape[0]):
        u[k, 0], u[k, 1], u[k, 2], variance[k] = ray_and_variance(points[k, 0], points[k, 1], sigma)


def plane_points(spots_px: Matrix, focal_px: float, principal_px: ArrayLike, distortion: ArrayLike) -> Matrix:
    """Undistorted points (n, 2) on the plane z = 1 of spots (n, 2) px: `plane_point` for each."""
    spots = np.ascontiguousarray(spots_px, dtype=np.float64)
    (cx, cy), (k1, k2) = np.asarray(principal_px, dtype=np.float64), np.asarray(distortion, dtype=np.float64)
    points = np.empty_like(spots)
    _plane_points_into(spots, float(focal_px), float(cx), float(cy), float(k1), float(k2), points)
    return points


def rays(points: Matrix) -> Matrix:
    """Unit vectors (n, 3) of points (n, 2) on the plane z = 1; camera axes x right, y down, z boresight."""
    u = np.empty((len(points), 3))
    _rays_into(np.ascontiguousarray(points), 0.0, u, np.empty(len(points)))
    return u


def ray_sigma(points: Matrix, spot_sigma_px: float, focal_px: float) -> Vector:
    """1-sigma (n,) rad of each ray about an axis normal to it, for white noise of a spot coordinate in px."""
    variance = np.empty(len(points))
    _rays_into(np.ascontiguousarray(points), float(spot_sigma_px / focal_px), np.empty((len(points), 3)), variance)
    sigma: Vector = np.sqrt(variance)
    return sigma


def project(
    directions: Matrix, focal_px: float, principal_px: ArrayLike = (0.0, 0.0), distortion: ArrayLike = (0.0, 0.0)
) -> Matrix:
    """Spots (n, 2) px of camera-frame directions (n, 3); inverse of `plane_points`.

    NaN behind the camera, and where the distortion polynomial folds back: no spot shows such a direction.
    """
    k1, k2 = np.asarray(distortion, dtype=np.float64)
    d, _ = undistort(central_projection(directions), np.array([k1, k2, 0.0, 0.0, 0.0]))
    spots: Matrix = focal_px * d + np.asarray(principal_px)
    return spots
