"""What an inertia that is not quite the true one does to a rigid body's rotation.

The error lasts as long as the body does, so that its effect grows where noise would average out: a filter that takes it
for noise becomes overconfident. It is told as what one sigma of each entry does, to be carried beside the errors
(Schmidt 1966).
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import straight_line
from relnav.dynamics.rigid_body import BODY_ROWS, INERTIA, INVERSE, MEAN_MOTION, TORQUE

INERTIA_ENTRIES = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
"""Which entries of an inertia its errors are of: three moments, then three products."""


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

    J w' = -w x J w + 3 n^2 o x J o + tau, so J dw' = -w x E w + 3 n^2 o x E o - E w' for an error E of J. body as in
    `rigid_body`; sigma (3, 3) kg m^2; columns as in INERTIA_ENTRIES. Without a torque tau an error of the inertia's
    size alone, E = J, does nothing.
    """
    inertia, inverse, nadir, n = body[INERTIA : INERTIA + 3], body[INVERSE : INVERSE + 3], dcm[2], body[MEAN_MOTION, 0]
    gradient, tau = 3.0 * n * n, _torque(rate, nadir, 3.0 * n * n, inertia)
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
