"""What the ray model leaves: a smooth field of spot shifts, as a penalised spline whose stiffness the data choose.

P-spline (Eilers and Marx 1996): a bicubic spline with more knots than needed, held by a penalty on its bending,

    minimise  sum |shift - f|^2 + stiffness (N / m^2) (|f_uu|^2 + 2 |f_uv|^2 + |f_vv|^2)

with second differences of the coefficients for derivatives. The stiffness is chosen by cross-validation; so is
whether there is a spline at all. Where there are no data it continues what surrounds them.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Vector

INTERIOR_KNOTS = 14
STIFFNESS = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
FOLDS = 5
FEWEST_POINTS = 25
ORDER = 4  # cubic
SIZE = INTERIOR_KNOTS + ORDER


@dataclass(frozen=True)
class SplineResidual:
    """Spot shift (px) as a bicubic spline of the spot.

    Attributes
    ----------
    knots_x, knots_y : (m + 4,)
        Knots, px, with the ends four times.
    coefficients : (m, m, 2)
        Of the shift in x and y.
    """

    knots_x: Vector
    knots_y: Vector
    coefficients: Matrix

    def shift_px(self, spots_px: Matrix) -> Matrix:
        """Shift (N, 2) at spots (N, 2); beyond the data's box that of its edge."""
        bx, by = _basis(self.knots_x, spots_px[:, 0]), _basis(self.knots_y, spots_px[:, 1])
        shift: Matrix = np.einsum("ni,nj,ijk->nk", bx, by, self.coefficients, optimize=True)
        return shift


@dataclass(frozen=True)
class SplineData:
    """Points of which some can be held out: knots of their spline, its B-splines there (N, m^2), normal matrix."""

    knots: list[Vector]
    design: Matrix
    normal: Matrix

    @classmethod
    def under(cls, spline: SplineResidual, spots_px: Matrix) -> "SplineData":
        """Of the points that a spline was fitted to."""
        knots = [spline.knots_x, spline.knots_y]
        design = _design(knots, spots_px)
        return cls(knots, design, design.T @ design)

    def without(self, out: Flags, shifts_px: Matrix, stiffness: float) -> SplineResidual:
        """The spline through shifts (N, 2) of all points but those of `out` (N,)."""
        held, seen = self.design[out], ~out
        right = self.design[seen].T @ shifts_px[seen]
        return _solved(self.knots, self.normal - held.T @ held, right, stiffness, int(seen.sum()))


@dataclass(frozen=True)
class ResidualChoice:
    """The spline that cross-validation chose, and what was tried.

    Attributes
    ----------
    spline : SplineResidual or None
        None: no spline is better.
    stiffness : float
        The one chosen, a factor of its curvature in the sum of squares; infinity: no spline.
    tried : dict
        Stiffness to the mean square of one held-out residual coordinate, px^2.
    """

    spline: SplineResidual | None
    stiffness: float
    tried: dict[float, float]

    @property
    def held_out_px2(self) -> float:
        """Mean square of one held-out coordinate with the chosen spline."""
        return self.tried[self.stiffness]


def fit_spline(spots_px: Matrix, shifts_px: Matrix, stiffness: float) -> SplineResidual:
    """Penalised bicubic spline of shifts (N, 2) over spots (N, 2)."""
    knots = [_knots(spots_px[:, axis]) for axis in range(2)]
    normal, right = _normal(knots, spots_px, shifts_px)
    return _solved(knots, normal, right, stiffness, len(spots_px))


def choose_spline(spots_px: Matrix, shifts_px: Matrix, rng: np.random.Generator) -> ResidualChoice:
    """Choose the stiffness, or no spline, by cross-validation: the stiffest within one standard error of the best."""
    n = len(spots_px)
    squares = {np.inf: np.mean(shifts_px**2, axis=1)}
    if n >= FEWEST_POINTS:
        squares |= _held_out(spots_px, shifts_px, rng.permutation(n) % FOLDS)
    tried = {stiffness: float(np.mean(square)) for stiffness, square in squares.items()}
    best = min(tried, key=lambda stiffness: tried[stiffness])
    chosen = best
    for stiffness in sorted(tried, reverse=True):
        worse = squares[stiffness] - squares[best]
        if np.mean(worse) <= np.std(worse) / np.sqrt(n):
            chosen = stiffness
            break
    spline = fit_spline(spots_px, shifts_px, chosen) if np.isfinite(chosen) else None
    return ResidualChoice(spline, chosen, tried)


def _held_out(spots_px: Matrix, shifts_px: Matrix, fold: Codes) -> dict[float, Vector]:
    """For every stiffness: mean square of both coordinates at every point, (N,), from splines that have not seen it."""
    knots = [_knots(spots_px[:, axis]) for axis in range(2)]
    parts = [_normal(knots, spots_px[fold == k], shifts_px[fold == k]) for k in range(FOLDS)]
    normal, right = sum(part[0] for part in parts), sum(part[1] for part in parts)
    out = {stiffness: np.empty(len(spots_px)) for stiffness in STIFFNESS}
    for k in range(FOLDS):
        test = fold == k
        seen = int((~test).sum())
        for stiffness, squares in out.items():
            spline = _solved(knots, normal - parts[k][0], right - parts[k][1], stiffness, seen)
            squares[test] = np.mean((shifts_px[test] - spline.shift_px(spots_px[test])) ** 2, axis=1)
    return out


def _normal(knots: list[Vector], spots_px: Matrix, shifts_px: Matrix) -> tuple[Matrix, Matrix]:
    """Normal matrix (m^2, m^2) and right side (m^2, 2) of the data alone."""
    design = _design(knots, spots_px)
    return design.T @ design, design.T @ shifts_px


def _design(knots: list[Vector], spots_px: Matrix) -> Matrix:
    """Products (N, m^2) of the B-splines along x and y."""
    bx, by = _basis(knots[0], spots_px[:, 0]), _basis(knots[1], spots_px[:, 1])
    return (bx[:, :, None] * by[:, None, :]).reshape(len(spots_px), SIZE * SIZE)


def _solved(knots: list[Vector], normal: Matrix, right: Matrix, stiffness: float, points: int) -> SplineResidual:
    first, second = np.diff(np.eye(SIZE), axis=0), np.diff(np.eye(SIZE), n=2, axis=0)
    slope, bend, one = first.T @ first, second.T @ second, np.eye(SIZE)
    penalty = np.kron(bend, one) + 2.0 * np.kron(slope, slope) + np.kron(one, bend)
    weight = stiffness * points / SIZE**2
    coefficients = np.linalg.solve(normal + weight * penalty, right)
    return SplineResidual(knots[0], knots[1], coefficients.reshape(SIZE, SIZE, 2))


def _knots(values: Vector) -> Vector:
    low, high = float(values.min()), float(values.max())
    inner = np.linspace(low, high, INTERIOR_KNOTS + 2)
    return np.concatenate([[low] * (ORDER - 1), inner, [high] * (ORDER - 1)])


def _basis(knots: Vector, values: Vector) -> Matrix:
    """Values (N, m) of all B-splines; values beyond the ends count as at the end."""
    from scipy.interpolate import BSpline

    inside = np.clip(values, knots[0], knots[-1])
    dense: Matrix = BSpline.design_matrix(inside, knots, ORDER - 1).toarray()
    return dense
