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


@kernel
def ray_information(
    u: float, v: float, x: float, y: float, focal: float, k1: float, k2: float, covariance: Matrix, out: Vector
) -> float:
    """Write the inverse covariance of a spot's ray, rad^-2, and return its largest variance, rad^2.

    It is K^T C^-1 K, K (2, 3) being the spot's displacement by that of the ray; out (6,): xx, xy, xz, yy, yz, zz.
    u, v: the spot's place on the detector over f, from the principal point; x, y: its undistorted point; covariance C
    (2, 2) px^2.
    """
    r2 = u * u + v * v
    scale, bend = 1.0 + r2 * (k1 + k2 * r2), 2.0 * (k1 + 2.0 * k2 * r2)
    a, b, d = scale + bend * u * u, bend * u * v, scale + bend * v * v  # of the point by u, v
    depth = 1.0 / math.sqrt(1.0 + x * x + y * y)
    over = focal / ((a * d - b * b) * depth)
    ax, ay, az = over * d, -over * b, over * (b * y - d * x)
    bx, by, bz = -over * b, over * a, over * (b * x - a * y)
    c00, c01, c11 = covariance[0, 0], 0.5 * (covariance[0, 1] + covariance[1, 0]), covariance[1, 1]
    det = c00 * c11 - c01 * c01
    i00, i01, i11 = c11 / det, -c01 / det, c00 / det
    out[0] = i00 * ax * ax + 2.0 * i01 * ax * bx + i11 * bx * bx
    out[1] = i00 * ax * ay + i01 * (ax * by + ay * bx) + i11 * bx * by
    out[2] = i00 * ax * az + i01 * (ax * bz + az * bx) + i11 * bx * bz
    out[3] = i00 * ay * ay + 2.0 * i01 * ay * by + i11 * by * by
    out[4] = i00 * ay * az + i01 * (ay * bz + az * by) + i11 * by * bz
    out[5] = i00 * az * az + 2.0 * i01 * az * bz + i11 * bz * bz
    half = 0.5 * (out[0] + out[3] + out[5])
    both = out[0] * out[3] - out[1] ** 2 + out[0] * out[5] - out[2] ** 2 + out[3] * out[5] - out[4] ** 2
    return float((half + math.sqrt(max(0.0, half * half - both))) / both)


@kernel
def turned_information(R: Matrix, row: Vector, out: Vector) -> None:
    """Write R P R^T (6,) for the symmetric P of a row (6,)."""
    for r in range(3):
        x = R[r, 0] * row[0] + R[r, 1] * row[1] + R[r, 2] * row[2]
        y = R[r, 0] * row[1] + R[r, 1] * row[3] + R[r, 2] * row[4]
        z = R[r, 0] * row[2] + R[r, 1] * row[4] + R[r, 2] * row[5]
        for c in range(r, 3):
            out[c if r == 0 else r + c + 1] = x * R[c, 0] + y * R[c, 1] + z * R[c, 2]


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
