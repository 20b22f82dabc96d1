"""What an inertia that is not quite the true one does to a rigid body's rotation.

The error lasts as long as the body does, so that its effect grows where noise would average out: a filter that takes it
for noise becomes overconfident. It is told as what one sigma of each entry does, to be carried beside the errors
(Schmidt 1966). With J + E in place of J the angular acceleration is off by

    a - J^-1 E a + ...,   a = J^-1 (-w x E w + g o x E o - E w').

The first part is linear in E. The second is not, and cannot be carried like this; it is told as noise. Without it, what
remains after some turns of a body would be larger than a filter says.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.dynamics.rigid_body import BODY_ROWS, GRADIENT, INERTIA, INVERSE, ORBIT, TORQUE

INERTIA_ENTRIES = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
"""Which entries of an inertia its errors are of: three moments, then three products."""
ENTRIES = len(INERTIA_ENTRIES)


def inertia_sigma(inertia_sigma_kg_m2: ArrayLike) -> Matrix:
    """1-sigma of each entry of an inertia (3, 3); ValueError where it is not symmetric, or below zero somewhere."""
    sigma = vector("inertia_sigma_kg_m2", inertia_sigma_kg_m2, (3, 3))
    if not ((sigma >= 0.0).all() and np.array_equal(sigma, sigma.T)):
        raise ValueError(f"inertia_sigma_kg_m2 is symmetric and nowhere below zero; got {sigma.tolist()}")
    return sigma


def _times(matrix: Matrix, vector: Vector) -> Vector:
    out = np.zeros(3)
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]
    return out


def _torque(rate: Vector, nadir: Vector, gradient: float, inertia: Matrix) -> Vector:
    """-w x J w + gradient o x J o, (3,), linear in J."""
    of_rate, of_nadir, out = _times(inertia, rate), _times(inertia, nadir), np.zeros(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = rate[k] * of_rate[j] - rate[j] * of_rate[k]
        out[i] += gradient * (nadir[j] * of_nadir[k] - nadir[k] * of_nadir[j])
    return out


@straight_line(body=(BODY_ROWS, 3), sigma=(3, 3), dcm=(3, 3), rate=(3,), out=(3, 6))
def inertia_effect_into(body: Matrix, sigma: Matrix, dcm: Matrix, rate: Vector, out: Matrix) -> None:
    """Write what one sigma of each entry of the inertia does to the angular acceleration, rad/s^2, into out (3, 6).

    J w' = -w x J w + g o x J o + tau, so J dw' = -w x E w + g o x E o - E w' for an error E of J. body as in
    `rigid_body`; sigma (3, 3) kg m^2; columns as in INERTIA_ENTRIES. Without a torque tau an error of the inertia's
    size alone, E = J, does nothing.
    """
    inertia, inverse, nadir = body[INERTIA : INERTIA + 3], body[INVERSE : INVERSE + 3], dcm[2]
    gradient, tau = body[ORBIT, GRADIENT], _torque(rate, nadir, body[ORBIT, GRADIENT], inertia)
    for i in range(3):
        tau[i] = tau[i] + body[TORQUE, i]
    acceleration = _times(inverse, tau)
    for k in range(6):
        a, b = INERTIA_ENTRIES[k]
        error = np.zeros((3, 3))
        error[a, b] = sigma[a, b]
        error[b, a] = sigma[a, b]
        left, against = _torque(rate, nadir, gradient, error), _times(error, acceleration)
        for i in range(3):
            left[i] = left[i] - against[i]
        column = _times(inverse, left)
        for i in range(3):
            out[i, k] = column[i]


@straight_line(body=(BODY_ROWS, 3), sigma=(3, 3), effect=(3, 6))
def second_order_square(body: Matrix, sigma: Matrix, effect: Matrix) -> float:
    """Mean square of the part of second order, J^-1 E a, averaged over the axes, (rad/s^2)^2.

    effect (3, 6), of `inertia_effect_into`: a = sum x_l a_l, E = sum x_k E_k, x independent with a sigma of one. With
    b_kl = J^-1 E_k a_l the mean square of sum x_k x_l b_kl is |sum b_kk|^2 + sum b_kl (b_kl + b_lk).
    """
    inverse, b, mean, total = body[INVERSE : INVERSE + 3], np.zeros((6, 6, 3)), np.zeros(3), 0.0
    for k in range(6):
        i, j = INERTIA_ENTRIES[k]
        error = np.zeros((3, 3))
        error[i, j] = sigma[i, j]
        error[j, i] = sigma[i, j]
        for m in range(6):
            column = _times(inverse, _times(error, effect[:, m]))
            for c in range(3):
                b[k, m, c] = column[c]
        for c in range(3):
            mean[c] = mean[c] + b[k, k, c]
    for c in range(3):
        total += mean[c] * mean[c]
        for k in range(6):
            for m in range(6):
                total += b[k, m, c] * (b[k, m, c] + b[m, k, c])
    return total / 3.0


@kernel
def turn_time(rate: Vector, n: float) -> float:
    """For how long an acceleration adds up in a body that turns: one turn, s; 0 at rest.

    Constant errors make one that is the same in the body's axes as long as the axis of the turn is. About moments J it
    goes round sqrt((J3 - J1) (J3 - J2) / (J1 J2)) times in a turn, at most once, as J3 <= J1 + J2.
    """
    fastest = max(math.sqrt(rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]), n)
    return 2.0 * math.pi / fastest if fastest > 0.0 else 0.0
