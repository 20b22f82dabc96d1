"""Rows into a covariance of any size, of whose errors some are only considered: never corrected, but counted in all.

With S = H P H^T + R = C C^T and W = C^-1 H P (m, n),

    x <- x + W^T C^-1 r     of the estimated errors alone,
    P <- P - W^T W          of every pair of errors of which at least one is estimated,

which is P - K H P - P H^T K^T + K S K^T with the considered rows of the gain K struck out (Schmidt 1966), multiplied
out; it is symmetric to the last bit. Rows come in groups which a gate takes or leaves as one.

Of a covariance only what stands on and right of the diagonal is kept, and the first rows, those of errors that move
others, whole: half of the memory and of the work. What stands left of the diagonal in other rows is anything.
"""

import math

from relnav.arrays import Codes, Flags, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import cholesky, solve_lower


@kernel
def clear(matrix: Matrix) -> None:
    """Write zeros."""
    for i in range(matrix.shape[0]):
        for k in range(matrix.shape[1]):
            matrix[i, k] = 0.0


@kernel
def _pick(row: Vector, places: Codes, weights: Vector) -> int:
    """Write where a row is not zero, and what stands there; how many places that is."""
    count = 0
    for j in range(len(row)):
        if row[j] != 0.0:
            places[count], weights[count] = j, row[j]
            count += 1
    return count


@kernel
def _add_rows(out: Vector, weights: Vector, places: Codes, count: int, rows: Matrix, first: int) -> None:
    """Add `count` weighted rows, from column `first` on, to out: three at a time, a fifth faster than one by one."""
    n, p = len(out), 0
    while p + 2 < count:
        a, b, c = weights[p], weights[p + 1], weights[p + 2]
        A, B, C = rows[places[p], first:], rows[places[p + 1], first:], rows[places[p + 2], first:]
        for k in range(n):
            out[k] += a * A[k] + b * B[k] + c * C[k]
        p += 3
    while p < count:
        a, A = weights[p], rows[places[p], first:]
        for k in range(n):
            out[k] += a * A[k]
        p += 1


@kernel
def _complete_rows(P: Matrix, H: Matrix, whole: int) -> None:
    """Write what stands left of the diagonal in the rows of P, after the first `whole`, that H (m, n) refers to."""
    rows, n = H.shape
    for j in range(whole, n):
        seen = False
        for i in range(rows):
            seen = seen or H[i, j] != 0.0
        if seen:
            row = P[j]
            for c in range(j):
                row[c] = P[c, j]


@kernel
def _innovation_into(
    P: Matrix, H: Matrix, R: Matrix, whole: int, HP: Matrix, S: Matrix, places: Codes, weights: Vector
) -> None:
    """Write H P (m, n) and the lower triangle of S = H P H^T + R (m, m); entries of H that are zero cost nothing.

    places and weights (n,) scratch.
    """
    rows, n = H.shape
    _complete_rows(P, H, whole)
    for i in range(rows):
        for c in range(n):
            HP[i, c] = 0.0
        count = _pick(H[i], places, weights)
        _add_rows(HP[i, :n], weights, places, count, P, 0)
        for k in range(i + 1):
            total = R[i, k]
            for p in range(count):
                total += HP[k, places[p]] * weights[p]
            S[i, k] = total


@kernel
def _squared(S: Matrix, residual: Vector, chosen: Codes, factor: Matrix, y: Vector) -> float:
    """NIS of the chosen rows, with C in factor and C^-1 r in y, without gaps; infinite if S is not positive."""
    count = 0
    for i in range(len(residual)):
        if chosen[i] == 0:
            continue
        y[count], place = residual[i], 0
        for j in range(i + 1):
            if chosen[j] > 0:
                factor[count, place] = S[i, j]
                place += 1
        count += 1
    within = factor[:count, :count]
    if not cholesky(within, 0.0, within):
        return math.inf
    return solve_lower(within, y[:count])


@kernel
def _choose(chosen: Codes, size: int, group: int, code: int) -> None:
    for i in range(size * group, size * (group + 1)):
        chosen[i] = code


@kernel
def _gate(
    S: Matrix, residual: Vector, size: int, limits: Vector, chosen: Codes, factor: Matrix, y: Vector
) -> tuple[float, int, int]:
    """Choose rows to believe; NIS of all that was seen, how many groups were seen, and how many are believed.

    Each group must be credible alone, and those left together; of a set that contradicts itself the group goes without
    which the rest agrees best. Two that contradict one another both go.
    """
    groups, seen = len(residual) // size, 0
    for g in range(groups):
        whole = True
        for i in range(size * g, size * (g + 1)):
            whole = whole and math.isfinite(residual[i])
        _choose(chosen, size, g, 1 if whole else 0)
        seen += 1 if whole else 0
    if seen == 0:
        return 0.0, 0, 0
    everything = _squared(S, residual, chosen, factor, y)
    if everything <= limits[size]:  # no part of it has more
        return everything, seen, seen
    passing = 0
    for g in range(groups):
        if chosen[size * g] > 0:
            good = _alone(S, residual, size, g, factor, y) <= limits[size]
            _choose(chosen, size, g, 1 if good else 0)
            passing += 1 if good else 0
    while passing > 0 and not _squared(S, residual, chosen, factor, y) <= limits[size * passing]:
        worst, least = -1, math.inf
        for g in range(groups):
            if passing > 2 and chosen[size * g] > 0:
                _choose(chosen, size, g, 0)
                without = _squared(S, residual, chosen, factor, y)
                _choose(chosen, size, g, 1)
                if worst < 0 or without < least:
                    worst, least = g, without
        if worst < 0:
            for i in range(len(residual)):
                chosen[i] = 0
            return everything, seen, 0
        _choose(chosen, size, worst, 0)
        passing -= 1
    return everything, seen, passing


@kernel
def _alone(S: Matrix, residual: Vector, size: int, group: int, factor: Matrix, y: Vector) -> float:
    """NIS of one group by itself."""
    first = size * group
    for i in range(size):
        y[i] = residual[first + i]
        for j in range(i + 1):
            factor[i, j] = S[first + i, first + j]
    within = factor[:size, :size]
    if not cholesky(within, 0.0, within):
        return math.inf
    return solve_lower(within, y[:size])


@kernel
def _whiten(HP: Matrix, n: int, chosen: Codes, factor: Matrix) -> int:
    """Turn the chosen rows of H P, in place and without gaps, into W = C^-1 H P (m, n), with C in factor; returns m."""
    count = 0
    for i in range(len(chosen)):
        if chosen[i] > 0:
            for c in range(n):
                HP[count, c] = HP[i, c]
            for k in range(count):
                f = factor[count, k]
                for c in range(n):
                    HP[count, c] -= f * HP[k, c]
            scale = 1.0 / factor[count, count]
            for c in range(n):
                HP[count, c] *= scale
            count += 1
    return count


@kernel
def _take_away(
    P: Matrix, considered: Flags, whole: int, W: Matrix, masked: Matrix, places: Codes, weights: Vector
) -> None:
    """Take W^T W, W (m, n), from P in place, but not from pairs of errors that are both considered.

    masked (m, n), places and weights (m,) scratch.
    """
    rows, n = W.shape[0], P.shape[0]
    for i in range(rows):
        places[i] = i
        for c in range(n):
            masked[i, c] = 0.0 if considered[c] else W[i, c]
    for a in range(n):
        by, first = masked if considered[a] else W, 0 if a < whole else a
        for i in range(rows):
            weights[i] = -W[i, a]
        _add_rows(P[a, first:n], weights, places, rows, by, first)


@kernel
def _correct_into(W: Matrix, y: Vector, considered: Flags, correction: Vector) -> None:
    """Write W^T y, of the estimated errors alone."""
    for c in range(len(correction)):
        correction[c] = 0.0
    for i in range(W.shape[0]):
        for c in range(len(correction)):
            correction[c] += W[i, c] * y[i]
    for c in range(len(correction)):
        if considered[c]:
            correction[c] = 0.0


@kernel
def gate_rows(
    P: Matrix,
    residual: Vector,
    H: Matrix,
    R: Matrix,
    size: int,
    limits: Vector,
    whole: int,
    chosen: Codes,
    work: Matrix,
    places: Codes,
) -> tuple[float, int, int]:
    """Decide which rows are credible.

    P (n, n), its first `whole` rows whole; residual (m,), NaN where there is nothing to be used, H (m, n), R (m, m) of
    groups of `size` rows that are independent of one another; limits (m + 1,): the largest credible NIS of k rows.
    Writes which rows are believed (m,), 1 or 0. work (4 m + 3, n) and places (n,) scratch, with what `take_gated`
    needs. Returns NIS of all that was seen, how many groups that is, and how many are believed.
    """
    m = len(residual)
    HP, S, factor, y = work[:m], work[m : 2 * m, :m], work[2 * m : 3 * m, :m], work[3 * m]
    _innovation_into(P, H, R, whole, HP, S, places, work[3 * m + 1])
    return _gate(S, residual, size, limits, chosen, factor, y)


@kernel
def take_gated(
    P: Matrix, considered: Flags, whole: int, chosen: Codes, work: Matrix, places: Codes, correction: Vector
) -> None:
    """Take in what `gate_rows` believed: P (n, n) in place, and the correction (n,); considered (n,)."""
    m = len(chosen)
    HP, factor, y, masked = work[:m], work[2 * m : 3 * m, :m], work[3 * m], work[3 * m + 2 : 4 * m + 2]
    W = HP[: _whiten(HP, len(correction), chosen, factor)]
    _correct_into(W, y, considered, correction)
    _take_away(P, considered, whole, W, masked, places, work[3 * m + 1])


@kernel
def take_sensitivities(H: Matrix, chosen: Codes, work: Matrix, places: Codes, sensitivity: Matrix, told: Matrix) -> int:
    """Let the rows that `take_gated` took in correct what k constants do to the errors, sensitivity (n, k), in place.

    H (m, n); chosen, work and places as it had them; no error considered. Writes what each does to the whitened
    innovations into told (m, k), without gaps: C^-1 H sensitivity. Returns how many rows were taken in.
    """
    m, columns = len(chosen), sensitivity.shape[1]
    factor, weights = work[2 * m : 3 * m, :m], work[3 * m + 1]
    for i in range(m):
        for c in range(columns):
            told[i, c] = 0.0
        if chosen[i] > 0:
            _add_rows(told[i], weights, places, _pick(H[i], places, weights), sensitivity, 0)
    count = _whiten(told, columns, chosen, factor)
    for i in range(count):
        places[i] = i
    for a in range(len(sensitivity)):
        for i in range(count):
            weights[i] = -work[i, a]
        _add_rows(sensitivity[a], weights, places, count, told, 0)
    return count


@kernel
def take_chosen(
    P: Matrix,
    considered: Flags,
    residual: Vector,
    H: Matrix,
    R: Matrix,
    whole: int,
    chosen: Codes,
    after: Matrix,
    correction: Vector,
    work: Matrix,
    places: Codes,
) -> bool:
    """Take the chosen rows in, linearised where the state is corrected by correction (n,), which is written anew.

    The iterated update (Bell and Cathey 1993, The iterated Kalman filter update as a Gauss-Newton method); arguments as
    for `gate_rows` and `take_gated`, what becomes of P goes into after. False, and nothing written, if a chosen
    residual is no number or S is not positive definite.
    """
    m, n = H.shape
    HP, S, factor, y, r = work[:m], work[m : 2 * m, :m], work[2 * m : 3 * m, :m], work[3 * m], work[3 * m + 1]
    for i in range(m):
        r[i] = residual[i]
        for c in range(n):
            r[i] += H[i, c] * correction[c]
    _innovation_into(P, H, R, whole, HP, S, places, work[4 * m + 2])
    if not _squared(S, r[:m], chosen, factor, y) < math.inf:
        return False
    copy_into(P, after)
    take_gated(after, considered, whole, chosen, work, places, correction)
    return True


@kernel
def copy_into(matrix: Matrix, out: Matrix) -> None:
    """Copy a matrix."""
    for i in range(matrix.shape[0]):
        for k in range(matrix.shape[1]):
            out[i, k] = matrix[i, k]


@kernel
def carry_into(
    P: Matrix, F: Matrix, Q: Matrix, after: Matrix, work: Matrix, places: Codes, weights: Matrix, counts: Codes
) -> None:
    """Write P after a step in which the first m errors move by F (m, k) of the first k <= n, and take noise Q (m, m).

    The others last; of P the first k rows are whole. after (n, n) is not P; work (k, m), places and weights (m, k)
    and counts (m,) scratch. Entries of F that are zero cost nothing.
    """
    moving, driving = F.shape
    n = P.shape[0]
    for i in range(moving):
        for c in range(n):
            after[i, c] = 0.0
        counts[i] = _pick(F[i], places[i], weights[i])
        _add_rows(after[i], weights[i], places[i], counts[i], P, 0)
    for k in range(driving):
        for i in range(moving):
            work[k, i] = after[i, k]
    for i in range(moving):
        for c in range(moving):
            after[i, c] = Q[i, c]
        _add_rows(after[i, :moving], weights[i], places[i], counts[i], work, 0)
        for c in range(i):
            mean = 0.5 * (after[i, c] + after[c, i])
            after[i, c] = mean
            after[c, i] = mean
    for a in range(moving, driving):
        for i in range(moving):
            after[a, i] = after[i, a]
        for c in range(moving, n):
            after[a, c] = P[a, c]
    for a in range(driving, n):
        row, lasting = after[a, a:], P[a, a:]
        for c in range(len(row)):
            row[c] = lasting[c]


@kernel
def carry_sensitivities(places: Codes, weights: Matrix, counts: Codes, sensitivity: Matrix, moved: Matrix) -> None:
    """Carry what k constants do to the errors, sensitivity (n, k), over a step, in place; moved (m, k) scratch.

    places, weights (m, n or fewer) and counts (m,): the entries of F that are not zero, as `carry_into` leaves them.
    """
    for i in range(len(moved)):
        for c in range(moved.shape[1]):
            moved[i, c] = 0.0
        _add_rows(moved[i], weights[i], places[i], counts[i], sensitivity, 0)
    for i in range(len(moved)):
        for c in range(moved.shape[1]):
            sensitivity[i, c] = moved[i, c]
