"""From an inertial attitude to one in the target's orbital frame: what a star sensor tells a navigation filter."""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix
from relnav.geometry.frames import DCM_LVLH_CCSDS_FROM_RSW


def dcm_lvlh_from_inertial(position: ArrayLike, velocity: ArrayLike) -> Matrix:
    """Axes of `lvlh_ccsds` at inertial states: v_lvlh = dcm @ v_inertial, (..., 3, 3).

    Parameters
    ----------
    position, velocity : (..., 3)
        Target's inertial position and velocity, any units: x_rsw is along r, z_rsw along r x v.

    Raises
    ------
    ValueError
        If a state has no orbital plane.
    """
    r, v = np.asarray(position, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
    if r.shape != v.shape or r.shape[-1:] != (3,):
        raise ValueError(f"positions and velocities have equal shapes (..., 3); got {r.shape} and {v.shape}")
    h = np.cross(r, v)
    sizes = np.linalg.norm(r, axis=-1, keepdims=True), np.linalg.norm(h, axis=-1, keepdims=True)
    if not np.all(np.isfinite(h)) or not np.all(sizes[1] > 1e-9 * sizes[0] * np.linalg.norm(v, axis=-1, keepdims=True)):
        raise ValueError("a state without an orbital plane: position and velocity must be finite and not parallel")
    x, z = r / sizes[0], h / sizes[1]
    rsw: Matrix = np.stack([x, np.cross(z, x), z], axis=-2)
    dcm: Matrix = DCM_LVLH_CCSDS_FROM_RSW @ rsw
    return dcm


def dcm_cam_from_lvlh(
    dcm_star_from_icrs: ArrayLike, position: ArrayLike, velocity: ArrayLike, dcm_cam_from_star: ArrayLike | None = None
) -> Matrix:
    """A camera's attitude in `lvlh_ccsds` from the inertial attitude of a star sensor, (..., 3, 3).

    Parameters
    ----------
    dcm_star_from_icrs : (..., 3, 3)
        Of the star sensor (`StarSolution.dcm_cam_from_icrs`).
    position, velocity : (..., 3)
        Target's inertial state at the same times, ICRS axes.
    dcm_cam_from_star : (3, 3), optional
        Mounting of the camera against the star sensor; the same axes if left out.
    """
    star = np.asarray(dcm_star_from_icrs, dtype=np.float64)
    mounting = np.eye(3) if dcm_cam_from_star is None else np.asarray(dcm_cam_from_star, dtype=np.float64)
    lvlh = dcm_lvlh_from_inertial(position, velocity)
    dcm: Matrix = mounting @ star @ np.swapaxes(lvlh, -1, -2)
    return dcm
