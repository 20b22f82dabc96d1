"""A chaser that turns with a target which tumbles, so that its sensors stay on the port."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from relnav.arrays import Matrix, Stack, Vector

SETTLING_S = 40.0
"""In which what is off of the chaser's attitude at the start fades, to 1 / e."""


class Facing:
    """The chaser's attitude from which it faces the target's port all the time.

    Parameters
    ----------
    target : Slerp
        The target's attitude, its axes to inertial ones, from the start to the end of the flight.
    last_rate_rad_s : (3,)
        Its rate at the end, its axes: the last sample of a gyro may end a little later.
    dcm_chaser_from_target : (3, 3)
        When both face each other.
    first : (3, 3)
        The chaser's attitude at the start, from inertial axes.
    """

    def __init__(self, target: Slerp, last_rate_rad_s: Vector, dcm_chaser_from_target: Matrix, first: Matrix) -> None:
        self._target, self._last_rate, self._facing = target, last_rate_rad_s, dcm_chaser_from_target
        self._off: Vector = Rotation.from_matrix(first @ self._meant(np.zeros(1))[0].T).as_rotvec()

    def dcm_chaser_from_inertial(self, t_s: Vector) -> Stack:
        """At times (k,), (k, 3, 3); what is off at the start fades."""
        fading: Stack = Rotation.from_rotvec(self._off * np.exp(-t_s / SETTLING_S)[:, None]).as_matrix()
        return fading @ self._meant(t_s)

    def _meant(self, t: Vector) -> Stack:
        within = np.minimum(t, self._target.times[-1])
        turned: Stack = (
            self._target(within) * Rotation.from_rotvec((t - within)[:, None] * self._last_rate)
        ).as_matrix()
        return self._facing @ turned.transpose(0, 2, 1)
