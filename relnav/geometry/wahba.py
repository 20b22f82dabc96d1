"""The rotation that best turns known directions into measured ones (Wahba 1965), with its covariance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix


@dataclass(frozen=True)
class WahbaSolution:
    """A least-squares rotation.

    Attributes
    ----------
    dcm : (3, 3)
        w = dcm @ v, proper.
    covariance : (3, 3)
        Of the attitude's error, axes of the measured frame, rad^2: dcm_true = exp(-[theta x]) dcm.
    chi2, dof : float, int
        Weighted sum of squared residuals, and its degrees of freedom 2 n - 3.
    """

    dcm: Matrix
    covariance: Matrix
    chi2: float
    dof: int


def solve_wahba(measured: ArrayLike, known: ArrayLike, sigma_rad: ArrayLike) -> WahbaSolution:
    """Weighted least-squares rotation of unit vectors, by singular values (Markley 1988).

    Parameters
    ----------
    measured, known : (n, 3)
        Unit vectors w_i and v_i of w = A v.
    sigma_rad : float or (n,)
        1-sigma of each measured direction, about each of the two axes normal to it.

    Raises
    ------
    ValueError
        For fewer than two vectors, vectors that are not unit, or all along one line.
    """
    w, v = np.asarray(measured, dtype=np.float64), np.asarray(known, dtype=np.float64)
    if w.shape != v.shape or w.ndim != 2 or w.shape[1] != 3 or len(w) < 2:
        raise ValueError(f"two equal arrays (n, 3) with n of 2 or more are expected; got {w.shape} and {v.shape}")
    for name, vectors in (("measured", w), ("known", v)):
        if not np.allclose(np.einsum("ij,ij->i", vectors, vectors), 1.0, atol=1e-6):
            raise ValueError(f"{name} holds unit vectors; some have another length or are not finite")
    weight = np.broadcast_to(1.0 / np.asarray(sigma_rad, dtype=np.float64) ** 2, (len(w),))
    information = np.sum(weight) * np.eye(3) - np.einsum("i,ij,ik->jk", weight, w, w)
    if np.linalg.eigvalsh(information)[0] < 1e-12 * float(np.sum(weight)):
        raise ValueError("all directions lie along one line: the rotation about it does not follow from them")
    left, _, right = np.linalg.svd(np.einsum("i,ij,ik->jk", weight, w, v))
    dcm = left @ np.diag([1.0, 1.0, np.linalg.det(left) * np.linalg.det(right)]) @ right
    chi2 = float(np.sum(weight[:, None] * (w - v @ dcm.T) ** 2))
    return WahbaSolution(dcm, np.linalg.inv(information), chi2, 2 * len(w) - 3)
