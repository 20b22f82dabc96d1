"""Directions near a boresight as tangents, projection angles or the gimbal angles of a turntable, and the way between.

Frame: z is the boresight, s a unit vector toward the source, s_z > 0. Projection angles are tan(alpha) = s_x / s_z and
tan(beta) = s_y / s_z: angles between the boresight and the projections of s on the xz and yz planes. A two-axis
turntable reads gimbal angles instead. With the outer axis along x:

    s = (sin inner, cos inner sin outer, cos inner cos outer),   tan(alpha) = tan(inner) / cos(outer),   beta = outer

The two differ by 68 arcsec at (5, 5) deg and by 13.9 deg at (60, 60) deg: they must not be confused.
"""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector
from relnav.geometry.pinhole import central_projection


def tangents_from_direction(s: ArrayLike) -> Matrix:
    """(tan alpha, tan beta), (..., 2), of directions (..., 3): their central projection; NaN where s_z is not > 0."""
    return central_projection(s)


def direction_from_tangents(tangents: ArrayLike) -> Matrix:
    """Unit vectors (..., 3) of (tan alpha, tan beta) (..., 2)."""
    t = np.asarray(tangents, dtype=np.float64)
    if t.shape[-1:] != (2,):
        raise ValueError(f"tangents have 2 components (alpha, beta) in their last axis; got shape {t.shape}")
    s = np.concatenate([t, np.ones_like(t[..., :1])], axis=-1)
    unit: Matrix = s / np.linalg.norm(s, axis=-1, keepdims=True)
    return unit


def direction_from_angles(alpha_rad: ArrayLike, beta_rad: ArrayLike) -> Matrix:
    """Unit vectors (..., 3) of projection angles (...), rad, within 90 deg."""
    alpha, beta = np.broadcast_arrays(np.asarray(alpha_rad, dtype=np.float64), np.asarray(beta_rad, dtype=np.float64))
    if np.any(np.abs(alpha) >= 0.5 * np.pi) or np.any(np.abs(beta) >= 0.5 * np.pi):
        raise ValueError("projection angles lie within -90 and 90 deg; are these degrees where radians are expected?")
    return direction_from_tangents(np.stack([np.tan(alpha), np.tan(beta)], axis=-1))


def direction_from_gimbal(outer_rad: ArrayLike, inner_rad: ArrayLike, outer_axis: str = "x") -> Matrix:
    """Unit vectors (..., 3) of a turntable's angles (...), rad.

    outer_axis "x": the outer gimbal carries beta, as above. "y": it carries alpha, and x and y change places.
    """
    outer, inner = np.asarray(outer_rad, dtype=np.float64), np.asarray(inner_rad, dtype=np.float64)
    along, across, z = np.sin(inner) + 0.0 * outer, np.cos(inner) * np.sin(outer), np.cos(inner) * np.cos(outer)
    if outer_axis not in ("x", "y"):
        raise ValueError(f'outer_axis must be "x" or "y"; got {outer_axis!r}')
    return np.stack([along, across, z] if outer_axis == "x" else [across, along, z], axis=-1)


def gimbal_from_direction(s: ArrayLike, outer_axis: str = "x") -> tuple[Vector, Vector]:
    """Turntable angles (outer, inner), rad, of unit vectors (..., 3): where to drive it for a wanted direction."""
    s = np.asarray(s, dtype=np.float64)
    if outer_axis not in ("x", "y"):
        raise ValueError(f'outer_axis must be "x" or "y"; got {outer_axis!r}')
    along, across = (s[..., 0], s[..., 1]) if outer_axis == "x" else (s[..., 1], s[..., 0])
    return np.arctan2(across, s[..., 2]), np.arcsin(np.clip(along, -1.0, 1.0))


def direction_jacobian(tangents: ArrayLike) -> Matrix:
    """d(unit vector)/d(tan alpha, tan beta), (..., 3, 2): (I - s s^T) / |(t, 1)|, its first two columns."""
    t = np.asarray(tangents, dtype=np.float64)
    s = direction_from_tangents(t)
    projector = np.eye(3) - s[..., :, None] * s[..., None, :]
    jacobian: Matrix = (projector * s[..., 2, None, None])[..., :2]
    return jacobian
