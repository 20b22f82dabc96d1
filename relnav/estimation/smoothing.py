"""Backward smoothing (Rauch, Tung, Striebel 1965) in a form that stays positive definite.

With C = Pf Phi^T Pp^-1 the textbook subtracts covariances, Ps = Pf + C (Ps+ - Pp) C^T, and loses definiteness. Since
Pp = Phi Pf Phi^T + Q, the same matrices are

    C = Phi^-1 (I - Q Pp^-1),   A = I - C Phi = Phi^-1 Q Pp^-1 Phi,
    Ps = A Pf A^T + C (Ps+ + Q) C^T,   xs = xf + C (xs+ - xp),

a sum of positive parts, formed on the factors by one orthogonalisation. Phi^-1 = Phi(-dt) is exact.
"""

import numpy as np

from relnav._kernel import kernel
from relnav.arrays import Matrix
from relnav.estimation.factored import compose_into, orthogonalise, solve_factored, spread

SMOOTH_ROWS = 46


@kernel
def smooth_step(
    filtered: Matrix, predicted: Matrix, later: Matrix, phi: Matrix, phi_inverse: Matrix, q_ud: Matrix, work: Matrix
) -> None:
    """Replace `later`, the smoothed track of the epoch after, by the smoothed track of this epoch.

    Tracks (7, 6) are state and factors: `filtered` of this epoch, `predicted` of the epoch after. q_ud (6, 6) factors
    of Q; work (46, 6) scratch.
    """
    q, m, c, a = work[0:6], work[6:12], work[12:18], work[18:24]
    w, weights, column = work[24:42], work[42:45], work[45]
    compose_into(q_ud, q)
    for j in range(6):  # M = Q Pp^-1, a column of its transpose at a time
        for i in range(6):
            column[i] = q[i, j]
        solve_factored(predicted[1:7], column)
        for i in range(6):
            m[j, i] = column[i]
    for i in range(6):
        for j in range(6):
            c[i, j] = phi_inverse[i, j]
            a[i, j] = 0.0
            for k in range(6):
                c[i, j] -= phi_inverse[i, k] * m[k, j]
                a[i, j] += m[i, k] * phi[k, j]
    for i in range(6):
        for j in range(6):
            m[i, j] = 0.0
            for k in range(6):
                m[i, j] += phi_inverse[i, k] * a[k, j]
    for i in range(6):
        column[i] = filtered[0, i]
        for j in range(6):
            column[i] += c[i, j] * (later[0, j] - predicted[0, j])
    spread(m, filtered[1:7], w[0:6], weights[0])
    spread(c, later[1:7], w[6:12], weights[1])
    spread(c, q_ud, w[12:18], weights[2])
    orthogonalise(w, weights, later[1:7])
    for i in range(6):
        later[0, i] = column[i]


def rts_smooth(
    filtered_state: Matrix, filtered_factors: Matrix, phi: Matrix, effect: Matrix, q: Matrix
) -> tuple[Matrix, Matrix]:
    """Smooth a linear sequence of n filtered states.

    Parameters
    ----------
    filtered_state, filtered_factors : (n, 6), (n, 6, 6)
        States and factors `ud` after each epoch's measurement.
    phi, effect, q : (n - 1, 6, 6), (n - 1, 6), (n - 1, 6, 6)
        Transition, known input and process noise covariance from each epoch to the next.

    Returns
    -------
    (n, 6) smoothed states and (n, 6, 6) factors.
    """
    from relnav.estimation.factored import factorize, time_update_into

    state, factors = np.array(filtered_state), np.array(filtered_factors)
    later, work = np.concatenate([state[-1:], factors[-1]]), np.zeros((SMOOTH_ROWS, 6))
    for e in range(len(state) - 2, -1, -1):
        transition = np.ascontiguousarray(phi[e])
        q_ud = factorize(q[e])
        filtered = np.concatenate([state[e : e + 1], factors[e]])
        predicted = filtered.copy()
        predicted[0] = transition @ state[e] + effect[e]
        time_update_into(predicted[1:7], transition, q_ud, np.zeros((12, 6)), np.zeros((2, 6)))
        smooth_step(filtered, predicted, later, transition, np.linalg.inv(transition), q_ud, work)
        state[e], factors[e] = later[0], later[1:7]
    return state, factors
