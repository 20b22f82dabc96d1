"""Port from port: where the chaser's docking port is and how it moves, seen from the target's port, target axes.

    r = C_TL rho + C_TB d - p,   v = C_TL (v_L + w_L x rho) + C_TB (w_B x d) - w_T x (r + p),   w = w_T - C_TB w_B

d and p are the ports of chaser and target, w_B and w_T the inertial rates of both, each in its own axes, and w_L that
of `lvlh_ccsds`, which turns about -y. Errors of attitude: true = estimated exp([theta x]) of the target in
`lvlh_ccsds`, true = exp(-[alpha x]) stated of `dcm_chaser_from_lvlh`.
"""

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.geometry.linear_algebra import cross_into

ARM, VELOCITY, RATE = 0, 1, 2
"""Rows of what `port_geometry_into` writes: r + p, v and w."""


@kernel
def _write_cross(sign: float, v: Vector, out: Matrix) -> None:
    """Write sign [v x] (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -sign * v[2], sign * v[1]
    out[1, 0], out[1, 1], out[1, 2] = sign * v[2], 0.0, -sign * v[0]
    out[2, 0], out[2, 1], out[2, 2] = -sign * v[1], sign * v[0], 0.0


@kernel
def _subtract_turned(w: Vector, m: Matrix, out: Matrix) -> None:
    """Subtract [w x] m (3, k) from out (3, k)."""
    for j in range(m.shape[1]):
        out[0, j] -= w[1] * m[2, j] - w[2] * m[1, j]
        out[1, j] -= w[2] * m[0, j] - w[0] * m[2, j]
        out[2, j] -= w[0] * m[1, j] - w[1] * m[0, j]


@entry
def port_geometry_into(
    C_TL: Matrix,
    C_TB: Matrix,
    motion: Vector,
    rates: Matrix,
    turn: float,
    port: Vector,
    out: Matrix,
    by_target: Matrix,
    by_chaser: Matrix,
    work: Matrix,
) -> None:
    """Write the rows ARM, VELOCITY and RATE of out (3, 3), and what errors do to (position, velocity, theta, rate).

    motion (6,): rho and v; rates (2, 3): w_T and w_B; turn: of `lvlh_ccsds`, rad/s; port (3,): d; by_target (12, 12):
    by (drho, dv, theta, dw_T); by_chaser (12, 3): by alpha; work (4, 3) is scratch.
    """
    swing, inertial, turning, moved = work[0], work[1], work[2], work[3]
    w_T, w_B, G, A, arm = rates[0], rates[1], by_target, by_chaser, out[ARM]
    cross_into(w_B, port, swing)
    moved[0], moved[1], moved[2] = motion[3] - turn * motion[2], motion[4], motion[5] + turn * motion[0]
    for i in range(3):
        arm[i], inertial[i], turning[i] = 0.0, 0.0, 0.0
        for j in range(3):
            arm[i] += C_TL[i, j] * motion[j] + C_TB[i, j] * port[j]
            inertial[i] += C_TL[i, j] * moved[j] + C_TB[i, j] * swing[j]
            turning[i] += C_TB[i, j] * w_B[j]
    cross_into(w_T, arm, out[VELOCITY])
    for i in range(3):
        out[VELOCITY, i] = inertial[i] - out[VELOCITY, i]
        out[RATE, i] = w_T[i] - turning[i]
    for i in range(12):
        for j in range(12):
            G[i, j] = 1.0 if i == j and i >= 6 else 0.0
    for i in range(3):
        for j in range(3):
            G[i, j], G[3 + i, 3 + j], A[6 + i, j] = C_TL[i, j], C_TL[i, j], -C_TB[i, j]
        G[3 + i, 0], G[3 + i, 2] = turn * C_TL[i, 2], -turn * C_TL[i, 0]  # C_TL [w_L x]
        cross_into(port, C_TB[i], A[i])  # -C_TB [d x]
        cross_into(swing, C_TB[i], A[3 + i])
        cross_into(C_TB[i], w_B, A[9 + i])
    _write_cross(1.0, arm, G[:3, 6:9])
    _write_cross(1.0, arm, G[3:6, 9:])
    _write_cross(1.0, inertial, G[3:6, 6:9])
    _write_cross(-1.0, turning, G[9:, 6:9])
    _subtract_turned(w_T, C_TL, G[3:6, :3])
    _subtract_turned(w_T, G[:3, 6:9], G[3:6, 6:9])
    _subtract_turned(w_T, A[:3], A[3:6])
