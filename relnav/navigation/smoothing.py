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
from relnav.estimation.rows import copy_rows
from relnav.estimation.smoothing import backward_model, carry_noise_back, smooth_step
from relnav.navigation.memory import TRACK, views
from relnav.navigation.packed_factors import pack_factors, unpack_factors
from relnav.navigation.propagation import carry_state, multiply, prepare_step, snapped
from relnav.navigation.status import STARTED, WAITING

_F, _WHOLE, PACKED = np.float64, (MOTION, MOTION), factor_size(MOTION)


@straight_line(
    state=(MOTION,),
    packed=(PACKED,),
    phi=PHI_PATTERN,
    inverse=PHI_PATTERN,
    effect=(MOTION,),
    carried=_WHOLE,
    gain=_WHOLE,
    rest=(PACKED,),
    predicted=(MOTION,),
)
def model_epoch(
    state: Vector,
    packed: Vector,
    phi: Matrix,
    inverse: Matrix,
    effect: Vector,
    carried: Matrix,
    gain: Matrix,
    rest: Vector,
    predicted: Vector,
) -> None:
    """Write C, the factors of S and the prediction of a filtered epoch (6,), (21,): all that needs nothing later."""
    filtered, s_ld = np.zeros(_WHOLE), np.zeros(_WHOLE)
    unpack_factors(packed, filtered)
    backward_model(filtered, inverse, carried, gain, s_ld)
    pack_factors(s_ld, rest)
    carry_state(state, phi, effect, predicted)


model_epoch_eccentric = variant(model_epoch, "model_epoch_eccentric", phi=ECCENTRIC_PATTERN, inverse=ECCENTRIC_PATTERN)
model_epochs = side_by_side(model_epoch, "state", "packed", "gain", "rest", "predicted")


@straight_line(
    later=(MOTION,),
    later_ld=_WHOLE,
    gain=_WHOLE,
    rest=(PACKED,),
    predicted=(MOTION,),
    state=(MOTION,),
    packed=(PACKED,),
)
def smooth_epoch(
    later: Vector, later_ld: Matrix, gain: Matrix, rest: Vector, predicted: Vector, state: Vector, packed: Vector
) -> None:
    """Replace a filtered state (6,) and packed factors (21,) by the smoothed ones, and `later` by the same."""
    s_ld = np.zeros(_WHOLE)
    unpack_factors(rest, s_ld)
    smooth_step(later, later_ld, state, predicted, gain, s_ld)
    for i in range(MOTION):
        state[i] = later[i]
    pack_factors(later_ld, packed)


@straight_line(later=(MOTION,), row=(MOTION,), phi=PHI_PATTERN, gain=_WHOLE)
def smooth_sensitivity(later: Vector, row: Vector, phi: Matrix, gain: Matrix) -> None:
    """Replace a filtered sensitivity (n,) by the smoothed one, s + C (later - Phi s), and `later` by the same."""
    n = later.shape[0]
    ahead, x = np.zeros(n), np.zeros(n)
    for i in range(n):
        ahead[i] = row[i]
    multiply(phi, ahead)
    for i in range(n):
        x[i] = row[i]
        for j in range(n):
            x[i] += gain[i, j] * (later[j] - ahead[j])
    for i in range(n):
        row[i], later[i] = x[i], x[i]


smooth_sensitivity_eccentric = variant(smooth_sensitivity, "smooth_sensitivity_eccentric", phi=ECCENTRIC_PATTERN)


LATER = np.dtype(
    [
        ("track", TRACK),  # smoothed
        ("t", _F),
        ("same_piece", np.int64),
        ("acceleration", _F, 3),
        ("delta_v", _F, 3),
        ("inverse", _F, _WHOLE),  # from here on scratch: Phi^-1
        ("carried", _F, _WHOLE),  # factors of Phi^-1 Q Phi^-T
        ("gain", _F, (LANES, *_WHOLE)),  # of the epochs that are modelled side by side
        ("rest", _F, (LANES, PACKED)),
        ("predicted", _F, (LANES, MOTION)),
    ]
)
"""What stands after an epoch; behind it in memory, the smoothed sensitivities (m, 6)."""
_LATER_SIZE = LATER.itemsize // 8


def nothing_later(considered: int = 0) -> Vector:
    """What stands after a log's last epoch, with so many sensitivities."""
    return np.zeros(_LATER_SIZE + MOTION * considered)


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
) -> None:
    """Smooth filtered epochs in place, from their last to their first.

    state (n, 6), factor (n, 21) and codes (n, 4) as `_run` wrote them; control (n, 6) may be empty. A piece ends where
    the filter was not running or was started anew. considered (n, m, 6): sensitivities, m may be 0. after: what stands
    after the last epoch (`nothing_later`), replaced by what stands at the first.
    """
    m, later = views(block), after[:_LATER_SIZE].view(LATER)[0]
    rows = after[_LATER_SIZE:].reshape((considered.shape[1], MOTION))
    step, motion, inverse, carried = m.step, m.motion, later["inverse"], later["carried"]
    acceleration, delta_v, phi, effect = motion["acceleration"], motion["delta_v"], step["phi"], step["effect"]
    later_state, later_ld = later["track"]["state"], later["track"]["ld"]
    gain, rest, predicted = later["gain"], later["rest"], later["predicted"]
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
                    x, ld = state[first : e + 1], factor[first : e + 1]
                    model_epochs(x, ld, phi, inverse, effect, carried, gain, rest, predicted)
                else:
                    ready = 1
                    x1, ld1, c, s, xp = state[e], factor[e], gain[0], rest[0], predicted[0]
                    if circular:
                        model_epoch(x1, ld1, phi, inverse, effect, carried, c, s, xp)
                    else:
                        model_epoch_eccentric(x1, ld1, phi, inverse, effect, carried, c, s, xp)
            ready -= 1
            smooth_epoch(later_state, later_ld, gain[ready], rest[ready], predicted[ready], state[e], factor[e])
            for k in range(considered.shape[1]):
                if circular:
                    smooth_sensitivity(rows[k], considered[e, k], phi, gain[ready])
                else:
                    smooth_sensitivity_eccentric(rows[k], considered[e, k], phi, gain[ready])
        else:
            for i in range(MOTION):
                later_state[i] = state[e, i]
            unpack_factors(factor[e], later_ld)
            copy_rows(considered[e], rows)
        later["t"] = t[e]
        later["same_piece"] = 0 if status == STARTED else 1
        for j in range(3):
            later["acceleration"][j] = control[e, j] if control.shape[0] > 0 else 0.0
            later["delta_v"][j] = control[e, 3 + j] if control.shape[0] > 0 else 0.0
