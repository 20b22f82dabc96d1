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
"""

import math
from typing import NamedTuple

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.estimation.schmidt import clear, take_sensitivities
from relnav.vehicle.monitor import FADES_S


class DriftSums(NamedTuple):
    """Of the drifts that are looked for, k errors in all.

    Attributes
    ----------
    sensitivity : (n, k)
        S above, a column each.
    score, information : (k,), (k, k)
        d, and J of all together: that of one drift is its block on the diagonal.
    """

    sensitivity: Matrix
    score: Vector
    information: Matrix

    def copied(self) -> "DriftSums":
        """The same in arrays of its own."""
        return DriftSums(self.sensitivity.copy(), self.score.copy(), self.information.copy())


def no_sums(errors: int, drifting: int) -> DriftSums:
    """Sums of nothing yet, of so many errors that may drift."""
    return DriftSums(np.zeros((errors, drifting)), np.zeros(drifting), np.zeros((drifting, drifting)))


@kernel
def forget_drifts(sensitivity: Matrix, score: Vector, information: Matrix) -> None:
    """Begin anew: a drift before now is not looked for."""
    clear(sensitivity)
    clear(information)
    for j in range(len(score)):
        score[j] = 0.0


@kernel
def carry_drifts(dt: float, drives: Codes, sensitivity: Matrix, score: Vector, information: Matrix) -> None:
    """Carry sums over a step of dt, in place, of which sensitivity has been carried by F; drives (k,): what drifts."""
    fades = math.exp(-dt / FADES_S)
    for i in range(len(sensitivity)):
        for j in range(len(drives)):
            sensitivity[i, j] *= fades
    for j in range(len(drives)):
        sensitivity[drives[j], j] += dt
        score[j] *= fades
        for c in range(len(drives)):
            information[j, c] *= fades * fades


@kernel
def take_drifts(
    H: Matrix,
    chosen: Codes,
    work: Matrix,
    places: Codes,
    sensitivity: Matrix,
    score: Vector,
    information: Matrix,
    told: Matrix,
) -> None:
    """Take in the rows H (m, n) that `schmidt.take_gated` took in, with its chosen, work and places; told (m, k)."""
    count = take_sensitivities(H, chosen, work, places, sensitivity, told)
    y = work[3 * len(chosen)]
    for i in range(count):
        for j in range(len(score)):
            score[j] += told[i, j] * y[i]
            for c in range(len(score)):
                information[j, c] += told[i, j] * told[i, c]
