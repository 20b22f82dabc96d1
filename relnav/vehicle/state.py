"""The estimate of a vehicle: values that never change once made, so that any of them can be gone back to."""

import math
from typing import NamedTuple

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.estimation.schmidt import reset_into
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import CHASER_ATTITUDE, TARGET_ATTITUDE, TARGET_RATE, Layout
from relnav.vehicle.orbit_frame import OrbitFrame

_TARGET, _CHASER = TARGET_ATTITUDE.start, CHASER_ATTITUDE.start
RESET_FROM_RAD = 1e-3
"""Below this correction the covariance is the same about the old and the new attitude to 5e-4 of itself."""


@kernel
def _take_turn(theta: Vector, dcm: Matrix, out: Matrix, P: Matrix, at: int) -> None:
    """Write an attitude that took theta (3,) in into out, and replace P (n, n) by that about it."""
    turn_by_rotation_vector(dcm, theta, out)
    if math.sqrt(theta[0] ** 2 + theta[1] ** 2 + theta[2] ** 2) > RESET_FROM_RAD:
        reset_into(P, theta, at)


@entry
def correct_into(
    values: Vector,
    target: Matrix,
    chaser: Matrix,
    correction: Vector,
    values_after: Vector,
    target_after: Matrix,
    chaser_after: Matrix,
    P: Matrix,
) -> None:
    """Write values (n,) and both attitudes (3, 3) with a correction (n,) taken in; P (n, n), after it, in place."""
    for i in range(len(values)):
        values_after[i] = values[i] + correction[i]
    for i in range(3):
        values_after[_TARGET + i] = values_after[_CHASER + i] = 0.0
    _take_turn(correction[_TARGET : _TARGET + 3], target, target_after, P, _TARGET)
    _take_turn(correction[_CHASER : _CHASER + 3], chaser, chaser_after, P, _CHASER)


class VehicleState(NamedTuple):
    """An estimate.

    Attributes
    ----------
    t_s : float
        Of the chaser's attitude, which follows every gyro sample.
    settled_s : float
        Of all else. Not later than t_s.
    values : (n,)
        Additive values by the layout: position, velocity (`lvlh_ccsds` of the stated orbit), rate, bias and what lasts;
        zero where the error is that of an attitude.
    dcm_lvlh_from_target, dcm_inertial_from_chaser : (3, 3)
    dcm_at_settled : (3, 3)
        dcm_inertial_from_chaser at settled_s.
    covariance : (n, n)
        Of the errors at settled_s, truth = estimate and error.
    sample_rad_s : (3,)
        The last gyro sample; NaN before the first.
    sample_s : float
        Its time.
    bias_known : (6,)
        What the bias and its variance were when the gyro was lost; NaN while it is not.
    command_m_s2 : (3,)
        To the thrusters, chaser axes.
    """

    t_s: float
    settled_s: float
    values: Vector
    dcm_lvlh_from_target: Matrix
    dcm_inertial_from_chaser: Matrix
    dcm_at_settled: Matrix
    covariance: Matrix
    sample_rad_s: Vector
    sample_s: float
    bias_known: Vector
    command_m_s2: Vector

    def corrected(self, correction: Vector, covariance: Matrix) -> "VehicleState":
        """The estimate with a correction (n,) of its errors taken in; it must be settled."""
        values, target, chaser = np.empty_like(self.values), np.empty((3, 3)), np.empty((3, 3))
        after = covariance.copy()
        correct_into(
            self.values,
            self.dcm_lvlh_from_target,
            self.dcm_inertial_from_chaser,
            correction,
            values,
            target,
            chaser,
            after,
        )
        return self._replace(
            values=values,
            dcm_lvlh_from_target=target,
            dcm_inertial_from_chaser=chaser,
            dcm_at_settled=chaser,
            covariance=after,
        )


def start_state(
    vehicle: Vehicle, layout: Layout, frame: OrbitFrame, t_s: float, position_m: Vector, velocity_m_s: Vector
) -> VehicleState:
    """The estimate at hand-over: attitudes and rate as held, everything that lasts as stated."""
    values = np.zeros(layout.size)
    values[:3], values[3:6], values[TARGET_RATE] = position_m, velocity_m_s, vehicle.start_rate_rad_s
    dcm = (vehicle.chaser.dcm_chaser_from_lvlh @ frame.dcm_lvlh_from_inertial(t_s)).T.copy()
    return VehicleState(
        t_s=t_s,
        settled_s=t_s,
        values=values,
        dcm_lvlh_from_target=vehicle.target.dcm_target_from_lvlh.T.copy(),
        dcm_inertial_from_chaser=dcm,
        dcm_at_settled=dcm,
        covariance=layout.prior.copy(),
        sample_rad_s=np.full(3, np.nan),
        sample_s=-np.inf,
        bias_known=np.full(6, np.nan),
        command_m_s2=np.zeros(3),
    )
