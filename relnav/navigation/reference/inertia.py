"""What an inertia that is off does, for `engine="filterpy"`: derivatives by it, by complex steps of the equations.

J w' = -w x J w + 3 k o x J o, k = mu / r^3, with J + E in place of J. What one sigma of each entry does to attitude and
rate is the imaginary part of where a body of an imaginary error ends (Squire and Trapp 1998); what it does in second
order, J^-1 E a for the acceleration a that is of first order, is noise that lasts for a turn.
"""

import math
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.inertia_error import INERTIA_ENTRIES
from relnav.navigation.reference.motion import IMAGINARY, cross, integrated, pieces_of


def errors_of(sigma: Matrix) -> Stack:
    """One sigma of each entry of an inertia, (6, 3, 3)."""
    out = np.zeros((len(INERTIA_ENTRIES), 3, 3))
    for k, (i, j) in enumerate(INERTIA_ENTRIES):
        out[k, i, j] = out[k, j, i] = sigma[i, j]
    return out


def _acceleration(inertia: Stack, inverse: Stack, gravity: float, nadir: Matrix, rate: Matrix) -> Matrix:
    """Angular acceleration (k, 3) of bodies of inertia (k, 3, 3), complex ones too."""
    of_nadir, of_rate = (np.einsum("kij,kj->ki", inertia, one) for one in (nadir, rate))
    torque = 3.0 * gravity * cross(nadir, of_nadir) - cross(rate, of_rate)
    out: Matrix = np.einsum("kij,kj->ki", inverse, torque)
    return out


def _off(inertia: Matrix, errors: Stack) -> tuple[Any, Any]:
    """Bodies with an imaginary error each, and their inverses."""
    inverse: Any = np.linalg.inv(inertia)
    return inertia + 1j * IMAGINARY * errors, inverse - 1j * IMAGINARY * inverse @ errors @ inverse


def second_order_density(
    inertia: Matrix, sigma: Matrix, orbit: tuple[float, float], dcm: Matrix, rate: Vector
) -> float:
    """Of white angular acceleration, rad^2/s^3: the mean square of second order, an axis, over the time of a turn."""
    n, gravity = orbit
    errors, count = errors_of(sigma), len(INERTIA_ENTRIES)
    here = np.broadcast_to(dcm[2], (count, 3)), np.broadcast_to(rate, (count, 3))
    first = _acceleration(*_off(inertia, errors), gravity, *here).imag / IMAGINARY
    forms = np.einsum("ij,kjm,lm->ikl", np.linalg.inv(inertia), errors, first)
    forms = 0.5 * (forms + forms.transpose(0, 2, 1))  # x' F x of x ~ N(0, 1): mean square (tr F)^2 + 2 tr F F
    square = np.trace(forms, axis1=1, axis2=2) ** 2 + 2.0 * np.einsum("ikl,ilk->i", forms, forms)
    return float(square.mean()) * 2.0 * math.pi / max(float(np.linalg.norm(rate)), n)


def inertia_effect(
    inertia: Matrix, sigma: Matrix, orbit: tuple[float, float], dcm: Matrix, rate: Vector, dt_s: float
) -> Matrix:
    """What one sigma of each entry does to (theta, dw) over dt, (6, 6), a row an entry."""
    n, gravity = orbit
    bodies, count = _off(inertia, errors_of(sigma)), len(INERTIA_ENTRIES)

    def rate_of(_: float, values: Vector) -> Vector:
        attitude, turning = values[: 9 * count].reshape(count, 3, 3), values[9 * count :].reshape(count, 3)
        relative = turning + n * attitude[:, 1]
        acceleration = _acceleration(*bodies, gravity, attitude[:, 2], turning)
        return np.concatenate([cross(attitude, relative[:, None]).ravel(), acceleration.ravel()])

    values = np.concatenate([np.tile(dcm.astype(complex), (count, 1, 1)).ravel(), np.tile(rate.astype(complex), count)])
    pieces = pieces_of(rate, n, dt_s)
    for _ in range(pieces):
        values = integrated(rate_of, values, dt_s / pieces)[-1]
    attitude, turning = values[: 9 * count].reshape(count, 3, 3), values[9 * count :].reshape(count, 3)
    turns = attitude[0].real.T @ attitude.imag / IMAGINARY
    return np.column_stack([turns[:, 2, 1], turns[:, 0, 2], turns[:, 1, 0], turning.imag / IMAGINARY])
