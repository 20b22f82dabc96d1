"""Rows of attitudes and of directions to the sun, compiled: formulas as in `relnav.vehicle.directions`."""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.estimation.schmidt import clear, copy_into
from relnav.geometry.linear_algebra import cross_into, tangent_basis_into
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector
from relnav.vehicle.layout import CHASER_ATTITUDE

_F = np.float64
_CHASER = CHASER_ATTITUDE.start

MOUNTING = np.dtype(
    [
        ("dcm_chaser_from_sensor", _F, (3, 3)),
        ("mount", np.int64),
        ("back", _F, (3, 3)),
        ("inertial", _F, (3, 3)),
        ("measured", _F, (3, 3)),
        ("predicted", _F, 3),
        ("basis", _F, (3, 2)),
        ("spread", _F, (3, 2)),
        ("by_turn", _F, 3),
    ]
)
"""How a sensor sits on the chaser, where its mounting's error begins in the layout, and scratch."""


@kernel
def _turned_into(mounting: Record, values: Vector, dcm_inertial_from_chaser: Matrix) -> None:
    """Write dcm_chaser_from_sensor with what is known of the mounting's error, and dcm_inertial_from_sensor."""
    back, inertial, mount = mounting["back"], mounting["inertial"], mounting["mount"]
    turn_by_rotation_vector(mounting["dcm_chaser_from_sensor"], values[mount : mount + 3], back)
    for i in range(3):
        C = dcm_inertial_from_chaser[i]
        for c in range(3):
            inertial[i, c] = C[0] * back[0, c] + C[1] * back[1, c] + C[2] * back[2, c]


@kernel
def _row_into(mounting: Record, by_turn: Vector, row: Vector) -> None:
    """Write a row (n,), zero before, of what depends by by_turn (3,) on the turn of the sensor's inertial attitude."""
    back, mount = mounting["back"], mounting["mount"]
    for c in range(3):
        row[mount + c] = by_turn[c]
        row[_CHASER + c] = by_turn[0] * back[c, 0] + by_turn[1] * back[c, 1] + by_turn[2] * back[c, 2]


@entry
def attitude_rows_into(
    mounting: Record,
    values: Matrix,
    dcm_inertial_from_chaser: Stack,
    attitude: Vector,
    noise: Matrix,
    residual: Matrix,
    H: Stack,
    R: Stack,
) -> None:
    """Write the rows of k filters about dcm_sensor_from_inertial (9,): residual (k, 3), H (k, 3, n), R (k, 3, 3).

    values (k, n) and attitudes as in `Estimates`; noise (3, 3).
    """
    by_turn, measured = mounting["by_turn"], mounting["measured"]
    for f in range(values.shape[0]):
        clear(H[f])
        copy_into(noise, R[f])
        _turned_into(mounting, values[f], dcm_inertial_from_chaser[f])
        for i in range(3):
            for c in range(3):
                measured[c, i] = attitude[3 * i + c]
                by_turn[c] = 1.0 if i == c else 0.0
            _row_into(mounting, by_turn, H[f, i])
        if math.isfinite(attitude[0]):
            rotation_vector_into(measured, mounting["inertial"], residual[f])
        else:
            residual[f, 0] = residual[f, 1] = residual[f, 2] = math.nan


@entry
def between_into(nodes: Matrix, u: float, out: Vector) -> None:
    """Write into out (3,) the cubic through four directions (4, 3), of u = -1, 0, 1 and 2."""
    a, b, c = u + 1.0, u - 1.0, u - 2.0
    first, second, third, last = -u * b * c / 6.0, 0.5 * a * b * c, -0.5 * a * u * c, a * u * b / 6.0
    for i in range(3):
        out[i] = first * nodes[0, i] + second * nodes[1, i] + third * nodes[2, i] + last * nodes[3, i]


@entry
def sun_rows_into(
    mounting: Record,
    sun: Vector,
    variance: float,
    values: Matrix,
    dcm_inertial_from_chaser: Stack,
    direction: Vector,
    covariance: Matrix,
    residual: Matrix,
    H: Stack,
    R: Stack,
) -> None:
    """Write the rows of k filters about a direction (3,) across the predicted one: (k, 2), (k, 2, n), (k, 2, 2).

    sun (3,): inertial; variance: of it, each axis, rad^2; values (k, n) and attitudes as in `Estimates`; covariance
    (3, 3) of the direction.
    """
    predicted, by_turn = mounting["predicted"], mounting["by_turn"]
    basis, spread, inertial = mounting["basis"], mounting["spread"], mounting["inertial"]
    for f in range(values.shape[0]):
        clear(H[f])
        _turned_into(mounting, values[f], dcm_inertial_from_chaser[f])
        for i in range(3):
            predicted[i] = inertial[0, i] * sun[0] + inertial[1, i] * sun[1] + inertial[2, i] * sun[2]
        tangent_basis_into(predicted, basis)
        for k in range(2):
            for i in range(3):
                by = covariance[i]
                spread[i, k] = by[0] * basis[0, k] + by[1] * basis[1, k] + by[2] * basis[2, k]
        for k in range(2):
            across = basis[:, k]
            residual[f, k] = across[0] * direction[0] + across[1] * direction[1] + across[2] * direction[2]
            for i in range(2):
                R[f, k, i] = across[0] * spread[0, i] + across[1] * spread[1, i] + across[2] * spread[2, i]
            R[f, k, k] += variance
            cross_into(across, predicted, by_turn)  # the row across [s x]
            _row_into(mounting, by_turn, H[f, k])
