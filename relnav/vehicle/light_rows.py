"""Rows of seen lights, compiled: formulas and derivatives as in `relnav.vehicle.points`."""

import math

import numpy as np

from relnav.arrays import Codes, Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.estimation.schmidt import clear, copy_into
from relnav.geometry.distortion import distort_point
from relnav.geometry.linear_algebra import cross_into
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.vehicle.layout import CHASER_ATTITUDE, TARGET_ATTITUDE
from relnav.vehicle.orbit_frame import lvlh_from_inertial_into

_F = np.float64
_TARGET, _CHASER = TARGET_ATTITUDE.start, CHASER_ATTITUDE.start

OPTICS = np.dtype(
    [
        ("lens", _F, 3),
        ("dcm_chaser_from_sensor", _F, (3, 3)),
        ("focal_length", _F, 2),
        ("principal_point", _F, 2),
        ("distortion", _F, 5),
        ("mount", np.int64),
        ("lever", np.int64),
        ("focal", np.int64),
    ]
)
"""Where a camera sits and how it images; where its blocks begin in the layout."""

GEOMETRY = np.dtype(
    [
        ("frame", _F, (3, 3)),
        ("chaser_from_lvlh", _F, (3, 3)),
        ("chaser_from_sensor", _F, (3, 3)),
        ("place", _F, 3),
        ("q", _F, 3),
        ("p", _F, 3),
        ("slope", _F, (2, 3)),
        ("by_chaser", _F, 3),
        ("by_lvlh", _F, 3),
        ("by_target", _F, 3),
    ]
)
"""Scratch."""


@kernel
def _row_times_into(row: Vector, matrix: Matrix, out: Vector) -> None:
    for c in range(3):
        out[c] = row[0] * matrix[0, c] + row[1] * matrix[1, c] + row[2] * matrix[2, c]


@kernel
def _see(optics: Record, p: Vector, slope: Matrix) -> tuple[float, float]:
    """Spot of a point in sensor axes less the principal point, and its slope (2, 3); NaN behind, or where it folds."""
    if not p[2] > 0.0:
        return math.nan, math.nan
    x, y, f = p[0] / p[2], p[1] / p[2], optics["focal_length"]
    u, v, xx, xy, yy = distort_point(x, y, optics["distortion"])
    if not xx * yy - xy * xy > 0.0:
        return math.nan, math.nan
    slope[0, 0], slope[0, 1], slope[0, 2] = f[0] * xx / p[2], f[0] * xy / p[2], -f[0] * (xx * x + xy * y) / p[2]
    slope[1, 0], slope[1, 1], slope[1, 2] = f[1] * xy / p[2], f[1] * yy / p[2], -f[1] * (xy * x + yy * y) / p[2]
    return f[0] * u, f[1] * v


@kernel
def _row_into(
    optics: Record, work: Record, by_p: Vector, dcm_lvlh_from_target: Matrix, light: int, row: Vector
) -> None:
    """Write a row (n,) from its derivative by_p (3,) by the light in sensor axes; the row is zero before.

    light: where the errors of its place begin.
    """
    by_chaser, by_lvlh, by_target = work["by_chaser"], work["by_lvlh"], work["by_target"]
    back = work["chaser_from_sensor"]
    for c in range(3):
        by_chaser[c] = by_p[0] * back[c, 0] + by_p[1] * back[c, 1] + by_p[2] * back[c, 2]
    _row_times_into(by_chaser, work["chaser_from_lvlh"], by_lvlh)
    _row_times_into(by_lvlh, dcm_lvlh_from_target, by_target)
    mount, lever = optics["mount"], optics["lever"]
    for c in range(3):
        row[c] = -by_lvlh[c]
        row[lever + c] = -by_chaser[c]
        row[light + c] = by_target[c]
    cross_into(work["place"], by_target, row[_TARGET : _TARGET + 3])
    cross_into(by_chaser, work["q"], row[_CHASER : _CHASER + 3])
    cross_into(by_p, work["p"], row[mount : mount + 3])


@kernel
def _lights_of_one(
    optics: Record,
    work: Record,
    points: Matrix,
    lights: Codes,
    values: Vector,
    dcm_lvlh_from_target: Matrix,
    dcm_inertial_from_chaser: Matrix,
    spots: Vector,
    residual: Vector,
    H: Matrix,
) -> None:
    """Write residual (2 k,) and H (2 k, n), zero before, at one estimate; work has the frame."""
    C_BL, back, frame = work["chaser_from_lvlh"], work["chaser_from_sensor"], work["frame"]
    mount, lever = optics["mount"], optics["lever"]
    turn_by_rotation_vector(optics["dcm_chaser_from_sensor"], values[mount : mount + 3], back)
    for i in range(3):
        for c in range(3):
            C_BL[i, c] = 0.0
            for m in range(3):
                C_BL[i, c] += dcm_inertial_from_chaser[m, i] * frame[c, m]
    scale, place, q, p, slope = 1.0 + values[optics["focal"]], work["place"], work["q"], work["p"], work["slope"]
    for k in range(points.shape[0]):
        away = work["by_lvlh"]
        for c in range(3):
            place[c] = points[k, c] + values[lights[k] + c]
        for i in range(3):
            C = dcm_lvlh_from_target[i]
            away[i] = C[0] * place[0] + C[1] * place[1] + C[2] * place[2] - values[i]
        for i in range(3):
            q[i] = C_BL[i, 0] * away[0] + C_BL[i, 1] * away[1] + C_BL[i, 2] * away[2]
        for c in range(3):
            p[c] = 0.0
            for i in range(3):
                p[c] += back[i, c] * (q[i] - optics["lens"][i] - values[lever + i])
        seen = _see(optics, p, slope)
        for i in range(2):
            row = H[2 * k + i]
            residual[2 * k + i] = spots[2 * k + i] - optics["principal_point"][i] - scale * seen[i]
            if math.isfinite(residual[2 * k + i]):
                for c in range(3):
                    slope[i, c] *= scale
                _row_into(optics, work, slope[i], dcm_lvlh_from_target, lights[k], row)
                row[optics["focal"]] = seen[i]


@entry
def light_rows_into(
    optics: Record,
    work: Record,
    points: Matrix,
    lights: Codes,
    orbit: Vector,
    axes: Matrix,
    t: float,
    values: Matrix,
    dcm_lvlh_from_target: Stack,
    dcm_inertial_from_chaser: Stack,
    spots: Vector,
    noise: Matrix,
    residual: Matrix,
    H: Stack,
    R: Stack,
) -> None:
    """Write the rows of m filters about the spots (2 k,) of k lights (k, 3): residual (m, 2 k), H (m, 2 k, n), and R.

    orbit and axes as `orbit_frame.lvlh_from_inertial_into`; values (m, n) and attitudes as in `Estimates` at t; noise
    (2 k, 2 k). lights (k,): where the errors of each begin. NaN residuals where a spot is NaN or no light can be seen.
    """
    lvlh_from_inertial_into(orbit, axes, t, work["frame"])
    for f in range(values.shape[0]):
        clear(H[f])
        copy_into(noise, R[f])
        target, chaser = dcm_lvlh_from_target[f], dcm_inertial_from_chaser[f]
        _lights_of_one(optics, work, points, lights, values[f], target, chaser, spots, residual[f], H[f])


@entry
def spots_inside_into(spots: Matrix, first: Vector, last: Vector, out: Vector) -> None:
    """Write spots (k, 2) into out (2 k,), NaN what does not lie on a detector from first to last (2,)."""
    for k in range(spots.shape[0]):
        x, y = spots[k, 0], spots[k, 1]
        inside = first[0] <= x <= last[0] and first[1] <= y <= last[1]
        out[2 * k], out[2 * k + 1] = (x, y) if inside else (math.nan, math.nan)
