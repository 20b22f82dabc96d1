"""Central projection: the image of points in camera axes on the plane z = 1, and its derivative.

Camera axes are x right, y down, z boresight; focal length, principal point and distortion are the caller's. Compiled
loops write the same two lines out where they stand.
"""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack


def central_projection(points: ArrayLike) -> Matrix:
    """Image (..., 2), (x, y) / z, of points or directions (..., 3) in any unit; NaN where z is not positive."""
    p = np.asarray(points, dtype=np.float64)
    if p.shape[-1:] != (3,):
        raise ValueError(f"a point or direction has 3 components in its last axis; got shape {p.shape}")
    image: Matrix = p[..., :2] / np.where(p[..., 2:] > 0.0, p[..., 2:], np.nan)
    return image


def central_projection_jacobian(points: ArrayLike) -> Stack:
    """d(image)/d(point), (..., 2, 3): 1/z [1 0 -x/z; 0 1 -y/z] of points (..., 3); NaN where z is not positive."""
    p = np.asarray(points, dtype=np.float64)
    image, z = central_projection(p), np.where(p[..., 2:] > 0.0, p[..., 2:], np.nan)
    out = np.zeros((*p.shape[:-1], 2, 3))
    out[..., 0, 0] = out[..., 1, 1] = 1.0 / z[..., 0]
    out[..., :, 2] = -image / z
    return out
