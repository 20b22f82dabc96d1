"""Lens distortion of the normalised image plane, Brown and Conrady's five coefficients, and its inverse.

With r^2 = x^2 + y^2 and k = (k1, k2, p1, p2, k3), in the order of OpenCV's camera model,

    x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
    y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y.
"""

import numpy as np

from relnav.arrays import Matrix, Stack, Vector

_PASSES = 30
_SETTLED = 1e-13


def distort(xy: Matrix, k: Vector) -> tuple[Matrix, Stack]:
    """Distorted image (n, 2) of normalised points (n, 2), and its Jacobian (n, 2, 2)."""
    x, y = xy[:, 0], xy[:, 1]
    k1, k2, p1, p2, k3 = (float(value) for value in k)
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))  # d(radial)/dx = slope x
    image = np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )
    jacobian = np.empty((len(xy), 2, 2))
    jacobian[:, 0, 0] = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    jacobian[:, 0, 1] = jacobian[:, 1, 0] = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    jacobian[:, 1, 1] = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    return image, jacobian


def undistort(image: Matrix, k: Vector) -> tuple[Matrix, Stack]:
    """Normalised points (n, 2) of a distorted image (n, 2), and the Jacobian d(image)/d(points) there (n, 2, 2).

    Newton from the image itself. NaN where it does not settle: beyond the radius at which the polynomial folds back, no
    point has such an image.
    """
    xy = np.array(image, dtype=np.float64)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        for _ in range(_PASSES):
            reached, jacobian = distort(xy, k)
            miss = reached - image
            det = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
            step_x = (jacobian[:, 1, 1] * miss[:, 0] - jacobian[:, 0, 1] * miss[:, 1]) / det
            step_y = (jacobian[:, 0, 0] * miss[:, 1] - jacobian[:, 1, 0] * miss[:, 0]) / det
            xy -= np.stack([step_x, step_y], axis=-1)
            if not (np.abs(miss) > _SETTLED).any():
                break
        reached, jacobian = distort(xy, k)
        lost = ~(np.abs(reached - image).max(axis=-1) < 1e-10) | ~(jacobian[:, 0, 0] > 0.0)
    xy[lost], jacobian[lost] = np.nan, np.nan
    return xy, jacobian
