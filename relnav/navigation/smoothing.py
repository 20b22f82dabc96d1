"""Smoothing of a filtered log: backward over each unbroken piece of the track."""

import math

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.codegen.kernel import kernel, side_by_side, straight_line
from relnav.codegen.trace import LANES
from relnav.dynamics.clohessy_wiltshire import PHI_PATTERN, transition_into
from relnav.estimation.smoothing import backward_model, carry_noise_back, smooth_step
from relnav.navigation.block import EFFECT, INPUT, PHI, Q_FACTORS, SETTINGS, STEP_KEY, WORK, X_WORK
from relnav.navigation.propagation import carry_state, multiply, prepare_step, snapped
from relnav.navigation.status import STARTED, WAITING

LATER_ROWS = 9

MODEL = 63
"""Numbers of an epoch's backward model: C (36), packed factors of S (21), the state it predicts (6)."""


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
    state=(6,), packed=(21,), phi=PHI_PATTERN, inverse=PHI_PATTERN, effect=(6,), carried=(6, 6), model=(MODEL,)
)  # fmt: skip
def model_epoch(
    state: Vector, packed: Vector, phi: Matrix, inverse: Matrix, effect: Vector, carried: Matrix, model: Vector
) -> None:
    """Write the backward model (63,) of a filtered epoch (6,), (21,): all of smoothing that needs nothing later."""
    filtered, c, s_ld = np.zeros((7, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    unpack_track(state, packed, filtered)
    backward_model(filtered[1:7], inverse, carried, c, s_ld)
    for i in range(6):
        for j in range(6):
            model[6 * i + j] = c[i, j]
    pack_factors(s_ld, model[36:57])
    carry_state(state, phi, effect, model[57:63])


@straight_line(later=(6,), row=(6,), phi=PHI_PATTERN, model=(MODEL,))
def smooth_sensitivity(later: Vector, row: Vector, phi: Matrix, model: Vector) -> None:
    """Replace a filtered sensitivity (6,) by the smoothed one, s + C (later - Phi s), and `later` by the same."""
    ahead = np.zeros(6)
    for i in range(6):
        ahead[i] = row[i]
    multiply(phi, ahead)
    for i in range(6):
        total = row[i]
        for j in range(6):
            total += model[6 * i + j] * (later[j] - ahead[j])
        row[i] = total
        later[i] = total


model_epochs = side_by_side(model_epoch, "state", "packed", "model")


@straight_line(later=(7, 6), model=(MODEL,), state=(6,), packed=(21,))
def smooth_epoch(later: Matrix, model: Vector, state: Vector, packed: Vector) -> None:
    """Replace a filtered state (6,) and packed factors (21,) by the smoothed ones, and `later` by the same."""
    noise, c = np.zeros((7, 6)), np.zeros((6, 6))
    unpack_track(model[57:63], model[36:57], noise)
    for i in range(6):
        for j in range(6):
            c[i, j] = model[6 * i + j]
    smooth_step(later, state, noise[0], c, noise[1:7])
    for i in range(6):
        state[i] = later[0, i]
    pack_factors(later[1:7], packed)


def nothing_later(considered: int = 0) -> Matrix:
    """The `later` of a log's last epoch, (9 + considered, 6), with so many sensitivities."""
    return np.zeros((LATER_ROWS + considered, 6))


def new_models() -> Matrix:
    """Scratch of `smooth_run`: models of LANES epochs, (LANES, 63)."""
    return np.zeros((LANES, MODEL))


@kernel
def _same_step(block: Matrix, t: Vector, control: Matrix, codes: Codes, e: int) -> bool:
    """Whether epochs e - LANES + 1 .. e all lead to the next epoch by the step at hand."""
    if e < LANES - 1 or block[STEP_KEY, 4] != 0.0:
        return False
    for k in range(e, e - LANES + 1, -1):
        if codes[k, 1] == STARTED or codes[k, 1] == WAITING or codes[k - 1, 1] == WAITING:
            return False
        if snapped(t[k] - t[k - 1]) != block[STEP_KEY, 0]:
            return False
        for j in range(6 if control.shape[0] > 0 else 0):
            if control[k, j] != block[INPUT, j]:
                return False
    return True


@kernel
def smooth_run(
    block: Matrix,
    t: Vector,
    control: Matrix,
    codes: Codes,
    state: Matrix,
    factor: Matrix,
    considered: Stack,
    later: Matrix,
    models: Matrix,
) -> None:
    """Smooth filtered epochs in place, from their last to their first.

    state (n, 6), factor (n, 21) and codes (n, 3) as `_run` wrote them; control (n, 6) may be empty. A piece ends where
    the filter was not running or was started anew. considered (n, m, 6): sensitivities, m may be 0. `later` (9 + m, 6):
    smoothed state and factors of the epoch after (7 rows), its time and whether it belongs to the same piece, its
    control, its sensitivities; replaced by those of the first epoch. models: `new_models`.
    """
    inverse, carried = block[WORK + 18 : WORK + 24], block[X_WORK : X_WORK + 6]  # `prepare_step` leaves them alone
    block[STEP_KEY, 0] = math.nan
    ready = 0  # models at hand, of this epoch and those before it
    for e in range(t.shape[0] - 1, -1, -1):
        status = codes[e, 1]
        if status == WAITING:
            later[7, 1] = 0.0
            continue
        if later[7, 1] > 0.0:
            if ready == 0:
                for j in range(6):
                    block[INPUT, j] = later[8, j]
                phi, effect = block[PHI : PHI + 6], block[EFFECT]
                if prepare_step(block, later[7, 0] - t[e]):
                    transition_into(block[SETTINGS, 4], -block[STEP_KEY, 0], inverse)
                    carry_noise_back(block[Q_FACTORS : Q_FACTORS + 6], inverse, carried)
                if _same_step(block, t, control, codes, e):
                    ready = LANES
                    first = e - LANES + 1
                    model_epochs(state[first : e + 1], factor[first : e + 1], phi, inverse, effect, carried, models)
                else:
                    ready = 1
                    model_epoch(state[e], factor[e], phi, inverse, effect, carried, models[0])
            ready -= 1
            smooth_epoch(later[0:7], models[ready], state[e], factor[e])
            for k in range(considered.shape[1]):
                smooth_sensitivity(later[LATER_ROWS + k], considered[e, k], block[PHI : PHI + 6], models[ready])
        else:
            unpack_track(state[e], factor[e], later[0:7])
            for k in range(considered.shape[1]):
                for j in range(6):
                    later[LATER_ROWS + k, j] = considered[e, k, j]
        later[7, 0] = t[e]
        later[7, 1] = 0.0 if status == STARTED else 1.0
        for j in range(6):
            later[8, j] = control[e, j] if control.shape[0] > 0 else 0.0
