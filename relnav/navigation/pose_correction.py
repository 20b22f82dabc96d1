"""A pose state corrected by measurements of position and attitude, in compiled code: gate, gain, covariance."""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import cholesky, solve_lower, solve_lower_transposed
from relnav.navigation.pose_state import PoseState


@kernel
def _innovation_covariance(P: Matrix, rows: Matrix, noise: Matrix, by_rows: Matrix, S: Matrix) -> None:
    """Write P H^T, transposed, into by_rows (m, 12) and S = H P H^T + R into S (m, m); rows (m, 6) by (drho, theta)."""
    for r in range(len(rows)):
        for i in range(12):
            total = 0.0
            for c in range(6):
                total += P[i, c if c < 3 else c + 3] * rows[r, c]
            by_rows[r, i] = total
    for r in range(len(rows)):
        for c in range(r + 1):
            total = noise[r, c]
            for k in range(6):
                total += rows[r, k] * by_rows[c, k if k < 3 else k + 3]
            S[r, c] = total
            S[c, r] = total


@kernel
def _gate(P: Matrix, rows: Matrix, noise: Matrix, y: Vector, by_rows: Matrix, S: Matrix, alone: Matrix) -> float:
    """NIS of y (m,), which is lost; each pair's own NIS and determinant into alone (m / 2, 2); NaN where S is none."""
    _innovation_covariance(P, rows, noise, by_rows, S)
    for k in range(len(alone)):
        a, b, c, u, v = S[2 * k, 2 * k], S[2 * k, 2 * k + 1], S[2 * k + 1, 2 * k + 1], y[2 * k], y[2 * k + 1]
        alone[k, 1] = a * c - b * b
        alone[k, 0] = (c * u * u - 2.0 * b * u * v + a * v * v) / alone[k, 1]
    return solve_lower(S, y) if cholesky(S, 0.0, S) else math.nan


@kernel
def _correct(P: Matrix, rows: Matrix, noise: Matrix, y: Vector, shift: Vector, after: Matrix, work: Matrix) -> float:
    """Write correction (12,) and covariance (12, 12) about the corrected state; NIS + ln |S|, NaN where S is none.

    Joseph's form, then the reset G P G^T of `relnav.estimation.attitude.reset`; work (4 m + 24, 12 + m): scratch.
    """
    m = len(rows)
    by_rows, S, gain = work[0:m, 0:12], work[m : 2 * m, 0:m], work[2 * m : 3 * m, 0:12]
    white, rest, half = work[3 * m, 0:m], work[4 * m : 4 * m + 12, 0:12], work[4 * m + 12 : 4 * m + 24, 0:12]
    _innovation_covariance(P, rows, noise, by_rows, S)
    if not cholesky(S, 0.0, S):
        return math.nan
    for r in range(m):
        white[r] = y[r]
    score = solve_lower(S, white)
    for r in range(m):
        score += 2.0 * math.log(S[r, r])
    for i in range(12):  # K^T = S^-1 H P
        column = gain[:, i]
        for r in range(m):
            column[r] = by_rows[r, i]
        solve_lower(S, column)
        shift[i] = 0.0
        for r in range(m):
            shift[i] += column[r] * white[r]
        solve_lower_transposed(S, column)
    for i in range(12):  # G (I - K H), the reset being linear
        for j in range(12):
            rest[i, j] = 1.0 if i == j else 0.0
        for c in range(6):
            total = 0.0
            for r in range(m):
                total += gain[r, i] * rows[r, c]
            rest[i, c if c < 3 else c + 3] -= total
    _reset_rows(rest, shift)
    for r in range(m):
        x, y_, z = gain[r, 6], gain[r, 7], gain[r, 8]
        gain[r, 6] -= 0.5 * (shift[7] * z - shift[8] * y_)
        gain[r, 7] -= 0.5 * (shift[8] * x - shift[6] * z)
        gain[r, 8] -= 0.5 * (shift[6] * y_ - shift[7] * x)
    _sandwich(rest, P, gain, noise, half, by_rows, after)
    return score


@kernel
def _reset_rows(A: Matrix, shift: Vector) -> None:
    """G A in place, G = I - [theta x] / 2 in rows 6 to 8, theta = shift[6:9]."""
    for j in range(12):
        x, y, z = A[6, j], A[7, j], A[8, j]
        A[6, j] -= 0.5 * (shift[7] * z - shift[8] * y)
        A[7, j] -= 0.5 * (shift[8] * x - shift[6] * z)
        A[8, j] -= 0.5 * (shift[6] * y - shift[7] * x)


@kernel
def _sandwich(A: Matrix, P: Matrix, gain: Matrix, R: Matrix, half: Matrix, spare: Matrix, out: Matrix) -> None:
    """Write A P A^T + K R K^T (12, 12) into out, symmetric to the last bit; gain (m, 12): K^T; half, spare: scratch."""
    m = len(gain)
    for i in range(12):
        for j in range(12):
            total = 0.0
            for k in range(12):
                total += A[i, k] * P[k, j]
            half[i, j] = total
    for r in range(m):
        for i in range(12):
            total = 0.0
            for k in range(m):
                total += R[r, k] * gain[k, i]
            spare[r, i] = total
    for i in range(12):
        for j in range(i + 1):
            total = 0.0
            for k in range(12):
                total += half[i, k] * A[j, k]
            for r in range(m):
                total += gain[r, i] * spare[r, j]
            out[i, j] = total
            out[j, i] = total


def gate(state: PoseState, rows: Matrix, noise: Matrix, innovation: Vector) -> tuple[float, Vector, Vector]:
    """NIS of an innovation (m,), NIS of each of its pairs (m / 2,), and determinant of each pair's covariance (m / 2,).

    rows (m, 6) by (drho, theta), noise (m, m). NIS is NaN if the innovation's covariance is not positive definite.
    """
    m = len(rows)
    alone = np.empty((m // 2, 2))
    covariance, y = state.covariance.copy(), innovation.copy()
    nis = _gate(covariance, rows, noise, y, np.empty((m, 12)), np.empty((m, m)), alone)
    return nis, alone[:, 0], alone[:, 1]


def correct(state: PoseState, rows: Matrix, noise: Matrix, innovation: Vector) -> tuple[PoseState, float]:
    """State after a measurement, and NIS + ln |S|; rows (m, 6) by (drho, theta), noise (m, m), innovation (m,).

    NaN, and the state as it was, where the innovation's covariance is not positive definite.
    """
    m, shift, after = len(rows), np.empty(12), np.empty((12, 12))
    score = _correct(state.covariance.copy(), rows, noise, innovation, shift, after, np.empty((4 * m + 24, 12 + m)))
    return (state, score) if math.isnan(score) else (state.moved(shift, after), score)
