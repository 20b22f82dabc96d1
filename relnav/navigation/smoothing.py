"""Smoothing of a filtered log: backward over each unbroken piece of the track."""

import math

import numpy as np

from relnav._kernel import kernel, straight_line
from relnav.arrays import Codes, Matrix, Vector
from relnav.dynamics.clohessy_wiltshire import PHI_PATTERN, transition_into
from relnav.estimation.smoothing import smooth_step
from relnav.navigation.block import EFFECT, INPUT, PHI, Q_FACTORS, SETTINGS, STEP_KEY, WORK
from relnav.navigation.propagation import carry, prepare_step
from relnav.navigation.status import STARTED, WAITING

LATER_ROWS = 9


@straight_line(ld=(6, 6), packed=(21,))
def pack_factors(ld: Matrix, packed: Vector) -> None:
    """Write the lower triangle of ld (6, 6), row by row, into packed (21,)."""
    at = 0
    for i in range(6):
        for j in range(i + 1):
            packed[at] = ld[i, j]
            at += 1


@straight_line(state=(6,), packed=(21,), track=(7, 6))
def unpack_track(state: Vector, packed: Vector, track: Matrix) -> None:
    """Write a state (6,) and packed factors (21,) as a track (7, 6)."""
    at = 0
    for i in range(6):
        track[0, i] = state[i]
        for j in range(i + 1):
            track[1 + i, j] = packed[at]
            at += 1


@straight_line(
    state=(6,), packed=(21,), later=(7, 6), phi=PHI_PATTERN, inverse=PHI_PATTERN, effect=(6,), q_ld=(6, 6)
)  # fmt: skip
def smooth_packed(
    state: Vector, packed: Vector, later: Matrix, phi: Matrix, inverse: Matrix, effect: Vector, q_ld: Matrix
) -> None:
    """Replace a filtered state (6,) and packed factors (21,) by the smoothed ones, and `later` by the same."""
    filtered, predicted = np.zeros((7, 6)), np.zeros((7, 6))
    unpack_track(state, packed, filtered)
    for i in range(7):
        for j in range(6):
            predicted[i, j] = filtered[i, j]
    carry(predicted, phi, effect, q_ld)
    smooth_step(filtered, predicted, later, phi, inverse, q_ld)
    for i in range(6):
        state[i] = later[0, i]
    pack_factors(later[1:7], packed)


def nothing_later() -> Matrix:
    """The `later` of a log's last epoch, (9, 6)."""
    return np.zeros((LATER_ROWS, 6))


@kernel
def smooth_run(
    block: Matrix, t: Vector, control: Matrix, codes: Codes, state: Matrix, factor: Matrix, later: Matrix
) -> None:
    """Smooth filtered epochs in place, from their last to their first.

    state (n, 6), factor (n, 21) and codes (n, 3) as `_run` wrote them; control (n, 6) may be empty. A piece ends where
    the filter was not running or was started anew. `later` (9, 6): smoothed state and factors of the epoch after
    (7 rows), its time and whether it belongs to the same piece, its control; replaced by those of the first epoch.
    """
    inverse, of_step = block[WORK + 18 : WORK + 24], math.nan  # rows that `prepare_step` leaves alone
    for e in range(t.shape[0] - 1, -1, -1):
        status = codes[e, 1]
        if status == WAITING:
            later[7, 1] = 0.0
            continue
        if later[7, 1] > 0.0:
            for j in range(6):
                block[INPUT, j] = later[8, j]
            prepare_step(block, later[7, 0] - t[e])
            if block[STEP_KEY, 0] != of_step:
                of_step = block[STEP_KEY, 0]
                transition_into(block[SETTINGS, 4], -of_step, inverse)
            smooth_packed(
                state[e],
                factor[e],
                later[0:7],
                block[PHI : PHI + 6],
                inverse,
                block[EFFECT],
                block[Q_FACTORS : Q_FACTORS + 6],
            )
        else:
            unpack_track(state[e], factor[e], later[0:7])
        later[7, 0] = t[e]
        later[7, 1] = 0.0 if status == STARTED else 1.0
        for j in range(6):
            later[8, j] = control[e, j] if control.shape[0] > 0 else 0.0
