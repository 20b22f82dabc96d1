"""Refraction of rays at planes and spheres, in vectors."""

import numpy as np

from relnav.arrays import Matrix, Vector


def refract(d: Matrix, normal: Matrix, mu: float) -> Matrix:
    """Directions (..., 3) after a surface: Snell's law in vectors.

    Parameters
    ----------
    d, normal : (..., 3)
        Unit directions of the rays, and unit normals with d . normal > 0.
    mu : float
        Index before over index after.

    Returns
    -------
    (..., 3) unit; NaN for total reflection.

    Notes
    -----
    d' = mu d + (sqrt(1 - mu^2 (1 - c^2)) - mu c) n,  c = d . n
    """
    c = np.sum(d * normal, axis=-1, keepdims=True)
    inside = 1.0 - mu * mu * (1.0 - c * c)
    root = np.sqrt(np.where(inside >= 0.0, inside, np.nan))
    turned: Matrix = mu * d + (root - mu * c) * normal
    return turned


def leave_sphere(p: Matrix, d: Matrix, centre: Vector, radius: float) -> Matrix:
    """Points (..., 3) where rays from inside a sphere, p along unit d, meet it; NaN if p lies outside and misses."""
    q = p - centre
    b = np.sum(q * d, axis=-1, keepdims=True)
    inside = b * b - np.sum(q * q, axis=-1, keepdims=True) + radius * radius
    root = np.sqrt(np.where(inside >= 0.0, inside, np.nan))
    hit: Matrix = p + (root - b) * d
    return hit
