"""Lens distortion of the normalised image plane, Brown and Conrady's five coefficients, and its inverse.

With r^2 = x^2 + y^2 and k = (k1, k2, p1, p2, k3), in the order of OpenCV's camera model,

    x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y.

The Jacobian is symmetric.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel

_PASSES = 30
_SETTLED = 1e-13
_REACHED = 1e-10


@kernel
def distort_point(x: float, y: float, k: Vector) -> tuple[float, float, float, float, float]:
    """Distorted image (x_d, y_d) of a normalised point, and d(x_d)/dx, d(x_d)/dy = d(y_d)/dx, d(y_d)/dy."""
    k1, k2, p1, p2, k3 = k[0], k[1], k[2], k[3], k[4]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d(radial)/dx = slope x
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
        slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y,
        radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@kernel
def undistort_point(u: float, v: float, k: Vector) -> tuple[float, float, float, float, float]:
    """Normalised point (x, y) of a distorted image (u, v), and the three entries of the Jacobian there.

    Newton from the image itself. NaN where it does not settle: beyond the radius at which the polynomial folds back, no
    point has such an image.
    """
    x, y = u, v
    for _ in range(_PASSES):
        reached_x, reached_y, xx, xy, yy = distort_point(x, y, k)
        miss_x, miss_y, det = reached_x - u, reached_y - v, xx * yy - xy * xy
        if det == 0.0:
            return math.nan, math.nan, math.nan, math.nan, math.nan
        x, y = x - (yy * miss_x - xy * miss_y) / det, y - (xx * miss_y - xy * miss_x) / det
        if not (abs(miss_x) > _SETTLED or abs(miss_y) > _SETTLED):
            break
    reached_x, reached_y, xx, xy, yy = distort_point(x, y, k)
    if not (abs(reached_x - u) < _REACHED and abs(reached_y - v) < _REACHED and xx > 0.0):
        return math.nan, math.nan, math.nan, math.nan, math.nan
    return x, y, xx, xy, yy


def distort(xy: Matrix, k: Vector) -> tuple[Matrix, Stack]:
    """Distorted image (n, 2) of normalised points (n, 2), and its Jacobian (n, 2, 2)."""
    found = np.array([distort_point(x, y, k) for x, y in xy.tolist()]).reshape(-1, 5)
    return found[:, :2], found[:, [2, 3, 3, 4]].reshape(-1, 2, 2)


def undistort(image: Matrix, k: Vector) -> tuple[Matrix, Stack]:
    """Normalised points (n, 2) of a distorted image (n, 2), and the Jacobian d(image)/d(points) there (n, 2, 2).

    NaN for an image that no point has.
    """
    found = np.array([undistort_point(x, y, k) for x, y in image.tolist()]).reshape(-1, 5)
    return found[:, :2], found[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
