"""The best sun direction from two spots, which of them is which, and how well they agree."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Flags, Matrix, Stack, Vector
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor
from relnav.sensors.birefringent_sun.spots import spots_jacobian, spots_of_transverse, transverse_from_ordinary

PASSES = 6
NO_FIT = 1e300


@dataclass(frozen=True)
class TwoSpotFit:
    """Transverse directions fitted to pairs of spots.

    Attributes
    ----------
    u, covariance : (..., 2), (..., 2, 2)
        (s_x, s_y) and its covariance.
    chi2 : (...)
        Of the four coordinates about the fit, two degrees of freedom: the spots' agreement.
    """

    u: Matrix
    covariance: Stack
    chi2: Vector


def fit_two_spots(sensor: BirefringentSunSensor, spots_m: ArrayLike, covariance_m2: ArrayLike) -> TwoSpotFit:
    """Least-squares u of spots (..., 2, 2) m, rows o, e, with covariance (4, 4) or (..., 4, 4) m^2.

    Gauss-Newton from the ordinary spot. NaN where no direction in front explains the spots.
    """
    spots = np.asarray(spots_m, dtype=np.float64)
    weight = np.linalg.inv(np.asarray(covariance_m2, dtype=np.float64))
    u = transverse_from_ordinary(sensor, spots[..., 0, :])
    for _ in range(PASSES):
        J, miss = spots_jacobian(sensor, u), _miss(sensor, spots, u)
        JtW = np.swapaxes(J, -1, -2) @ weight
        u = u + (_inverse(JtW @ J) @ (JtW @ miss[..., None]))[..., 0]
    J, miss = spots_jacobian(sensor, u), _miss(sensor, spots, u)
    covariance = _inverse(np.swapaxes(J, -1, -2) @ weight @ J)
    chi2 = np.squeeze(miss[..., None, :] @ weight @ miss[..., None], axis=(-1, -2))
    return TwoSpotFit(u, covariance, chi2)


def label_spots(sensor: BirefringentSunSensor, spots_m: ArrayLike, covariance_m2: ArrayLike) -> tuple[Flags, Vector]:
    """Whether pairs of spots (..., 2, 2) m stand in the order e, o, and how much worse the other order fits.

    Returns
    -------
    swapped : (...)
        True if the first row is the extraordinary spot.
    margin : (...)
        chi2 of the other order less that of the better one.
    """
    spots = np.asarray(spots_m, dtype=np.float64)
    as_given = fit_two_spots(sensor, spots, covariance_m2).chi2
    exchanged = fit_two_spots(sensor, spots[..., ::-1, :], covariance_m2).chi2
    given, other = (np.where(np.isfinite(chi2), chi2, NO_FIT) for chi2 in (as_given, exchanged))
    return other < given, np.abs(other - given)


def direction_covariance(u: Matrix, covariance: Matrix) -> Matrix:
    """Covariance (..., 3, 3) of unit vectors, rank 2, from that of u: D P D^T, D = (I; -u^T / s_z)."""
    z = np.sqrt(1.0 - np.sum(u**2, axis=-1))
    D = np.zeros((*u.shape[:-1], 3, 2))
    D[..., 0, 0] = D[..., 1, 1] = 1.0
    D[..., 2, :] = -u / z[..., None]
    turned: Matrix = D @ covariance @ np.swapaxes(D, -1, -2)
    return turned


def _miss(sensor: BirefringentSunSensor, spots: Stack, u: Matrix) -> Matrix:
    miss: Matrix = (spots - spots_of_transverse(sensor, u)).reshape(*u.shape[:-1], 4)
    return miss


def _inverse(A: Stack) -> Stack:
    """Inverse of (..., 2, 2) matrices; NaN where there is none, without an exception."""
    a, b, c, d = A[..., 0, 0], A[..., 0, 1], A[..., 1, 0], A[..., 1, 1]
    det = a * d - b * c
    adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    inverse: Stack = adjugate / np.where(det > 0.0, det, np.nan)[..., None, None]
    return inverse
