"""Backward smoothing (Rauch, Tung, Striebel 1965) in a form that stays positive definite.

With C = Pf Phi^T Pp^-1 the textbook subtracts covariances, Ps = Pf + C (Ps+ - Pp) C^T, and loses definiteness. Since
Pp = Phi Pf Phi^T + Q, the same matrices are

    C = Phi^-1 (I - Q Pp^-1),   A = I - C Phi = Phi^-1 Q Pp^-1 Phi,
    Ps = A Pf A^T + C (Ps+ + Q) C^T,   xs = xf + C (xs+ - xp),

a sum of positive parts, formed on the factors by one orthogonalisation. Phi^-1 = Phi(-dt) is exact.
"""

import numpy as np

from relnav._kernel import straight_line
from relnav.arrays import Matrix
from relnav.estimation.factored import compose_into, orthogonalise, solve_factored, spread


@straight_line(
    filtered=(7, 6), predicted=(7, 6), later=(7, 6), phi=(6, 6), phi_inverse=(6, 6), q_ud=(6, 6)
)  # fmt: skip
def smooth_step(
    filtered: Matrix, predicted: Matrix, later: Matrix, phi: Matrix, phi_inverse: Matrix, q_ud: Matrix
) -> None:
    """Replace `later`, the smoothed track of the epoch after, by the smoothed track of this epoch.

    Tracks (7, 6) are state and factors: `filtered` of this epoch, `predicted` of the epoch after. q_ud (6, 6) factors
    of Q.
    """
    q, m, c, a, gain = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    w, weights, x = np.zeros((6, 18)), np.zeros(18), np.zeros(6)
    compose_into(q_ud, q)
    for j in range(6):  # M = Q Pp^-1, row by row: Q and Pp are symmetric
        for i in range(6):
            m[j, i] = q[i, j]
        solve_factored(predicted[1:7], m[j])
    for i in range(6):
        for j in range(6):
            c[i, j] = phi_inverse[i, j]
            for k in range(6):
                c[i, j] -= phi_inverse[i, k] * m[k, j]
                gain[i, j] += m[i, k] * phi[k, j]
    for i in range(6):
        for j in range(6):
            for k in range(6):
                a[i, j] += phi_inverse[i, k] * gain[k, j]
    for i in range(6):
        x[i] = filtered[0, i]
        for j in range(6):
            x[i] += c[i, j] * (later[0, j] - predicted[0, j])
    spread(a, filtered[1:7], w[:, :6], weights[:6])
    spread(c, later[1:7], w[:, 6:12], weights[6:12])
    spread(c, q_ud, w[:, 12:], weights[12:])
    orthogonalise(w, weights, later[1:7])
    for i in range(6):
        later[0, i] = x[i]


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
    later = np.concatenate([state[-1:], factors[-1]])
    for e in range(len(state) - 2, -1, -1):
        transition = np.ascontiguousarray(phi[e])
        q_ud = factorize(q[e])
        filtered = np.concatenate([state[e : e + 1], factors[e]])
        predicted = filtered.copy()
        predicted[0] = transition @ state[e] + effect[e]
        time_update_into(predicted[1:7], transition, q_ud)
        smooth_step(filtered, predicted, later, transition, np.linalg.inv(transition), q_ud)
        state[e], factors[e] = later[0], later[1:7]
    return state, factors
