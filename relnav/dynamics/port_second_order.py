"""What errors of attitude and what they turn do together to port from port: its covariance to second order.

A target known to a degree or two turns what is known to millimetres. The three vectors y of `docking_port`, which are
r + p, the inertial velocity u = v + w_T x (r + p), and C_TB w_B, are seen in the target as

    y = exp(-[theta x]) (y_L + exp([a x]) y_B),   a = C_TB alpha

with y_B = C_TB d, C_TB (w_B x d) and C_TB w_B the chaser's part. Off by y1 and b1 to first order, y and y_B have, to
second order,

    y2 = -theta x (y1 + theta x y / 2) + a x (b1 + a x y_B / 2)

and so have the position r2, the attitude theta x a / 2, the rate -(C_TB w_B)2, and the velocity u2 - w_T x r2 - dw_T x
r1. Where the path rho turns with the chaser, as what a camera has told of it does, its own error is drho to first order
alone. Of the turn it shares s, as in `relnav.vehicle.retraction`, here in the mean:

    rho_true = exp(s [a x]) (rho + drho - s a x rho),   s = E (a x rho) . drho / E |a x rho|^2, within 0 and 1

which adds s a x (drho - s a x rho / 2) to it, in the target's axes, and with dv and v to the velocity in `lvlh_ccsds`.
A turn of both bodies and the path together then is nothing that the port feels.

All are sums of products of two errors of first order. Of normally distributed f, g, h, k (Isserlis 1918, "On a
formula for the product-moment coefficient of any order of a normal frequency distribution", Biometrika 12)

    cov(f x g, h x k) = cov(f, h) * cov(g, k) - cov(f, k) * cov(g, h),   (A * B)_ij = e_ilm e_jno A_ln B_mo

which is tr(H_i P H_j P) / 2 with H the second derivatives. Products are not correlated with the first order. So their
covariance is added, and the square of their mean, E (f x g)_i = e_ijk cov(f, g)_jk: the port is told where the estimate
has it, and its covariance is that about this place.
"""

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.docking_port import ARM, VELOCITY
from relnav.dynamics.error_state import POSE, THETA
from relnav.dynamics.error_state import RATE as TARGET_RATE
from relnav.dynamics.error_state import VELOCITY as MOVED
from relnav.geometry.linear_algebra import cross_into

ALPHA = POSE
"""Where among the errors the chaser's attitude begins; its rate follows."""
ERRORS = ALPHA + 6

_TURN, _TIP, _SPIN, _WHOLE, _OWN, _PLACE, _PATH, _FORMS = 0, 3, 6, 9, 18, 27, 30, 36
"""Rows of what is multiplied: theta, a, dw_T; of each y the second factor by theta, and that by a; r1; of rho and v."""
BENT, PARTS = POSE, POSE + 3
"""Behind the port's twelve, without what is of the path: its second order; with all of them."""
LEFT = (_TURN, _TURN, _TURN, _TIP, _TIP, _TIP, _TURN, _SPIN, _TIP, _TIP)
RIGHT = (_WHOLE, _WHOLE + 3, _WHOLE + 6, _OWN, _OWN + 3, _OWN + 6, _TIP, _PLACE, _PATH, _PATH + 3)
INTO = (0, MOVED, TARGET_RATE, 0, MOVED, TARGET_RATE, THETA, MOVED, BENT, MOVED)
TIMES = (-1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 0.5, -1.0, 1.0, 1.0)
"""The products: their factors, what they are a part of, and how often."""

_F = np.float64
SECOND_ORDER = np.dtype(
    [
        ("whole", _F, (3, 3)),
        ("own", _F, (3, 3)),
        ("path", _F, (2, 3)),
        ("spins", _F, (2, 3)),
        ("forms", _F, (_FORMS, ERRORS)),
        ("carried", _F, (_FORMS, ERRORS)),
        ("joint", _F, (_FORMS, _FORMS)),
        ("products", _F, (PARTS, PARTS)),
        ("mean", _F, PARTS),
    ]
)
"""Scratch: y and y_B, one a row; rho and v, w_T and w_L in the target's axes; what is multiplied by the errors, and its
covariance; that of the products, and their mean."""


@kernel
def _write_vectors(
    C_TB: Matrix, motion: Vector, rates: Matrix, turn: float, port: Vector, found: Matrix, C_TL: Matrix, scratch: Record
) -> None:
    """Write y and y_B, the path and the spins."""
    whole, own, path, spins = scratch["whole"], scratch["own"], scratch["path"], scratch["spins"]
    swing = scratch["mean"][:3]
    cross_into(rates[1], port, swing)
    cross_into(rates[0], found[ARM], whole[1])
    for i in range(3):
        C = C_TB[i]
        own[0, i] = C[0] * port[0] + C[1] * port[1] + C[2] * port[2]
        own[1, i] = C[0] * swing[0] + C[1] * swing[1] + C[2] * swing[2]
        own[2, i] = C[0] * rates[1, 0] + C[1] * rates[1, 1] + C[2] * rates[1, 2]
        whole[0, i], whole[1, i], whole[2, i] = found[ARM, i], whole[1, i] + found[VELOCITY, i], own[2, i]
        path[0, i] = C_TL[i, 0] * motion[0] + C_TL[i, 1] * motion[1] + C_TL[i, 2] * motion[2]
        path[1, i] = C_TL[i, 0] * motion[3] + C_TL[i, 1] * motion[4] + C_TL[i, 2] * motion[5]
        spins[0, i], spins[1, i] = rates[0, i], -turn * C_TL[i, 1]


@kernel
def _shared(C_TB: Matrix, C_TL: Matrix, errors: Matrix, rho: Vector) -> float:
    """The share s of the chaser's turn that the path has; rho (3,) in the target's axes."""
    seen, whole = 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            across = C_TB[j, c] * rho[k] - C_TB[k, c] * rho[j]  # a x rho by alpha
            for m in range(3):
                seen += across * errors[ALPHA + c, m] * C_TL[i, m]
                whole += across * errors[ALPHA + c, ALPHA + m] * (C_TB[j, m] * rho[k] - C_TB[k, m] * rho[j])
    return min(seen / whole, 1.0) if seen > 0.0 else 0.0


@kernel
def _write_forms(C_TB: Matrix, C_TL: Matrix, by_target: Matrix, by_chaser: Matrix, s: float, scratch: Record) -> None:
    """Write what is multiplied, by the errors; s: the share of the turn that the path has."""
    forms, whole, own, path, w_T = (
        scratch["forms"],
        scratch["whole"],
        scratch["own"],
        scratch["path"],
        scratch["spins"][0],
    )
    G, A, rate = by_target, by_chaser, ALPHA + 3
    for i in range(_FORMS):
        for c in range(ERRORS):
            forms[i, c] = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        place, arm, flow, whirl = forms[_PLACE + i], forms[_WHOLE + i], forms[_WHOLE + 3 + i], forms[_WHOLE + 6 + i]
        forms[_TURN + i, THETA + i] = forms[_SPIN + i, TARGET_RATE + i] = 1.0
        for c in range(POSE):
            place[c] = arm[c] = G[i, c]
            flow[c] = G[MOVED + i, c] + w_T[j] * G[k, c] - w_T[k] * G[j, c]  # u1 = v1 + w_T x r1 + dw_T x (r + p)
        flow[TARGET_RATE + j] += whole[0, k]
        flow[TARGET_RATE + k] -= whole[0, j]
        for c in range(3):
            a, b = ALPHA + c, rate + c
            forms[_TIP + i, a] = C_TB[i, c]
            place[a] = arm[a] = flow[b] = forms[_OWN + 3 + i, b] = A[i, c]
            flow[a] = A[MOVED + i, c] + w_T[j] * A[k, c] - w_T[k] * A[j, c]
            whirl[THETA + c], whirl[a] = -G[TARGET_RATE + i, THETA + c], -A[TARGET_RATE + i, c]
            whirl[b] = forms[_OWN + 6 + i, b] = C_TB[i, c]
        for y in range(3):
            row = forms[_WHOLE + 3 * y + i]
            row[THETA + j] += 0.5 * whole[y, k]
            row[THETA + k] -= 0.5 * whole[y, j]
            for c in range(3):
                forms[_OWN + 3 * y + i, ALPHA + c] = 0.5 * (C_TB[j, c] * own[y, k] - C_TB[k, c] * own[y, j])
        for c in range(3):
            forms[_PATH + i, c] = forms[_PATH + 3 + i, MOVED + c] = s * C_TL[i, c]
            for y in range(2):
                turned = C_TB[j, c] * path[y, k] - C_TB[k, c] * path[y, j]
                forms[_PATH + 3 * y + i, ALPHA + c] = -0.5 * s * s * turned


@kernel
def _write_joint(errors: Matrix, scratch: Record) -> None:
    """Write the covariance of what is multiplied."""
    forms, carried, joint = scratch["forms"], scratch["carried"], scratch["joint"]
    for i in range(_FORMS):
        for c in range(ERRORS):
            carried[i, c] = 0.0
        for r in range(ERRORS):
            by = forms[i, r]
            if by != 0.0:
                for c in range(ERRORS):
                    carried[i, c] += by * errors[r, c]
        for j in range(i + 1):
            total = 0.0
            for c in range(ERRORS):
                total += carried[i, c] * forms[j, c]
            joint[i, j] = joint[j, i] = total


@kernel
def _add_mixed(times: float, joint: Matrix, f: int, h: int, g: int, k: int, out: Matrix, at: int, to: int) -> None:
    """Add times cov(f, h) * cov(g, k) to three rows of out, from `at` on, and three columns, from `to` on."""
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            A, B, C, D = joint[f + j], joint[g + m], joint[f + m], joint[g + j]
            part = A[h + d] * B[k + e] - A[h + e] * B[k + d] - C[h + d] * D[k + e] + C[h + e] * D[k + d]
            out[at + i, to + c] += times * part


@kernel
def _gather(spins: Matrix, parts: Vector, own: Vector) -> None:
    """Add to position and velocity, of parts (15,), what the path's second order and the position's do to them.

    own (3,) is scratch.
    """
    for i in range(3):
        parts[i] += parts[BENT + i]
    cross_into(spins[1], parts[BENT:PARTS], own)
    for i in range(3):
        parts[MOVED + i] += own[i]
    cross_into(spins[0], parts[:3], own)
    for i in range(3):
        parts[MOVED + i] -= own[i]


@kernel
def _write_products(scratch: Record) -> None:
    """Write the covariance of the second order, of which the symmetric part counts, and its mean."""
    joint, out, mean = scratch["joint"], scratch["products"], scratch["mean"]
    spins, own = scratch["spins"], scratch["own"][0]
    for i in range(PARTS):
        mean[i] = 0.0
        for j in range(PARTS):
            out[i, j] = 0.0
    for m in range(len(LEFT)):
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            once = joint[LEFT[m] + j, RIGHT[m] + k] - joint[LEFT[m] + k, RIGHT[m] + j]
            mean[INTO[m] + i] += TIMES[m] * once
        for n in range(m + 1):
            f, g, h, k, times = LEFT[m], RIGHT[m], LEFT[n], RIGHT[n], TIMES[m] * TIMES[n]
            times *= 1.0 if n == m else 2.0  # for n, m too
            _add_mixed(times, joint, f, h, g, k, out, INTO[m], INTO[n])
            _add_mixed(-times, joint, f, k, g, h, out, INTO[m], INTO[n])
    _gather(spins, mean, own)
    for c in range(PARTS):
        _gather(spins, out[:, c], own)
    for c in range(PARTS):
        _gather(spins, out[c], own)


@entry
def add_second_order(
    C_TB: Matrix,
    motion: Vector,
    rates: Matrix,
    turn: float,
    port: Vector,
    found: Matrix,
    by_target: Matrix,
    by_chaser: Matrix,
    errors: Matrix,
    covariance: Matrix,
    scratch: Record,
) -> None:
    """Add the second order to the covariance (12, 12) of (position, velocity, theta, rate).

    C_TB to port as given to `port_geometry_into`, and what it found; errors (18, 18): the covariance of (drho, dv,
    theta, dw_T, alpha, dw_B); scratch of SECOND_ORDER.
    """
    C_TL = by_target[:3, :3]
    _write_vectors(C_TB, motion, rates, turn, port, found, C_TL, scratch)
    s = _shared(C_TB, C_TL, errors, scratch["path"][0])
    _write_forms(C_TB, C_TL, by_target, by_chaser, s, scratch)
    _write_joint(errors, scratch)
    _write_products(scratch)
    products, mean = scratch["products"], scratch["mean"]
    for i in range(POSE):
        for j in range(POSE):
            covariance[i, j] += 0.5 * (products[i, j] + products[j, i]) + mean[i] * mean[j]
