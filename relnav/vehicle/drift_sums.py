"""What a drift of each sensor, the gyro or the thrusters would do to innovations, and how far they look like it.

Of a filter that estimates every error that lasts the innovations are white, whatever those errors are, as long as they
last. Let one of them, b, drift instead, by 1 a second. With S what that does to all errors of the state (Friedland
1969, Treatment of bias in recursive filtering),

    S <- F S, and S_b <- S_b + dt I,     in a step
    G = C^-1 H S,  S <- S - W^T G        in an update (C, W as in `estimation.schmidt`)

G is what the drift does to the whitened innovations y. So the faded sums

    d = sum w G^T y,     J = sum w^2 G^T G,     w = exp(-age / FADES_S)

have covariance J without a drift, and d^T J^-1 d is a chi-square: the score test (Rao 1948, Large sample tests of
statistical hypotheses), as of a generalised likelihood ratio for jumps (Willsky and Jones 1976, A generalized
likelihood ratio approach to the detection and estimation of jumps in linear systems). S fades too, so that what is
looked for is a drift of the last FADES_S. Any G leaves the chi-square as it is without a drift.

Of k errors that may drift the sums are one matrix (n + 1 + k, k), a column each: S (n, k), below it d, and below that J
of all together, in which that of one drift is its block on the diagonal.
"""

import math

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.estimation.schmidt import carry_sensitivities, clear, take_sensitivities
from relnav.vehicle.monitor import FADES_S


def no_sums(errors: int, drifting: int) -> Matrix:
    """Sums of nothing yet, of so many errors that may drift."""
    return np.zeros((errors + 1 + drifting, drifting))


def score_of(sums: Matrix) -> tuple[Vector, Matrix]:
    """Score d (k,) and information J (k, k) of all drifts."""
    drifting = sums.shape[1]
    below = sums[len(sums) - drifting - 1 :].copy()
    return below[0], below[1:]


@kernel
def carry_drifts(
    sums: Matrix, dt: float, drives: Codes, places: Codes, weights: Matrix, counts: Codes, moved: Matrix
) -> None:
    """Carry sums over a step of dt, in place; drives (k,): the errors that drift; moved (m, k) scratch.

    places, weights, counts: F, as of `schmidt.carry_sensitivities`.
    """
    n = sums.shape[0] - 1 - len(drives)
    carry_sensitivities(places, weights, counts, sums[:n], moved)
    fades = math.exp(-dt / FADES_S)
    for i in range(len(sums)):
        fading = fades * fades if i > n else fades
        for j in range(len(drives)):
            sums[i, j] *= fading
    for j in range(len(drives)):
        sums[drives[j], j] += dt


@kernel
def take_drifts(H: Matrix, chosen: Codes, work: Matrix, places: Codes, wide: bool, sums: Matrix, told: Matrix) -> None:
    """Take in the rows H (m, n) that `schmidt.take_gated` took in, with its chosen, work and places; told (m, k).

    wide: rows bent within what was known, so that the sums begin anew: a drift before now is not looked for.
    """
    if wide:
        clear(sums)
        return
    n, drifting = H.shape[1], sums.shape[1]
    score, information, y = sums[n], sums[n + 1 :], work[3 * len(chosen)]
    for i in range(take_sensitivities(H, chosen, work, places, sums[:n], told)):
        for j in range(drifting):
            score[j] += told[i, j] * y[i]
            for c in range(drifting):
                information[j, c] += told[i, j] * told[i, c]
