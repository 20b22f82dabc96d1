"""What two spots can say about the attitude: two of its three parameters, whatever the crystal.

Opening, crystal and detector are rigid in the sensor, and unpolarised light from far away is its direction, nothing
more: every image is a function of s alone, and s does not change in a turn about itself.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor
from relnav.sensors.birefringent_sun.spots import spots_of_transverse

STEP_RAD = 1e-5


@dataclass(frozen=True)
class Observability:
    """How the four spot coordinates depend on small rotations of the sensor.

    Attributes
    ----------
    singular_values : (3,)
        Of d(spots)/d(rotation), in thicknesses of the crystal per rad; largest first.
    unseen_axis : (3,)
        Axis of the rotation that changes the spots least; its sign is arbitrary.
    rank : int
        Singular values above a millionth of the largest.
    """

    singular_values: Vector
    unseen_axis: Vector
    rank: int


def observability(sensor: BirefringentSunSensor, s: Vector) -> Observability:
    """Rank and singular values of the spots' derivative by a rotation; s (3,) is the sun in sensor axes.

    The sun's direction is rotated by finite angles about x, y and z, the opposite way, and traced through the crystal;
    nothing is assumed about the rank.
    """
    columns = []
    for axis in range(3):
        ends = [spots_of_transverse(sensor, (_turn(axis, sign * STEP_RAD) @ s)[:2]).ravel() for sign in (-1.0, 1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * STEP_RAD * sensor.crystal_thickness_m))
    _, sizes, axes = np.linalg.svd(np.stack(columns, axis=1))
    return Observability(sizes, axes[-1], int(np.sum(sizes > 1e-6 * sizes[0])))


def _turn(axis: int, angle: float) -> Matrix:
    c, n = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -n, n, c
    return turn
