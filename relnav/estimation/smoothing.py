"""Backward smoothing (Rauch, Tung, Striebel 1965) as a time update backward, in sums that stay positive definite.

From one epoch to the next x+ = Phi x + u + w, w ~ Q, and the filter has xf, Pf of this one and predicts xp. The noise
carried back, w' = Phi^-1 w ~ Q' = Phi^-1 Q Phi^-T, ties them:

    Phi^-1 (x+ - xp) = (x - xf) + w':

who knows x+ measures w' with the filter's own error, Pf = L D L^T, as noise: L^-1 makes of it six independent scalar
measurements, with variances D. They turn Q' into S, and w' into M Phi^-1 (x+ - xp). So

    x = xf + C (x+ - xp) + e,   C = (I - M) Phi^-1,   e ~ S,
    xs = xf + C (xs+ - xp),     Ps = C Ps+ C^T + S:

a time update with C for Phi and S for Q, where the textbook subtracts, Ps = Pf + C (Ps+ - Pp) C^T, and loses
definiteness. C and S do not depend on what comes later: `backward_model` finds them for each epoch by itself; only
`smooth_step` has to wait for the epoch after.
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import square, straight_line, vector
from relnav.estimation.factored import orthogonalise, scalar_update, spread, time_update_into


@straight_line(q_ld=square, inverse=square, carried=square)
def carry_noise_back(q_ld: Matrix, inverse: Matrix, carried: Matrix) -> None:
    """Write the factors of Q' = Phi^-1 Q Phi^-T (n, n) into carried, from those of Q and Phi^-1."""
    n = q_ld.shape[0]
    w, weights = np.zeros((n, n)), np.zeros(n)
    spread(inverse, q_ld, w, weights)
    orthogonalise(w, weights, carried)


@straight_line(ld=square, inverse=square, carried=square, c=square, s_ld=square)
def backward_model(ld: Matrix, inverse: Matrix, carried: Matrix, c: Matrix, s_ld: Matrix) -> None:
    """Write C (n, n) and the factors of S (n, n) of an epoch.

    ld (n, n) factors of Pf; inverse (n, n) of the transition to the epoch after; carried (n, n) factors of Q'.
    """
    n = ld.shape[0]
    h, k = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        h[i, i] = 1.0  # rows of L^-1
        for j in range(i):
            for m in range(j, i):
                h[i, j] -= ld[i, m] * h[m, j]
        for j in range(n):
            s_ld[i, j] = carried[i, j] if j <= i else 0.0
    for i in range(n):
        gain = np.zeros(n)
        scalar_update(gain, s_ld, h[i], ld[i, i], 1.0)
        for j in range(i):
            seen = 0.0
            for m in range(i + 1):
                seen += h[i, m] * k[m, j]
            for m in range(n):
                k[m, j] -= gain[m] * seen
        for m in range(n):
            k[m, i] = gain[m]
    for i in range(n):
        rest = np.zeros(n)  # a row of I - M, M = K L^-1
        rest[i] = 1.0
        for j in range(n):
            for m in range(j, n):
                rest[j] -= k[i, m] * h[m, j]
        for j in range(n):
            c[i, j] = 0.0
            for m in range(n):
                c[i, j] += rest[m] * inverse[m, j]


@straight_line(later=vector, later_ld=square, filtered=vector, predicted=vector, c=square, s_ld=square)
def smooth_step(later: Vector, later_ld: Matrix, filtered: Vector, predicted: Vector, c: Matrix, s_ld: Matrix) -> None:
    """Replace `later`, the smoothed state (n,) and factors (n, n) of the epoch after, by those of this epoch.

    filtered (n,): state of this epoch; predicted (n,): from it, of the epoch after; C and the factors of S (n, n).
    """
    n = later.shape[0]
    x = np.zeros(n)
    for i in range(n):
        x[i] = filtered[i]
        for j in range(n):
            x[i] += c[i, j] * (later[j] - predicted[j])
    time_update_into(later_ld, c, s_ld)
    for i in range(n):
        later[i] = x[i]


def rts_smooth(
    filtered_state: Matrix, filtered_factors: Matrix, phi: Matrix, effect: Matrix, q: Matrix
) -> tuple[Matrix, Matrix]:
    """Smooth a linear sequence of n filtered states.

    Parameters
    ----------
    filtered_state, filtered_factors : (n, 6), (n, 6, 6)
        States and factors `ld` after each epoch's measurement.
    phi, effect, q : (n - 1, 6, 6), (n - 1, 6), (n - 1, 6, 6)
        Transition, known input and process noise covariance from each epoch to the next.

    Returns
    -------
    (n, 6) smoothed states and (n, 6, 6) factors.
    """
    from relnav.estimation.factored import factorize

    state, factors = np.array(filtered_state), np.array(filtered_factors)
    later, later_ld = state[-1].copy(), factors[-1].copy()
    carried, c, s_ld = np.zeros((3, *later_ld.shape))
    for e in range(len(state) - 2, -1, -1):
        inverse = np.linalg.inv(phi[e])
        carry_noise_back(factorize(q[e]), inverse, carried)
        backward_model(factors[e], inverse, carried, c, s_ld)
        smooth_step(later, later_ld, state[e], phi[e] @ state[e] + effect[e], c, s_ld)
        state[e], factors[e] = later, later_ld
    return state, factors
