"""The state as the docking sensor describes it: range, azimuth, elevation, with the covariance J P J^T.

The angles are those of Cai, Zhao, Sun, Qiao, Dai (1996),
"Determination of target relative position and range by PSD optical sensor system".
"""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import entry, straight_line
from relnav.codegen.together import select
from relnav.dynamics.error_state import MOTION, factor_size
from relnav.estimation.factored import compose_into
from relnav.geometry.spherical import range_azimuth_elevation, range_azimuth_elevation_jacobian
from relnav.navigation.packed_factors import unpack_factors

DOCKING_ROWS = slice(3, 3 + factor_size(3))
STATE_ROWS = slice(DOCKING_ROWS.stop, DOCKING_ROWS.stop + factor_size(MOTION))
VIEW_ROWS = STATE_ROWS.stop
"""Range, azimuth, elevation; the 6 elements of their covariance; the 21 of the state's, upper triangles by rows."""
UPPER = np.triu_indices(MOTION)
"""Rows and columns of the 21 numbers of a (6, 6) upper triangle."""
LOWER = np.tril_indices(MOTION)
"""Rows and columns of the 21 numbers of packed factors."""
UPPER_THREE = np.triu_indices(3)


@straight_line(state=(MOTION,), packed=(factor_size(MOTION),), dock=(3, 3), port=(3,), lever=(3,), out=(VIEW_ROWS,))
def view_epoch(state: Vector, packed: Vector, dock: Matrix, port: Vector, lever: Vector, out: Vector) -> None:
    """Cai et al. (1996) eq. (13) and J P J^T for one state with packed factors; no angles at the poles x = y = 0."""
    ld, covariance = np.zeros((MOTION, MOTION)), np.zeros((MOTION, MOTION))
    s, p, to_angles, j = np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    unpack_factors(packed, ld)
    compose_into(ld, covariance)
    for i in range(3):
        s[i] = state[i] + lever[i] - port[i]
    for i in range(3):
        p[i] = dock[i, 0] * s[0] + dock[i, 1] * s[1] + dock[i, 2] * s[2]
    range_azimuth_elevation(p, out)
    regular = range_azimuth_elevation_jacobian(p, to_angles)
    for i in range(3):
        for k in range(3):
            for m in range(3):
                j[i, k] += to_angles[i, m] * dock[m, k]
    at = 3
    for i in range(3):
        for k in range(i, 3):
            total = 0.0
            for m in range(3):
                for n in range(3):
                    total += j[i, m] * covariance[m, n] * j[k, n]
            out[at] = total if i == k == 0 else select(regular, total, math.nan)
            at += 1
    for i in range(MOTION):
        for k in range(i, MOTION):
            out[at] = covariance[i, k]
            at += 1


@entry
def _views(
    state: Matrix, factor: Matrix, dock: Matrix, port: Vector, lever: Matrix, out: Matrix, scratch: Vector
) -> None:
    held = lever.shape[0] == 1
    for e in range(state.shape[0]):
        view_epoch(state[e], factor[e], dock, port, lever[0 if held else e], scratch)
        for row in range(VIEW_ROWS):
            out[row, e] = scratch[row]


def views(state: Matrix, factor: Matrix, dcm_dock_from_lvlh: Matrix, port_m: Vector, lever_lvlh_m: Matrix) -> Matrix:
    """The camera's range, azimuth and elevation, their covariance, and the state's, (30, n): `VIEW_ROWS`.

    Parameters
    ----------
    state, factor : (n, 6), (n, 21)
        Relative states, `lvlh_ccsds`, and their packed factors.
    dcm_dock_from_lvlh : (3, 3)
        Orientation of the docking frame.
    port_m : (3,)
        O from the target's centre of mass, `lvlh_ccsds`.
    lever_lvlh_m : (1, 3) or (n, 3)
        Camera from the chaser's centre of mass, `lvlh_ccsds`.
    """
    out = np.empty((VIEW_ROWS, len(state)))
    dock, port, lever = (np.ascontiguousarray(x, dtype=np.float64) for x in (dcm_dock_from_lvlh, port_m, lever_lvlh_m))
    _views(np.ascontiguousarray(state), np.ascontiguousarray(factor), dock, port, lever, out, np.empty(VIEW_ROWS))
    return out


def symmetric(upper: Matrix) -> Stack:
    """Symmetric matrices (n, m, m) from the rows of their upper triangles (m (m + 1) / 2, n)."""
    size = 3 if len(upper) == len(UPPER_THREE[0]) else MOTION
    rows, columns = UPPER_THREE if size == 3 else UPPER
    out = np.empty((upper.shape[1], size, size))
    out[:, rows, columns] = upper.T
    out[:, columns, rows] = upper.T
    return out
