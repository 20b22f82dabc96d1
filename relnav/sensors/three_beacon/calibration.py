"""A detector's calibration: the two-dimensional correction of its distortion, and how far it can be trusted.

    true = measured + sum over i + j <= order of c_ij u^i v^j,      u, v = (measured - centre) / half width

inside the box that the grid covered. Outside it polynomials run away: the correction is held at the box's edge, and
its uncertainty grows with the distance, at the slope that the correction has there.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from relnav.arrays import Matrix

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]


def exponents(order: int) -> list[tuple[int, int]]:
    """Powers (i, j) of u and v up to a total order, lowest first: 1, u, v, u^2, u v, v^2, ..."""
    return [(total - j, j) for total in range(order + 1) for j in range(total + 1)]


@lru_cache
def exponent_arrays(order: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """`exponents` as two arrays (p,)."""
    i, j = np.array(exponents(order), dtype=np.int64).T
    return i, j


def powers(u: Matrix, order: int) -> Matrix:
    """Terms u^i v^j (..., p) of points (..., 2), in the order of `exponents`."""
    i, j = exponent_arrays(order)
    each = u[..., None, :] ** np.arange(order + 1)[:, None]
    terms: Matrix = each[..., i, 0] * each[..., j, 1]
    return terms


@dataclass(frozen=True)
class Calibration:
    """Correction of a detector, from `relnav calibrate psd`.

    Attributes
    ----------
    order : int
        Total order of the polynomial.
    center_m, half_width_m : (2,)
        Box of measured positions in which it holds.
    correction_x_m, correction_y_m : (p,)
        Coefficients of both axes, in the order 1, u, v, u^2, u v, v^2, ...
    residual_sigma_m : float
        1-sigma of what it leaves, each axis, inside the box.
    rim_slope : float
        Slope (rms) of the correction along the box's edge: how fast it is wrong outside, m per m.
    points, noise_sigma_m : int, float
        Of the grid it was made from.
    """

    order: Annotated[int, Ge(0)]
    center_m: tuple[float, float]
    half_width_m: tuple[Positive, Positive]
    correction_x_m: tuple[float, ...]
    correction_y_m: tuple[float, ...]
    residual_sigma_m: NonNegative
    rim_slope: NonNegative
    points: Annotated[int, Ge(1)]
    noise_sigma_m: NonNegative

    def __post_init__(self) -> None:
        terms = len(exponents(self.order))
        for name in ("correction_x_m", "correction_y_m"):
            if len(getattr(self, name)) != terms:
                raise ValueError(
                    f"{name} has {terms} coefficients for order {self.order}; got {len(getattr(self, name))}"
                )

    def _scaled(self, spots_m: Matrix) -> tuple[Matrix, Matrix]:
        """Points scaled and held within the box, and their distances (..., 2) m outside it."""
        u = (np.asarray(spots_m, dtype=np.float64) - np.array(self.center_m)) / np.array(self.half_width_m)
        held = np.clip(u, -1.0, 1.0)
        return held, (u - held) * np.array(self.half_width_m)

    def correct(self, spots_m: Matrix) -> Matrix:
        """Spots (..., 2) m as they would be without distortion; NaN and infinity stay."""
        held, _ = self._scaled(spots_m)
        terms = powers(held, self.order)
        c = np.stack([self.correction_x_m, self.correction_y_m], axis=-1)
        corrected: Matrix = np.asarray(spots_m) + terms @ c
        return corrected

    def sigma(self, spots_m: Matrix) -> Matrix:
        """1-sigma (..., 2) m of what the correction leaves of measured spots (..., 2) m."""
        _, outside = self._scaled(spots_m)
        distance = np.linalg.norm(outside, axis=-1, keepdims=True)
        return np.broadcast_to(np.hypot(self.residual_sigma_m, self.rim_slope * distance), np.shape(spots_m)).copy()
