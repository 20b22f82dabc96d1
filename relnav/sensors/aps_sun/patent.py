"""The patent's two-stage compensation as written: a cubic radial correction, then tables by whole degree.

The patent is "Error compensation method for the APS sun sensor of a Mars rover" (Chinese patent, 2021).
It numbers paragraphs and no formula; the numbers here are ours, in the order of its steps. The text lost its signs and
the images of r, of (7) and of the tables' layout, which are restored. (1), the centre of light, is `spot_centroid`.

(2) dx = x - x0,  dy = y - y0,  r = sqrt(dx^2 + dy^2)                                  [0027]-[0030]
(3) x_th = h tan(alpha) + x0,  y_th = h tan(beta) + y0                                 [0030]-[0031]
(4) x_th = x + xp0 dx r + xp1 dx r^2 + xp2 dx r^3, likewise y                          [0012]-[0013]
(5) xp, yp by least squares of (4) over the whole grid                                 [0015]
(6) x_c = x + xp0 dx r + xp1 dx r^2 + xp2 dx r^3 with them, likewise y                 [0034]-[0035]
(7) alpha_b = atan((x_c - x0)/h), beta_b likewise                                      [0016]-[0018]
(8) residuals alpha - alpha_b, beta - beta_b                                           [0036]-[0037]
(9) one polynomial of degree 7 in alpha_b for every whole degree of beta, likewise y   [0038]-[0039]
(10) at run time the row is the other axis's angle, rounded half up, within the table  [0021]-[0023]

The tables' caption names the row by the same axis; step 8 takes the other axis, and only that works. The text defines h
as the distance from the hole to the detector. With it (4), which has no linear term, must imitate the 10 to 20 % by
which the cover glass shortens h, and leaves a cusp at r = 0 that no row removes: 0.18 deg instead of 0.007. The default
is the optical h. Angles in the tables are degrees, as in the patent; what leaves is radians.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Codes, Matrix, Stack, Vector, numbers
from relnav.codegen.kernel import kernel
from relnav.sensors.aps_sun.table import direction_into

DEGREE = 7
NEAR_AXIS_TAN = math.tan(math.radians(2.0))
DEG = 180.0 / math.pi
SLOPE_STEP_PX = 0.05


@dataclass(frozen=True)
class PatentTables:
    """Everything that the patent's run time needs.

    Attributes
    ----------
    x0_px, y0_px, h_px : float
        Spot when the sun stands at zero, and height of the hole, in pixels.
    radial : (2, 3)
        (xp0, xp1, xp2) and (yp0, yp1, yp2), 1/px, 1/px^2, 1/px^3.
    rows : (2, 121, 8)
        Tables of alpha and beta, row = whole degree of the other axis from -limit to limit, highest power first, deg.
    limit_deg : int
        Edge of the field.
    """

    x0_px: float
    y0_px: float
    h_px: float
    radial: Matrix
    rows: Stack
    limit_deg: int

    def tangents_with_slope(self, x_px: float, y_px: float) -> Matrix:
        """(2, 3) at one spot, rows alpha and beta: the tangent and its derivatives by x and y, of the first stage.

        The second stage changes the slope by some 2 %, and has none where its row changes.
        """
        spot = np.array([x_px, y_px])
        ends = spot + SLOPE_STEP_PX * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        at_ends = np.tan(stage_one_angles(self, ends))
        slope = np.stack([at_ends[0] - at_ends[1], at_ends[2] - at_ends[3]], axis=1) / (2.0 * SLOPE_STEP_PX)
        return np.column_stack([np.tan(patent_angles(self, spot[None])[0][0]), slope])

    def direction_of(self, x_px: float, y_px: float, xx: float, xy: float, yy: float) -> Matrix:
        """As `DirectionTable.direction_of`."""
        out = np.empty((8, 3))
        out[6:8] = self.tangents_with_slope(x_px, y_px)
        direction_into(out[6:8], xx, xy, yy, out)
        return out


def paraxial(spots_px: ArrayLike, tangents: ArrayLike) -> tuple[Vector, float]:
    """Spot at zero (2,) px and optical h px: the line of the spots over their tangents within 2 deg of the axis.

    Raises
    ------
    ValueError
        With fewer than three points there.
    """
    spots, t = numbers("spots_px", spots_px), numbers("tangents", tangents)
    near = np.all(np.abs(t) <= NEAR_AXIS_TAN * (1.0 + 1e-9), axis=-1)
    if near.sum() < 3:
        raise ValueError("the optical h needs three points or more within 2 deg of the axis")
    middle, spot = t[near].mean(axis=0), spots[near].mean(axis=0)
    off = t[near] - middle
    slope = float(np.sum(off * (spots[near] - spot)) / np.sum(off * off))
    return spot - slope * middle, slope


def fit_patent(
    spots_px: ArrayLike,
    alpha_rad: ArrayLike,
    beta_rad: ArrayLike,
    *,
    zero_spot_px: ArrayLike | None = None,
    h_px: float | None = None,
    degree: int = DEGREE,
) -> PatentTables:
    """Calibrate as the patent does, on a full grid of whole degrees.

    Parameters
    ----------
    spots_px : (N, 2)
        Spots of the grid, in any order.
    alpha_rad, beta_rad : (N,)
        Projection angles (not those of a turntable's gimbals: `geometry.projection_angles`).
    zero_spot_px : (2,), optional
        (x0, y0): the spot when the turntable stands at zero, [0027]; from the grid if left out (`paraxial`).
    h_px : float, optional
        Height; the optical one, from the grid, if left out.
    degree : int
        Of the residual polynomials.

    Raises
    ------
    ValueError
        If the points are not each whole degree from -limit to limit on both axes, once; missing ones are named.
    """
    alpha, beta = DEG * numbers("alpha_rad", alpha_rad), DEG * numbers("beta_rad", beta_rad)
    spots = numbers("spots_px", spots_px)
    order, limit = _whole_grid(alpha, beta)
    n = 2 * limit + 1
    xy, angles = spots[order], np.stack([alpha[order], beta[order]], axis=1)
    tangents = np.tan(angles / DEG)
    seen_zero, seen_h = paraxial(xy, tangents)
    h = seen_h if h_px is None else float(h_px)
    zero = seen_zero if zero_spot_px is None else numbers("zero_spot_px", zero_spot_px)
    d = xy - zero
    r = np.hypot(d[:, 0], d[:, 1])
    radial = np.empty((2, 3))
    for axis in range(2):
        basis = d[:, axis, None] * np.stack([r, r**2, r**3], axis=1)
        scale = np.linalg.norm(basis, axis=0)
        radial[axis] = np.linalg.lstsq(basis / scale, h * tangents[:, axis] - d[:, axis], rcond=None)[0] / scale
    before = np.empty((n, n, 2))
    before.reshape(-1, 2)[:] = _stage_one(d, r, radial, h)
    residual = angles.reshape(n, n, 2) - before
    rows = np.zeros((2, n, degree + 1))
    for j in range(n):
        rows[0, j] = np.polyfit(before[:, j, 0], residual[:, j, 0], degree)
        rows[1, j] = np.polyfit(before[j, :, 1], residual[j, :, 1], degree)
    return PatentTables(float(zero[0]), float(zero[1]), h, radial, rows, limit)


def stage_one_angles(tables: PatentTables, spots_px: ArrayLike) -> Matrix:
    """(alpha, beta) after the first stage alone, eqs (6) and (7), (..., 2) rad."""
    d = numbers("spots_px", spots_px) - np.array([tables.x0_px, tables.y0_px])
    return _stage_one(d, np.hypot(d[..., 0], d[..., 1]), tables.radial, tables.h_px) / DEG


def patent_angles(tables: PatentTables, spots_px: ArrayLike, *, rows: str = "round") -> tuple[Matrix, Vector]:
    """(alpha, beta) (N, 2) rad of spots (N, 2) px by both stages, and whether each lies in the table's field (N,).

    rows: "round" is the patent's, with steps of up to 0.02 deg where the row changes; "interpolate" goes linearly
    between the two rows. A spot beyond the last row by more than a degree is computed with the last row and False.
    """
    if rows not in ("round", "interpolate"):
        raise ValueError(f'rows must be "round" or "interpolate"; got {rows!r}')
    spots = numbers("spots_px", spots_px)
    if spots.ndim != 2 or spots.shape[1] != 2:
        raise ValueError(f"spots_px has shape (N, 2); got {spots.shape}")
    out = np.empty_like(spots)
    patent_batch(
        spots, tables.x0_px, tables.y0_px, tables.h_px, tables.radial, tables.rows, tables.limit_deg,
        rows == "interpolate", out,
    )  # fmt: skip
    valid = np.all(np.abs(out) <= (tables.limit_deg + 1.0) / DEG, axis=1)
    return out, valid


def leverage(tables: PatentTables, spots_px: Matrix, angles_rad: Matrix) -> Matrix:
    """Share (N, 2) that a grid point has in its own row's polynomial: held out, its residual is 1 / (1 - it) larger."""
    before = stage_one_angles(tables, spots_px) * DEG / tables.limit_deg
    rows = np.rint(angles_rad * DEG).astype(np.int64)
    out = np.empty_like(before)
    for axis in range(2):
        for row in range(-tables.limit_deg, tables.limit_deg + 1):
            there = rows[:, 1 - axis] == row
            basis = np.linalg.qr(np.vander(before[there, axis], tables.rows.shape[2]))[0]
            out[there, axis] = np.sum(basis**2, axis=1)
    return out


@kernel
def patent_batch(
    spots: Matrix, x0: float, y0: float, h: float, radial: Matrix, rows: Stack, limit: int, interpolate: bool,
    out: Matrix,
) -> None:  # fmt: skip
    """Write (alpha, beta) rad of every spot (n, 2) px into out (n, 2): eqs (2), (6), (7), (10)."""
    last = 2 * limit
    powers = rows.shape[2]
    for i in range(spots.shape[0]):
        dx, dy = spots[i, 0] - x0, spots[i, 1] - y0
        r = math.sqrt(dx * dx + dy * dy)
        x_c = dx * (1.0 + r * (radial[0, 0] + r * (radial[0, 1] + r * radial[0, 2])))
        y_c = dy * (1.0 + r * (radial[1, 0] + r * (radial[1, 1] + r * radial[1, 2])))
        alpha, beta = DEG * math.atan(x_c / h), DEG * math.atan(y_c / h)
        if not (abs(alpha) <= 90.0 and abs(beta) <= 90.0):
            out[i, 0] = out[i, 1] = math.nan  # a spot that is none has no row
            continue
        for axis in range(2):
            own, other = (alpha, beta) if axis == 0 else (beta, alpha)
            place = min(max(other + limit, 0.0), float(last))
            row = int(place) if interpolate else int(place + 0.5)
            correction = 0.0
            for k in range(powers):
                correction = correction * own + rows[axis, row, k]
            if interpolate and row < last:
                above = 0.0
                for k in range(powers):
                    above = above * own + rows[axis, row + 1, k]
                correction += (place - row) * (above - correction)
            out[i, axis] = (own + correction) / DEG


def _stage_one(d: Matrix, r: Vector, radial: Matrix, h: float) -> Matrix:
    """Eqs (6) and (7) for offsets d (..., 2) px and their lengths r (...): degrees."""
    scale = 1.0 + r[..., None] * (radial[:, 0] + r[..., None] * (radial[:, 1] + r[..., None] * radial[:, 2]))
    degrees: Matrix = DEG * np.arctan(d * scale / h)
    return degrees


def _whole_grid(alpha: Vector, beta: Vector) -> tuple[Codes, int]:
    """Order that sorts the points by (alpha, beta) degrees, and the limit; ValueError if the grid is not whole."""
    a, b = np.rint(alpha).astype(np.int64), np.rint(beta).astype(np.int64)
    if a.size == 0 or np.abs(alpha - a).max() > 1e-6 or np.abs(beta - b).max() > 1e-6:
        raise ValueError("the patent's table needs a grid of whole degrees in alpha and beta; other angles came")
    limit = int(max(np.abs(a).max(), np.abs(b).max()))
    n = 2 * limit + 1
    count = np.zeros((n, n), dtype=np.int64)
    np.add.at(count, (a + limit, b + limit), 1)
    missing, double = np.argwhere(count == 0) - limit, np.argwhere(count > 1) - limit
    for what, nodes in (("lacks", missing), ("repeats", double)):
        if len(nodes):
            named = ", ".join(f"({i}, {j})" for i, j in nodes[:5]) + (", ..." if len(nodes) > 5 else "")
            raise ValueError(
                f"the patent's table needs every whole degree of +-{limit} x +-{limit} once; the grid {what} "
                f"{len(nodes)} of {n * n} (alpha, beta) deg: {named}"
            )
    return np.lexsort((b, a)), limit
