"""Smoothing of a filtered log: backward over each unbroken piece of the track."""

from relnav._kernel import kernel
from relnav.arrays import Codes, Matrix, Vector
from relnav.dynamics.clohessy_wiltshire import transition_into
from relnav.estimation.smoothing import smooth_step
from relnav.navigation.block import INPUT, PHI, Q_FACTORS, SETTINGS, STEP_KEY
from relnav.navigation.propagation import advance, prepare_step
from relnav.navigation.status import STARTED, WAITING


@kernel
def pack_factors(ud: Matrix, packed: Vector) -> None:
    """Write the upper triangle of ud (6, 6), row by row, into packed (21,)."""
    at = 0
    for i in range(6):
        for j in range(i, 6):
            packed[at] = ud[i, j]
            at += 1


@kernel
def unpack_factors(packed: Vector, ud: Matrix) -> None:
    """Write packed (21,) into the upper triangle of ud (6, 6), zeros below."""
    at = 0
    for i in range(6):
        for j in range(6):
            if j < i:
                ud[i, j] = 0.0
            else:
                ud[i, j] = packed[at]
                at += 1


@kernel
def smooth_run(
    block: Matrix, t: Vector, control: Matrix, status: Codes, state: Matrix, factor: Matrix, work: Matrix
) -> None:
    """Smooth a filtered log in place, from its last epoch to its first.

    state (n, 6) and factor (n, 21) as `_run` wrote them; control (n, 6) may be empty. A piece ends where the filter was
    not running or was started anew. work (73, 6) scratch.
    """
    filtered, predicted, later = work[46:53], work[53:60], work[60:67]
    have_later = False
    for e in range(t.shape[0] - 1, -1, -1):
        if status[e] == WAITING:
            have_later = False
            continue
        if have_later:
            if control.shape[0] > 0:
                for j in range(6):
                    block[INPUT, j] = control[e + 1, j]
            prepare_step(block, t[e + 1] - t[e])
            for j in range(6):
                filtered[0, j] = state[e, j]
            unpack_factors(factor[e], filtered[1:7])
            for i in range(7):
                for j in range(6):
                    predicted[i, j] = filtered[i, j]
            advance(block, predicted)
            inverse = work[67:73]
            transition_into(block[SETTINGS, 4], -block[STEP_KEY, 0], inverse)
            smooth_step(
                filtered, predicted, later, block[PHI : PHI + 6], inverse, block[Q_FACTORS : Q_FACTORS + 6], work[0:46]
            )
            for j in range(6):
                state[e, j] = later[0, j]
            pack_factors(later[1:7], factor[e])
        else:
            for j in range(6):
                later[0, j] = state[e, j]
            unpack_factors(factor[e], later[1:7])
            have_later = True
        if status[e] == STARTED:
            have_later = False
