"""Errors of a gyro that grow with the rate: scale and misalignment of its axes, nine numbers that last.

A sample is m = (1 + M) w + b + n, with the three scales on the diagonal of M and the six misalignments beside it, by
row. So w = (m - b) - M ((m - b) - M (m - b)) but for M^3, and over a step in which the chaser turns by theta its
attitude's error alpha gains -(1 - [theta x] / 2) dM theta: the axes turn meanwhile, by half as much in the mean.

These errors do not move, but drive three that do. What they add to a step is a turn of errors of its own behind it,

    x <- T x,   P <- T P T^T,   T = 1 but for that in the rows of alpha,

so that a gyro without them costs nothing.
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, plain
from relnav.vehicle.layout import CHASER_ATTITUDE, DRIVING, GYRO_ERRORS

_CHASER, _FIRST = CHASER_ATTITUDE.start, GYRO_ERRORS.start
COUNT = GYRO_ERRORS.stop - GYRO_ERRORS.start


@kernel
def measured_more(errors: Vector, rate: Vector, i: int) -> float:
    """What axis i measures of a rate (3,) beyond its own share: (M rate)_i, M of errors (9,)."""
    j, k = 1 if i == 0 else 0, 1 if i == 2 else 2
    more: float = errors[i] * rate[i] + errors[3 + 2 * i] * rate[j] + errors[4 + 2 * i] * rate[k]
    return more


@kernel
def take_out(errors: Vector, rate: Vector, once: Vector) -> None:
    """Take what errors (9,) make of a rate (3,), or of a turn, out of it, in place; once (3,) scratch."""
    for i in range(3):
        once[i] = rate[i] - measured_more(errors, rate, i)
    x, y, z = measured_more(errors, once, 0), measured_more(errors, once, 1), measured_more(errors, once, 2)
    rate[0] -= x
    rate[1] -= y
    rate[2] -= z


def true_rate(errors: Vector, measured: Vector) -> Vector:
    """The rate (3,) that is measured, without what errors (9,) make of it."""
    rate = measured.copy()
    plain(take_out)(errors, rate, np.empty(3))
    return rate


@kernel
def measured_into(rate: Vector, out: Matrix) -> None:
    """Write d(M rate)/d(errors) (3, 9)."""
    for i in range(3):
        for c in range(COUNT):
            out[i, c] = 0.0
        j, k = 1 if i == 0 else 0, 1 if i == 2 else 2
        out[i, i], out[i, 3 + 2 * i], out[i, 4 + 2 * i] = rate[i], rate[j], rate[k]


@kernel
def driven_into(turn: Vector, out: Matrix) -> None:
    """Write what each error of the gyro takes from the attitude (3, 9) in a step that turns it by turn (3,)."""
    measured_into(turn, out)
    for c in range(COUNT):
        x, y, z = out[0, c], out[1, c], out[2, c]
        out[0, c] -= 0.5 * (turn[1] * z - turn[2] * y)
        out[1, c] -= 0.5 * (turn[2] * x - turn[0] * z)
        out[2, c] -= 0.5 * (turn[0] * y - turn[1] * x)


def by_errors(rate: Vector) -> Matrix:
    """d(rate that is measured)/d(errors), (3, 9)."""
    out = np.empty((3, COUNT))
    plain(measured_into)(rate, out)
    return out


@kernel
def drive_attitude(P: Matrix, driven: Matrix, gained: Matrix) -> None:
    """Add to P (n, n) after a step what errors of the gyro do to the attitude in it, in place.

    driven (3, 9): `driven_into` of the whole turn; gained (3, n) scratch. The first DRIVING rows of P are whole, of the
    others what stands right of the diagonal.
    """
    n = len(P)
    for i in range(3):
        for c in range(n):
            total = 0.0
            for k in range(COUNT):
                g = _FIRST + k
                total -= driven[i, k] * (P[g, c] if c >= g else P[c, g])
            gained[i, c] = total
    for i in range(3):
        for c in range(n):
            if not _CHASER <= c < _CHASER + 3:
                P[_CHASER + i, c] += gained[i, c]
                if c < DRIVING:
                    P[c, _CHASER + i] = P[_CHASER + i, c]
    for i in range(3):
        for c in range(i + 1):
            more = gained[i, _CHASER + c] + gained[c, _CHASER + i]
            for k in range(COUNT):
                more -= driven[c, k] * gained[i, _FIRST + k]
            P[_CHASER + i, _CHASER + c] += more
            if c < i:
                P[_CHASER + c, _CHASER + i] = P[_CHASER + i, _CHASER + c]


@kernel
def drive_sensitivities(sums: Matrix, driven: Matrix) -> None:
    """The same of sensitivities to what drifts, in rows as the errors of P: sums as of `drift_sums.carry_drifts`."""
    for i in range(3):
        for k in range(COUNT):
            for j in range(sums.shape[1]):
                sums[_CHASER + i, j] -= driven[i, k] * sums[_FIRST + k, j]
