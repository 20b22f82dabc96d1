"""The correction of a fitted distortion: its inverse, as a polynomial of the measured position.

    measured = true + error(true)    is solved for the true position of every point of a fine grid of measured ones,

over the whole box that the calibration is for, corners without points included. That box reaches a little beyond the
one of the true positions: there the fit is followed; if it folds over, its tangent from the edge is; and if that does,
the edge's error is held. Polynomials of rising order are fitted
to what comes out; the one that is wrong by least is kept, and by how much it is wrong is part of what is left.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix
from relnav.sensors.three_beacon.calibration import STEEPEST, powers
from relnav.sensors.three_beacon.smooth_figure import Box

SHARE = 0.02
"""Of the residual that the inverse may be wrong by: its order is raised until it is."""
HIGHEST_ORDER = 16
SIDE = 3 * HIGHEST_ORDER
"""Of the grid of measured positions: three points for every order, so that nothing swings between them."""
STEPS = 60
"""Each leaves of the error the slope of what is not affine, a tenth or so; 60 of a slope of 0.7 leave 1e-9."""
SOLVED = 1e-9
"""Of the grid's half width: some picometres."""
TANGENT = 1e-4
"""Of the half width: the step of its difference, as small as rounding allows to ten digits."""
MOST_TIMES = 4.0
"""The largest error among the points: a corner without points may need more than they show, but not many times more."""
LARGEST_SIGMAS = 3.0
"""Nowhere in the box is the inverse wrong by more than this many of the residual that is stated."""


@dataclass(frozen=True)
class Inverse:
    """Order, coefficients (p, 2) m, and 1-sigma of what is wrong with them, each axis, m."""

    order: int
    coefficients: Matrix
    wrong_m: float


def invert(
    error: Callable[[Matrix], Matrix], box: Box, seen: Box, least: int, residual_m: float, raw_max_m: float
) -> Inverse:
    """The correction in the box `seen` of measured positions, of the distortion that was fitted in `box`.

    Parameters
    ----------
    error : callable
        Error (n, 2) m at true positions (n, 2) m.
    box, seen : Box
        Of the true and the measured positions.
    least : int
        Lowest order that is tried.
    residual_m : float
        1-sigma of what the distortion's estimate is wrong by.
    raw_max_m : float
        Largest error among the points.

    Raises
    ------
    ValueError
        If the distortion has no inverse in the box, or one that is far above the errors of the points.
    """
    measured = seen.grid(SIDE)
    for beyond in (error, _held(error, box, True), _held(error, box, False)):
        correction = _solved(beyond, box, measured) - measured
        if np.abs(correction).max() <= MOST_TIMES * raw_max_m and _slope(correction, seen) < STEEPEST:
            break
    _check(correction, measured, raw_max_m)
    v, found = seen.scaled(measured), []
    for order in range(least, HIGHEST_ORDER + 1):
        terms = powers(v, order)
        coefficients: Matrix = np.asarray(np.linalg.lstsq(terms, correction)[0], dtype=np.float64)
        off = np.abs(terms @ coefficients - correction)
        wrong = max(float(np.sqrt(np.mean(off**2))), float(off.max()) / LARGEST_SIGMAS)
        found.append(Inverse(order, coefficients, wrong))
        if wrong < SHARE * residual_m:
            break
    return min(found, key=lambda one: one.wrong_m)


def _held(error: Callable[[Matrix], Matrix], box: Box, tangent: bool) -> Callable[[Matrix], Matrix]:
    """The error with that of the edge beyond the box, and its tangent if wanted."""

    def extended(true: Matrix) -> Matrix:
        held = box.center_m + box.half_m * np.clip(box.scaled(true), -1.0, 1.0)
        out = error(held)
        for axis in range(2 if tangent else 0):
            step = np.zeros(2)
            step[axis] = TANGENT * box.half_m[axis]
            slope = (error(held + step) - error(held - step)) / (2.0 * step[axis])
            out += slope * (true - held)[:, axis, None]
        return out

    return extended


def _slope(correction: Matrix, seen: Box) -> float:
    """The largest change of a correction (SIDE^2, 2) m over a cell's side, per m."""
    field, cell = correction.reshape(SIDE, SIDE, 2), 2.0 * seen.half_m / (SIDE - 1)  # y, x, axis
    along = [np.hypot(*np.diff(field, axis=1 - axis).T).max() / cell[axis] for axis in range(2)]
    return float(max(along))


def _solved(error: Callable[[Matrix], Matrix], box: Box, measured: Matrix) -> Matrix:
    """True positions (n, 2) m of measured ones; NaN where none is found.

    Steps by the inverse of the affine part, so that a gain far from one is no matter.
    """
    known = box.grid(SIDE)
    affine = np.column_stack([np.ones(len(known)), known - box.center_m])
    back = np.linalg.inv(np.linalg.lstsq(affine, known + error(known))[0][1:])
    true = measured.copy()
    close = SOLVED * float(box.half_m.max())
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(STEPS):
            step = (measured - true - error(true)) @ back
            true += step
            if not (np.abs(step) > close).any():
                break
        true[~(np.abs(step) <= close).all(axis=1)] = math.nan
    return true


def _check(correction: Matrix, measured: Matrix, raw_max_m: float) -> None:
    """Refuse a correction that the points do not bear out."""
    size = np.abs(correction).max(axis=1)
    size[np.isnan(size)] = math.inf
    worst = int(np.argmax(size))
    if size[worst] > MOST_TIMES * raw_max_m:
        x, y = measured[worst] * 1e3
        what = f"a correction of {size[worst] * 1e3:.3g} mm" if math.isfinite(size[worst]) else "no correction at all"
        raise ValueError(
            f"the fit gives {what} for a spot at ({x:.2f}, {y:.2f}) mm, and the largest error of the points is "
            f"{raw_max_m * 1e3:.3g} mm: the points do not tell the distortion there; add points there"
        )
