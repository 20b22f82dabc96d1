"""Small solvers for kernels, without allocation: Cholesky, triangular substitution, a 3 x 3 inverse; and vectors."""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import select


@kernel
def cholesky(matrix: Matrix, least: float, factor: Matrix) -> bool:
    """Write the lower triangle L of matrix = L L^T (n, n) into factor; False if a pivot is not above least x diagonal.

    Only the lower triangle of the matrix is read, and factor may be the matrix itself.
    """
    for i in range(len(matrix)):
        diagonal = matrix[i, i]
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = total / factor[j, j]
            elif total > least * diagonal:
                factor[i, i] = math.sqrt(total)
            else:
                return False
    return True


@kernel
def solve_lower(factor: Matrix, vector: Vector) -> float:
    """Solve L x = vector in place for a lower triangle L (n, n); returns the sum of squares of x."""
    squares = 0.0
    for i in range(len(vector)):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]
        squares += vector[i] * vector[i]
    return squares


@kernel
def solve_lower_transposed(factor: Matrix, vector: Vector) -> None:
    """Solve L^T x = vector in place for a lower triangle L (n, n)."""
    for i in range(len(vector) - 1, -1, -1):
        for k in range(i + 1, len(vector)):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@kernel
def solve_positive(matrix: Matrix, right: Vector, least: float, factor: Matrix) -> bool:
    """Solve matrix x = right in place for a symmetric matrix (n, n); `least` and factor as in `cholesky`, and False."""
    if not cholesky(matrix, least, factor):
        return False
    solve_lower(factor, right)
    solve_lower_transposed(factor, right)
    return True


@straight_line(m=(3, 3), out=(3, 3))
def invert_three(m: Matrix, out: Matrix) -> bool:
    """Write the inverse of m (3, 3) into out by cofactors; False if m is singular to 1e-10 of its rows' lengths.

    out may be m itself.
    """
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c01 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c02 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    c10, c11, c12 = (
        m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2],
        m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0],
        m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1],
    )
    c20, c21, c22 = (
        m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1],
        m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2],
        m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0],
    )
    det = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    scale2 = 1.0
    for i in range(3):
        scale2 = scale2 * (m[i, 0] * m[i, 0] + m[i, 1] * m[i, 1] + m[i, 2] * m[i, 2])
    regular: bool = abs(det) > 1e-10 * math.sqrt(scale2)
    d = 1.0 / select(regular, det, 1.0)
    out[0, 0], out[0, 1], out[0, 2] = c00 * d, c10 * d, c20 * d
    out[1, 0], out[1, 1], out[1, 2] = c01 * d, c11 * d, c21 * d
    out[2, 0], out[2, 1], out[2, 2] = c02 * d, c12 * d, c22 * d
    return regular


@kernel
def cross_into(a: Vector, b: Vector, out: Vector) -> None:
    """Write a x b (3,), which also is the row a [b x]; out is neither of the two."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def tangent_basis_into(s: Vector, out: Matrix) -> None:
    """Write two unit vectors, columns of out (3, 2), that make a right-handed triad with the unit vector s as third."""
    k = 0
    for i in range(1, 3):
        k = i if abs(s[i]) < abs(s[k]) else k
    i, j = (k + 1) % 3, (k + 2) % 3  # the axis farthest from s, times s
    size = math.sqrt(s[i] * s[i] + s[j] * s[j])
    out[k, 0], out[i, 0], out[j, 0] = 0.0, -s[j] / size, s[i] / size
    for c in range(3):
        d, e = (c + 1) % 3, (c + 2) % 3
        out[c, 1] = s[d] * out[e, 0] - s[e] * out[d, 0]


def cross_matrix(v: ArrayLike) -> Stack:
    """[v x] (..., 3, 3) of vectors (..., 3): [v x] w = v x w."""
    v = np.asarray(v, dtype=np.float64)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def lengths(vectors: Matrix) -> Vector:
    """Lengths (...,) of vectors (..., n); infinite where a square is beyond the largest float."""
    with np.errstate(over="ignore"):
        out: Vector = np.sqrt(np.add.reduce(vectors * vectors, axis=-1))  # as numpy's norm, without its questions
    return out
