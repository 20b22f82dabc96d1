"""Errors that last count once in a likelihood, and not once an image.

Under lasting errors e, of one sigma each, an innovation is v = G e + v0 with v0 ~ N(0, S0). Were e drawn anew in every
image, v ~ N(0, S0 + G G^T), one pattern of residuals that lasts would speak for or against a hypothesis as often as it
is seen. The likelihood of all images is the product of those of each with what the earlier ones have told of e:

    v ~ N(G u, S0 + G C G^T),    e ~ N(u, C) by the images before, N(0, 1) by none

which is a Kalman filter for constants. `evidence` (m + 1, m): the rows of C, and the mean behind them; ones on the
diagonal while no image has told anything.
"""

import math

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import cholesky


@kernel
def fade(evidence: Matrix, share: float) -> None:
    """Keep a share of what images have told."""
    for i in range(evidence.shape[0]):
        for j in range(evidence.shape[1]):
            evidence[i, j] *= share
        if i < evidence.shape[1]:
            evidence[i, i] += 1.0 - share


@kernel
def surprise(evidence: Matrix, S: Matrix, v: Vector, G: Matrix, shown: Vector) -> float:
    """Minus twice the logarithm of how likely an innovation is, up to a constant; learns what it tells.

    S (k, k): S0, its lower triangle; v (k,), G (k, m): used up; shown (m,): scratch. Infinite where S0 is not positive
    definite.
    """
    rows, count, mean = len(v), G.shape[1], evidence[G.shape[1]]
    if not cholesky(S, 0.0, S):
        return math.inf
    total = 0.0
    for i in range(rows):
        for k in range(i):
            f = S[i, k]
            v[i] -= f * v[k]
            for c in range(count):
                G[i, c] -= f * G[k, c]
        v[i] /= S[i, i]
        variance, residual = 1.0, v[i]
        for c in range(count):
            G[i, c] /= S[i, i]
        for c in range(count):
            shown[c] = 0.0
            for d in range(count):
                shown[c] += evidence[c, d] * G[i, d]
            variance += G[i, c] * shown[c]
            residual -= G[i, c] * mean[c]
        total += residual * residual / variance + math.log(variance) + 2.0 * math.log(S[i, i])
        for c in range(count):
            gain = shown[c] / variance
            mean[c] += gain * residual
            for d in range(count):
                evidence[c, d] -= gain * shown[d]
    return total
