"""Covariance as P = L D L^T (L unit lower triangular, D diagonal >= 0): updates that cannot lose positive definiteness.

Bierman (1977), Factorization Methods for Discrete Sequential Estimation: the measurement update of ch. V and
Thornton's time update by modified weighted Gram-Schmidt, ch. VI, in the mirror: his U D U^T of the state with its
components reversed. For a state (position, velocity) it is the better half: D begins with the position's variances, so
positions that are known much better than velocities keep all digits of their covariance with them (with U D U^T 1e-5 is
left of it in `tests/estimation/test_numerics.py`), and rows that see positions alone touch half of the columns. It
costs what Joseph's form costs and keeps all digits where that one and the textbook form fail. L and D share one matrix
`ld` (n, n): D on the diagonal, L below it; what stands above is not used.
"""

from functools import cache

import numpy as np

from relnav.arrays import Flags, Matrix, Vector
from relnav.codegen.kernel import entry, square, straight_line, vector
from relnav.codegen.together import quotient, select
from relnav.codegen.trace import Shape


@entry
def factorize_into(p: Matrix, ld: Matrix) -> bool:
    """Write the factors of the symmetric p (n, n) into ld; False if p is not positive semidefinite.

    A pivot that is zero to rounding counts as zero, with its column: a direction without uncertainty.
    """
    size = p.shape[0]
    growth = 1.0  # of rounding, by the smallest pivot so far beside its variance
    for i in range(size):
        for j in range(size):
            ld[i, j] = p[i, j] if j <= i else 0.0
    for j in range(size):
        d = ld[j, j]
        zero = abs(d) <= 1e-14 * growth * p[j, j]
        if not (d >= 0.0 or zero):
            return False
        for i in range(j + 1, size):
            entry = ld[i, j]
            if not zero:
                ld[i, j] = entry / d
            elif entry * entry <= 1e-14 * growth * p[i, i] * p[j, j]:
                ld[i, j] = 0.0
            else:
                return False
        if zero:
            d = 0.0
            ld[j, j] = 0.0
        else:
            growth = max(growth, p[j, j] / d)
        if d > 0.0:
            for i in range(j + 1, size):
                for k in range(i, size):
                    ld[k, i] -= ld[k, j] * d * ld[i, j]
    return True


@straight_line(ld=square, p=square)
def compose_into(ld: Matrix, p: Matrix) -> None:
    """Write P = L D L^T (n, n) into p."""
    for i in range(ld.shape[0]):
        for j in range(i + 1):
            total = ld[j, j] * (1.0 if i == j else ld[i, j])
            for k in range(j):
                total += ld[i, k] * ld[k, k] * ld[j, k]
            p[i, j] = total
            p[j, i] = total


def dot(a: Vector, b: Vector) -> float:
    """Sum of a_k b_k in four strands: additions in one row would wait for one another. A part of `straight_line`s."""
    strands = np.zeros(4)
    for k in range(a.shape[0]):
        strands[k % 4] += a[k] * b[k]
    total: float = (strands[0] + strands[1]) + (strands[2] + strands[3])
    return total


def orthogonalise(w: Matrix, weights: Vector, ld: Matrix) -> None:
    """Write the factors of W diag(weights) W^T into ld: modified weighted Gram-Schmidt, first row to last.

    w (n, m) is used up; weights (m,) >= 0. The product is positive semidefinite by construction, whatever the
    rounding. A part of `straight_line` functions.
    """
    n = w.shape[0]
    weighted = np.zeros(w.shape[1])
    for i in range(n):
        for k in range(w.shape[1]):
            weighted[k] = w[i, k] * weights[k]
        d = dot(w[i], weighted)
        inverse = quotient(1.0, d, 0.0)
        for j in range(i + 1, n):
            c = dot(w[j], weighted) * inverse
            ld[j, i] = c
            for k in range(w.shape[1]):
                w[j, k] -= c * w[i, k]
        ld[i, i] = d


def spread(m: Matrix, ld: Matrix, w: Matrix, weights: Vector) -> None:
    """Write M L and D of the factors ld into w (n, n) and weights (n,): the part of M P M^T in a sum."""
    n = ld.shape[0]
    for i in range(n):
        for k in range(n):
            total = m[i, k]
            for j in range(k + 1, n):
                total += m[i, j] * ld[j, k]
            w[i, k] = total
    for k in range(n):
        weights[k] = ld[k, k]


@straight_line(ld=square, phi=square, q_ld=square)
def time_update_into(ld: Matrix, phi: Matrix, q_ld: Matrix) -> None:
    """Replace the factors of P by those of Phi P Phi^T + Q, in place (Thornton): W = [Phi L | L_q], weights (D, D_q).

    q_ld (n, n) are the factors of Q.
    """
    n = ld.shape[0]
    w, weights = np.zeros((n, 2 * n)), np.zeros(2 * n)
    spread(phi, ld, w[:, :n], weights[:n])
    for i in range(n):
        weights[n + i] = q_ld[i, i]
        w[i, n + i] = 1.0
        for k in range(i):
            w[i, n + k] = q_ld[i, k]
    orthogonalise(w, weights, ld)


def solve_factored(ld: Matrix, rhs: Vector) -> None:
    """Replace rhs (n,) by P^-1 rhs; along directions without uncertainty (D = 0) the result is 0.

    A part of `straight_line` functions.
    """
    n = ld.shape[0]
    for i in range(n):
        for j in range(i):
            rhs[i] -= ld[i, j] * rhs[j]
    for i in range(n):
        rhs[i] *= quotient(1.0, ld[i, i], 0.0)
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            rhs[i] -= ld[j, i] * rhs[j]


@straight_line(x=vector, ld=square, h=vector)
def scalar_update(x: Vector, ld: Matrix, h: Vector, r: float, residual: float) -> float:
    """Update x (n,) and its factors by one scalar measurement, in place; return its innovation variance.

    residual = z - prediction from the present x; h (n,) its gradient; r >= 0 its variance (Bierman 1977, eq. V.3).
    With r = 0 and no prior uncertainty along h, nothing changes and 0 is returned. A perfect measurement (r = 0) makes
    the last component that it sees known: beta = 0 there, and D becomes 0. Take it once: to rounding, the same again
    would be news.
    """
    n = ld.shape[0]
    gain = np.zeros(n)
    alpha, inverse = r, quotient(1.0, r, 0.0)
    for j in range(n - 1, -1, -1):
        f = h[j]
        for i in range(j + 1, n):
            f += ld[i, j] * h[i]
        g = ld[j, j] * f
        lam = -f * inverse
        beta = alpha
        alpha = alpha + f * g
        inverse = quotient(1.0, alpha, 0.0)
        gain[j] = g
        ld[j, j] *= select(alpha > 0.0, beta * inverse, 1.0)
        for i in range(j + 1, n):
            u = ld[i, j]
            ld[i, j] = u + lam * gain[i]
            gain[i] += g * u
    scaled = residual * inverse
    for j in range(n):
        x[j] += gain[j] * scaled
    return alpha


@straight_line(ld=square, v=vector)
def add_rank_one(ld: Matrix, v: Vector) -> None:
    """Replace the factors of P by those of P + v v^T, in place (Agee and Turner; Bierman 1977, ch. III)."""
    n = ld.shape[0]
    rest, c = np.zeros(n), 1.0
    for i in range(n):
        rest[i] = v[i]
    for j in range(n):
        p, d = rest[j], ld[j, j]
        total = d + c * p * p
        inverse = quotient(1.0, total, 0.0)
        along = c * p * inverse
        c *= select(total > 0.0, d * inverse, 1.0)
        ld[j, j] = total
        for i in range(j + 1, n):
            rest[i] -= p * ld[i, j]
            ld[i, j] += along * rest[i]


def _three(n: int) -> Shape:
    return 3, n


@straight_line(ld=square, v=_three)
def add_three_rank_ones(ld: Matrix, v: Matrix) -> None:
    """`add_rank_one` of the rows of v (3, n), to the bit: column by column, so that none waits for another to end."""
    n = ld.shape[0]
    rest, c = np.zeros((3, n)), np.zeros(3)
    for k in range(3):
        c[k] = 1.0
        for i in range(n):
            rest[k, i] = v[k, i]
    for j in range(n):
        for k in range(3):
            p, d = rest[k, j], ld[j, j]
            total = d + c[k] * p * p
            inverse = quotient(1.0, total, 0.0)
            along = c[k] * p * inverse
            c[k] *= select(total > 0.0, d * inverse, 1.0)
            ld[j, j] = total
            for i in range(j + 1, n):
                rest[k, i] -= p * ld[i, j]
                ld[i, j] += along * rest[k, i]


@straight_line(ld=square, h1=vector, h2=vector)
def innovation_variance(ld: Matrix, h1: Vector, h2: Vector) -> float:
    """h1 P h2^T, the prior covariance of two scalar measurements."""
    n, total = ld.shape[0], 0.0
    for j in range(n):
        f1, f2 = h1[j], h2[j]
        for i in range(j + 1, n):
            f1 += ld[i, j] * h1[i]
            f2 += ld[i, j] * h2[i]
        total += f1 * ld[j, j] * f2
    return total


def decorrelate(r: Matrix, factor: Matrix, variances: Vector) -> bool:
    """Write L (unit lower triangular) and d with r = L diag(d) L^T into factor and variances; False if not definite.

    Measurements z with covariance r (m, m) become independent as L^-1 z (forward substitution), with variances d. A
    part of `straight_line` functions.
    """
    size = r.shape[0]
    definite: bool = r[0, 0] > 0.0
    for j in range(size):
        d = r[j, j]
        for k in range(j):
            d -= factor[j, k] * factor[j, k] * variances[k]
        definite = definite & (d > 0.0)
        variances[j] = d
        factor[j, j] = 1.0
        for i in range(j + 1, size):
            total = r[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k] * variances[k]
            factor[i, j] = quotient(total, d, 0.0)
    return definite


def factorize(covariance: Matrix) -> Matrix:
    """Factors `ld` (n, n) of a covariance (n, n).

    Raises
    ------
    ValueError
        If the covariance is not symmetric positive semidefinite.
    """
    p = np.ascontiguousarray(covariance, dtype=np.float64)
    if p.ndim != 2 or p.shape[0] != p.shape[1] or not np.allclose(p, p.T, rtol=1e-12, atol=0.0):
        raise ValueError(f"a covariance is a symmetric matrix (n, n); got {p.tolist()}")
    ld = np.zeros(p.shape)
    if not factorize_into(p, ld):
        raise ValueError("the covariance is not positive semidefinite")
    return ld


def stated_covariance(p: Matrix) -> tuple[Matrix, Matrix]:
    """What a caller states as a covariance (n, n), symmetric to the last bit, and its factors `ld` (n, n).

    Raises
    ------
    ValueError
        For one with a variance that is not above zero, not symmetric to 1e-9, or not positive semidefinite.
    """
    if np.any(np.diagonal(p) <= 0.0):
        raise ValueError(f"covariance has variances above zero; its diagonal is {np.diagonal(p).tolist()}")
    covariance = 0.5 * (p + p.T) if np.allclose(p, p.T, rtol=1e-9, atol=0.0) else p
    return covariance, factorize(covariance)


@cache
def _triangle(n: int) -> tuple[Flags, Matrix]:
    """Which entries of a matrix (n, n) stand below its diagonal, and the unit matrix."""
    return np.tri(n, k=-1, dtype=bool), np.eye(n)


def compose(ld: Matrix) -> Matrix:
    """Covariances (..., n, n) of factors (..., n, n), exactly symmetric."""
    factors = np.asarray(ld, dtype=np.float64)
    d = np.diagonal(factors, axis1=-2, axis2=-1)
    below, unit = _triangle(factors.shape[-1])
    lower = np.where(below, factors, unit) + 0.0  # no zero keeps a minus
    p: Matrix = (lower * d[..., None, :]) @ np.swapaxes(lower, -1, -2)
    return 0.5 * (p + np.swapaxes(p, -1, -2))
