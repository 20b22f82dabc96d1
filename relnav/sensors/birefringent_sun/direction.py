"""The best sun direction from two spots, which of them is which, and how well they agree."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Flags, Matrix, Stack, Vector, numbers
from relnav.codegen.kernel import entry
from relnav.geometry.linear_algebra import cholesky, solve_lower
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor
from relnav.sensors.birefringent_sun.spots import ordinary_scale, two_spots_into

PASSES = 6
NO_FIT = 1e300
WORK_ROWS = 11
"""Rows of four numbers of scratch that `fit_pair` needs."""
_SYMMETRIC = 1e-9


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


@entry
def fit_pair(spots: Vector, covariance: Matrix, first: int, plate: Vector, work: Matrix, out: Vector) -> bool:
    """Least-squares transverse direction of a pair of spots; False if the covariance is not positive definite.

    spots (4,) m and covariance (4, 4) m^2 of (x, y, x, y); the ordinary spot is that of coordinates `first` (0 or 2)
    and `first` + 1. Writes s_x, s_y, their covariance (xx, xy, yy) and chi2 into out (6,): NaN where no direction in
    front explains the spots. work (11, 4) is scratch. Gauss-Newton from the ordinary spot, on coordinates made
    independent by the covariance's Cholesky factor.
    """
    factor, J, along, across, miss, x = work[0:4], work[4:6].reshape((4, 2)), work[6], work[7], work[8], work[9]
    z = work[10]
    for i in range(4):
        p = (i + first) % 4
        z[i] = spots[p]
        for j in range(4):
            q = (j + first) % 4
            factor[i, j] = covariance[p, q]
            if abs(covariance[p, q] - covariance[q, p]) > _SYMMETRIC * math.sqrt(
                abs(covariance[p, p] * covariance[q, q])
            ):
                return False
    if not cholesky(factor, 0.0, factor):
        return False
    scale = ordinary_scale(z[0], z[1], plate)
    u, v = scale * z[0], scale * z[1]
    for count in range(PASSES + 1):
        two_spots_into(u, v, plate, x, J)
        for i in range(4):
            along[i], across[i], miss[i] = J[i, 0], J[i, 1], z[i] - x[i]
        a, c = solve_lower(factor, along), solve_lower(factor, across)
        out[5] = solve_lower(factor, miss)
        b, g, h = 0.0, 0.0, 0.0
        for i in range(4):
            b += along[i] * across[i]
            g += along[i] * miss[i]
            h += across[i] * miss[i]
        det = a * c - b * b
        if not det > 0.0:
            u, v, a, b, c, det = math.nan, math.nan, math.nan, math.nan, math.nan, 1.0
        if count < PASSES:
            u, v = u + (c * g - b * h) / det, v + (a * h - b * g) / det
    out[0], out[1], out[2], out[3], out[4] = u, v, c / det, -b / det, a / det
    return True


def fit_two_spots(sensor: BirefringentSunSensor, spots_m: ArrayLike, covariance_m2: ArrayLike) -> TwoSpotFit:
    """Least-squares u of spots (..., 2, 2) m, rows o, e, with covariance (4, 4) or (..., 4, 4) m^2.

    NaN where no direction in front explains the spots.

    Raises
    ------
    ValueError
        For a covariance that is not symmetric and positive definite.
    """
    spots = numbers("spots_m", spots_m)
    shape = spots.shape[:-2]
    pairs = np.array(spots).reshape(-1, 4)
    noise = np.array(np.broadcast_to(numbers("covariance_m2", covariance_m2), (*shape, 4, 4))).reshape(-1, 4, 4)
    work, out = np.empty((WORK_ROWS, 4)), np.empty((len(pairs), 6))
    for k in range(len(pairs)):
        if not fit_pair(pairs[k], noise[k], 0, sensor.plate, work, out[k]):
            raise ValueError(f"covariance_m2 is symmetric and positive definite; got {noise[k].tolist()}")
    covariance = out[:, [2, 3, 3, 4]]
    return TwoSpotFit(out[:, :2].reshape(*shape, 2), covariance.reshape(*shape, 2, 2), out[:, 5].reshape(shape))


def label_spots(sensor: BirefringentSunSensor, spots_m: ArrayLike, covariance_m2: ArrayLike) -> tuple[Flags, Vector]:
    """Whether pairs of spots (..., 2, 2) m stand in the order e, o, and how much worse the other order fits.

    Returns
    -------
    swapped : (...)
        True if the first row is the extraordinary spot.
    margin : (...)
        chi2 of the other order less that of the better one.
    """
    spots, noise = numbers("spots_m", spots_m), numbers("covariance_m2", covariance_m2)
    order = [2, 3, 0, 1]
    as_given = fit_two_spots(sensor, spots, noise).chi2
    exchanged = fit_two_spots(sensor, spots[..., ::-1, :], noise[..., order, :][..., order]).chi2
    given, other = (np.where(np.isfinite(chi2), chi2, NO_FIT) for chi2 in (as_given, exchanged))
    return other < given, np.abs(other - given)
