"""Smoothing of a filtered log: backward over each unbroken piece of the track."""

import math

import numpy as np

from relnav.arrays import Codes, Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel, side_by_side, straight_line, variant
from relnav.codegen.trace import LANES
from relnav.dynamics.clohessy_wiltshire import PHI_PATTERN
from relnav.dynamics.error_state import MOTION, factor_size
from relnav.dynamics.relative_motion import depends_on_dt_alone, transition_into
from relnav.dynamics.yamanaka_ankersen import PHI_PATTERN as ECCENTRIC_PATTERN
from relnav.estimation.smoothing import backward_model, carry_noise_back, smooth_step
from relnav.navigation.memory import TRACK, views
from relnav.navigation.propagation import carry_state, multiply, prepare_step, snapped
from relnav.navigation.status import STARTED, WAITING

GAIN, PACKED = MOTION * MOTION, factor_size(MOTION)
MODEL = GAIN + PACKED + MOTION
"""Numbers of an epoch's backward model: C (36), packed factors of S (21), the state it predicts (6)."""


@straight_line(ld=(MOTION, MOTION), packed=(PACKED,))
def pack_factors(ld: Matrix, packed: Vector) -> None:
    """Write the lower triangle of ld (6, 6), row by row, into packed (21,)."""
    at = 0
    for i in range(MOTION):
        for j in range(i + 1):
            packed[at] = ld[i, j]
            at += 1


@straight_line(packed=(PACKED,), ld=(MOTION, MOTION))
def unpack_factors(packed: Vector, ld: Matrix) -> None:
    """Write packed factors (21,) into the lower triangle of ld (6, 6)."""
    at = 0
    for i in range(MOTION):
        for j in range(i + 1):
            ld[i, j] = packed[at]
            at += 1


@straight_line(
    state=(MOTION,),
    packed=(PACKED,),
    phi=PHI_PATTERN,
    inverse=PHI_PATTERN,
    effect=(MOTION,),
    carried=(MOTION, MOTION),
    model=(MODEL,),
)
def model_epoch(
    state: Vector, packed: Vector, phi: Matrix, inverse: Matrix, effect: Vector, carried: Matrix, model: Vector
) -> None:
    """Write the backward model (63,) of a filtered epoch (6,), (21,): all of smoothing that needs nothing later."""
    filtered, c, s_ld = np.zeros((MOTION, MOTION)), np.zeros((MOTION, MOTION)), np.zeros((MOTION, MOTION))
    unpack_factors(packed, filtered)
    backward_model(filtered, inverse, carried, c, s_ld)
    for i in range(MOTION):
        for j in range(MOTION):
            model[MOTION * i + j] = c[i, j]
    pack_factors(s_ld, model[GAIN : GAIN + PACKED])
    carry_state(state, phi, effect, model[GAIN + PACKED : MODEL])


@straight_line(later=(MOTION,), row=(MOTION,), phi=PHI_PATTERN, model=(MODEL,))
def smooth_sensitivity(later: Vector, row: Vector, phi: Matrix, model: Vector) -> None:
    """Replace a filtered sensitivity (6,) by the smoothed one, s + C (later - Phi s), and `later` by the same."""
    ahead = np.zeros(MOTION)
    for i in range(MOTION):
        ahead[i] = row[i]
    multiply(phi, ahead)
    for i in range(MOTION):
        total = row[i]
        for j in range(MOTION):
            total += model[MOTION * i + j] * (later[j] - ahead[j])
        row[i] = total
        later[i] = total


model_epoch_eccentric = variant(model_epoch, "model_epoch_eccentric", phi=ECCENTRIC_PATTERN, inverse=ECCENTRIC_PATTERN)
smooth_sensitivity_eccentric = variant(smooth_sensitivity, "smooth_sensitivity_eccentric", phi=ECCENTRIC_PATTERN)
model_epochs = side_by_side(model_epoch, "state", "packed", "model")


@straight_line(later=(MOTION,), later_ld=(MOTION, MOTION), model=(MODEL,), state=(MOTION,), packed=(PACKED,))
def smooth_epoch(later: Vector, later_ld: Matrix, model: Vector, state: Vector, packed: Vector) -> None:
    """Replace a filtered state (6,) and packed factors (21,) by the smoothed ones, and `later` by the same."""
    noise, c = np.zeros((MOTION, MOTION)), np.zeros((MOTION, MOTION))
    unpack_factors(model[GAIN : GAIN + PACKED], noise)
    for i in range(MOTION):
        for j in range(MOTION):
            c[i, j] = model[MOTION * i + j]
    smooth_step(later, later_ld, state, model[GAIN + PACKED : MODEL], c, noise)
    for i in range(MOTION):
        state[i] = later[i]
    pack_factors(later_ld, packed)


LATER = np.dtype(
    [
        ("track", TRACK),  # smoothed
        ("t", np.float64),
        ("same_piece", np.int64),
        ("acceleration", np.float64, 3),
        ("delta_v", np.float64, 3),
    ]
)
"""What stands after an epoch; behind it in memory, the smoothed sensitivities (m, 6)."""
_LATER_SIZE = LATER.itemsize // 8


def nothing_later(considered: int = 0) -> Vector:
    """What stands after a log's last epoch, with so many sensitivities."""
    return np.zeros(_LATER_SIZE + MOTION * considered)


def new_models() -> Matrix:
    """Scratch of `smooth_run`: models of LANES epochs, (LANES, 63)."""
    return np.zeros((LANES, MODEL))


@kernel
def _same_step(step: Record, acceleration: Vector, t: Vector, control: Matrix, codes: Codes, e: int) -> bool:
    """Whether epochs e - LANES + 1 .. e all lead to the next epoch by the step at hand."""
    if e < LANES - 1 or step["impulse"] > 0:
        return False
    for k in range(e, e - LANES + 1, -1):
        if codes[k, 1] == STARTED or codes[k, 1] == WAITING or codes[k - 1, 1] == WAITING:
            return False
        if snapped(t[k] - t[k - 1]) != step["dt"]:
            return False
        if control.shape[0] > 0:
            for j in range(3):
                if control[k, j] != acceleration[j] or control[k, 3 + j] != 0.0:
                    return False
    return True


@entry
def smooth_run(
    block: Vector,
    t: Vector,
    control: Matrix,
    codes: Codes,
    state: Matrix,
    factor: Matrix,
    considered: Stack,
    after: Vector,
    models: Matrix,
) -> None:
    """Smooth filtered epochs in place, from their last to their first.

    state (n, 6), factor (n, 21) and codes (n, 4) as `_run` wrote them; control (n, 6) may be empty. A piece ends where
    the filter was not running or was started anew. considered (n, m, 6): sensitivities, m may be 0. after: what stands
    after the last epoch (`nothing_later`), replaced by what stands at the first. models: `new_models`.
    """
    m = views(block)
    step, motion, inverse, carried = m.step, m.motion, m.scratch["back"], m.scratch["carried"]
    acceleration, delta_v, phi, effect = motion["acceleration"], motion["delta_v"], step["phi"], step["effect"]
    later = after[:_LATER_SIZE].view(LATER)[0]
    rows = after[_LATER_SIZE:].reshape((considered.shape[1], MOTION))
    later_state, later_ld = later["track"]["state"], later["track"]["ld"]
    circular = depends_on_dt_alone(motion["orbit"])
    step["dt"] = math.nan
    ready = 0  # models at hand, of this epoch and those before it
    for e in range(t.shape[0] - 1, -1, -1):
        status = codes[e, 1]
        if status == WAITING:
            later["same_piece"] = 0
            continue
        if later["same_piece"] > 0:
            if ready == 0:
                for j in range(3):
                    acceleration[j], delta_v[j] = later["acceleration"][j], later["delta_v"][j]
                if prepare_step(m.step, m.motion, m.scratch, t[e], later["t"] - t[e]):
                    transition_into(motion["orbit"], t[e] + step["dt"], -step["dt"], inverse)
                    carry_noise_back(step["noise"], inverse, carried)
                if circular and _same_step(step, acceleration, t, control, codes, e):
                    ready = LANES
                    first = e - LANES + 1
                    model_epochs(state[first : e + 1], factor[first : e + 1], phi, inverse, effect, carried, models)
                else:
                    ready = 1
                    if circular:
                        model_epoch(state[e], factor[e], phi, inverse, effect, carried, models[0])
                    else:
                        model_epoch_eccentric(state[e], factor[e], phi, inverse, effect, carried, models[0])
            ready -= 1
            smooth_epoch(later_state, later_ld, models[ready], state[e], factor[e])
            for k in range(considered.shape[1]):
                if circular:
                    smooth_sensitivity(rows[k], considered[e, k], phi, models[ready])
                else:
                    smooth_sensitivity_eccentric(rows[k], considered[e, k], phi, models[ready])
        else:
            for i in range(MOTION):
                later_state[i] = state[e, i]
            unpack_factors(factor[e], later_ld)
            for k in range(considered.shape[1]):
                for j in range(MOTION):
                    rows[k, j] = considered[e, k, j]
        later["t"] = t[e]
        later["same_piece"] = 0 if status == STARTED else 1
        for j in range(3):
            later["acceleration"][j] = control[e, j] if control.shape[0] > 0 else 0.0
            later["delta_v"][j] = control[e, 3 + j] if control.shape[0] > 0 else 0.0
