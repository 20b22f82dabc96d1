"""A detector's calibration: the two-dimensional correction of its distortion, and how far it can be trusted.

    true = measured + sum over i + j <= order of c_ij u^i v^j,      u, v = (measured - centre) / half width

inside the box that the grid covered. Outside it polynomials run away: the correction is held at the box's edge, and
its uncertainty grows with the distance, at the slope that the correction has there.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import ArrayLike, NDArray

from relnav.arrays import Matrix, Vector, numbers
from relnav.codegen.kernel import kernel

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]

NO_DETECTOR_M = 1e3
"""Spots so far out, and infinite ones, are left alone."""
STEEPEST = 1.0
"""Slope of a correction, at which two spots are taken for one: a detector's is a tenth or so."""
SLOPE_CELLS = 64
"""Of the box along an axis, in which the slope is looked at: four for each of the sixteen orders of a correction."""
MOST_STEPS = 50
"""Of the inverse; each leaves of the error the correction's slope, a tenth or so."""


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


@kernel
def _correct(table: Matrix, order: int, spots: Matrix, sigma: Vector) -> None:
    """Correct spots (n, 2) m in place, and write what is left of each, 1-sigma m, into sigma (n,).

    table: centre, half width, (residual, slope at the rim), then the coefficients of both axes, a row a term.
    """
    for k in range(spots.shape[0]):
        if not (abs(spots[k, 0]) < NO_DETECTOR_M and abs(spots[k, 1]) < NO_DETECTOR_M):
            if spots[k, 0] != spots[k, 0] or spots[k, 1] != spots[k, 1]:  # the correction of one needs both
                spots[k, 0], spots[k, 1] = math.nan, math.nan
            sigma[k] = table[2, 0]
            continue
        u = (spots[k, 0] - table[0, 0]) / table[1, 0]
        v = (spots[k, 1] - table[0, 1]) / table[1, 1]
        held_u, held_v = max(-1.0, min(1.0, u)), max(-1.0, min(1.0, v))
        x, y = 0.0, 0.0
        for j in range(order, -1, -1):  # Horner in v of Horner in u
            x_row, y_row = 0.0, 0.0
            for i in range(order - j, -1, -1):
                term = 3 + (i + j) * (i + j + 1) // 2 + j
                x_row = x_row * held_u + table[term, 0]
                y_row = y_row * held_u + table[term, 1]
            x = x * held_v + x_row
            y = y * held_v + y_row
        outside_u, outside_v = (u - held_u) * table[1, 0], (v - held_v) * table[1, 1]
        distance2 = outside_u * outside_u + outside_v * outside_v
        sigma[k] = math.sqrt(table[2, 0] * table[2, 0] + table[2, 1] * table[2, 1] * distance2)
        spots[k, 0] += x
        spots[k, 1] += y


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
        terms = (self.order + 1) * (self.order + 2) // 2
        for name in ("correction_x_m", "correction_y_m"):
            if len(getattr(self, name)) != terms:
                raise ValueError(
                    f"{name} has {terms} coefficients for order {self.order}; got {len(getattr(self, name))}"
                )
        slope, (x, y) = self._steepest()
        if not slope < STEEPEST:
            raise ValueError(
                f"the correction diverges at ({x * 1e3:.2f}, {y * 1e3:.2f}) mm: it changes by {slope:.3g} times the "
                f"way of the spot there, and less than {STEEPEST:g} is expected; calibrate again, with points there"
            )

    def _steepest(self) -> tuple[float, tuple[float, float]]:
        """The largest change of the correction over a cell's side, per m, and where, m; infinity if it overflows."""
        line = np.linspace(-1.0, 1.0, SLOPE_CELLS + 1)
        i, j = exponent_arrays(self.order)
        table = np.zeros((self.order + 1, self.order + 1, 2))
        table[i, j] = np.stack([self.correction_x_m, self.correction_y_m], axis=-1)
        with np.errstate(over="ignore", invalid="ignore"):
            field = np.polynomial.polynomial.polygrid2d(line, line, table)  # (2, u, v)
            along = [
                np.sqrt((np.diff(field, axis=1 + axis) ** 2).sum(axis=0)) / (half * (line[1] - line[0]))
                for axis, half in enumerate(self.half_width_m)
            ]
        slopes = np.maximum(along[0][:, :-1], along[1][:-1])
        slopes[~np.isfinite(slopes)] = math.inf
        worst = np.unravel_index(np.argmax(slopes), slopes.shape)
        at = np.array(self.center_m) + np.array(self.half_width_m) * line[list(worst)]
        return float(slopes[worst]), (float(at[0]), float(at[1]))

    @cached_property
    def _table(self) -> Matrix:
        box = [self.center_m, self.half_width_m, (self.residual_sigma_m, self.rim_slope)]
        return np.concatenate([np.array(box), np.stack([self.correction_x_m, self.correction_y_m], axis=-1)])

    def corrected(self, spots_m: ArrayLike) -> tuple[Matrix, Matrix]:
        """Spots without distortion, and how well.

        Parameters
        ----------
        spots_m : (..., 2)
            As measured, m.

        Returns
        -------
        (..., 2)
            As they would be without distortion; infinity stays, and with one coordinate NaN both are.
        (...)
            1-sigma of what is left of each coordinate, m: the residual inside the box, more outside.
        """
        spots = numbers("spots_m", spots_m)
        out = np.array(spots, order="C")
        sigma = np.empty(spots.shape[:-1])
        if spots.shape[-1:] == (2,):
            _correct(self._table, self.order, out.reshape(-1, 2), sigma.reshape(-1))
        return out, sigma

    def correct(self, spots_m: ArrayLike) -> Matrix:
        """Spots (..., 2) m as they would be without distortion."""
        return self.corrected(spots_m)[0]

    def distorted(self, true_m: ArrayLike) -> Matrix:
        """Where spots that are at (..., 2) m are measured: what `correct` takes there."""
        true = numbers("true_m", true_m)
        measured: Matrix = true.copy()
        for _ in range(MOST_STEPS):
            moved = true - self.correct(measured)
            measured += moved
            if not (np.abs(moved) > 1e-12).any():
                break
        return measured
