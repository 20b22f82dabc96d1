"""How the second field is folded onto the detector, and the angle between stars of different fields.

The lens looks along +z (field 0, the patent's field 100). A ray u on the detector came from s = u in field 0 and from
s = M u in field 1 (the patent's field 200), with M orthogonal: det -1 for one mirror, +1 for two (a prism).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.rotation import is_rotation


def mirror_fold(normal: ArrayLike) -> Matrix:
    """M = I - 2 n n^T (3, 3) of a plane mirror with unit normal n, either sign; the patent's is (1, 0, -1)/sqrt 2."""
    n = np.asarray(normal, dtype=np.float64)
    if n.shape != (3,) or abs(float(n @ n) - 1.0) > 1e-6:
        raise ValueError(f"a mirror's normal is a unit vector (3,); got {n.tolist()}")
    n = n / np.linalg.norm(n)
    fold: Matrix = np.eye(3) - 2.0 * np.outer(n, n)
    return fold


def check_fold(fold: ArrayLike) -> Matrix:
    """The fold matrix as an array (3, 3).

    Raises
    ------
    ValueError
        If it is not orthogonal to 1e-6.
    """
    M = np.asarray(fold, dtype=np.float64)
    if not (is_rotation(M) or is_rotation(-M)):
        raise ValueError(f"a fold is an orthogonal matrix (3, 3); got {M.tolist()}")
    return M


def fold_rays(u: Matrix, field: Codes, fold: Matrix) -> Matrix:
    """Directions (n, 3) that the rays u (n, 3) came from, given each one's field (n,), 0 or 1."""
    directions: Matrix = np.where(np.asarray(field)[:, None] == 1, u @ fold.T, u)
    return directions


def cross_field_cos(u_i: Vector, u_j: Vector, fold: Matrix) -> Vector:
    """Cosine of the angle between two stars of different fields, exact: u_i^T M u_j, i in field 0, j in field 1.

    For a mirror it is u_i.u_j - 2 (n.u_i)(n.u_j), symmetric in i and j: who is in which field does not matter.
    """
    cosine: Vector = np.einsum("...i,ij,...j->...", u_i, fold, u_j)
    return cosine


def patent_cross_angles(alpha_rad: ArrayLike) -> tuple[Vector, Vector]:
    """The patent's angles between stars of different fields, 90 deg -+ alpha, alpha the angle on the detector.

    Wrong for a mirror, kept for the record: a mirror gives one value, and in the plane of the fold it is 90 deg minus
    the sum of the two field angles, not their difference.
    """
    alpha = np.asarray(alpha_rad, dtype=np.float64)
    return 0.5 * math.pi - alpha, 0.5 * math.pi + alpha
