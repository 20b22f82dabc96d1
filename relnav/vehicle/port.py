"""From a vehicle's state to what docking needs: port from port, its rate, attitude and rate, with joint covariance.

As in `relnav.dynamics.docking_port`, the chaser's rate being the gyro's sample less its bias: the errors of the bias
and the noise of the sample are in velocity and rate. So is the square of what the rate has changed since the middle of
the sample's period, if it changes as over the samples before (`GyroSamples.trend_at`, `unsteady_at`).
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector, number
from relnav.dynamics.docking_port import ARM, RATE, port_geometry_into
from relnav.dynamics.docking_port import VELOCITY as PORT_VELOCITY
from relnav.dynamics.error_state import POSE
from relnav.dynamics.port_second_order import ERRORS, SECOND_ORDER, add_second_order
from relnav.dynamics.relative_motion import frame_rate
from relnav.errors import UsageError
from relnav.spacecraft import Vehicle
from relnav.vehicle.gyro_errors import by_errors
from relnav.vehicle.layout import (
    CHASER_ATTITUDE,
    GYRO_BIAS,
    GYRO_ERRORS,
    POSITION,
    TARGET_ATTITUDE,
    TARGET_RATE,
    VELOCITY,
)
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.state import VehicleState

_SIGNS = np.ones(ERRORS)
_SIGNS[GYRO_BIAS] = -1.0
"""Of the moving errors, so that they are those of `add_second_order`: the chaser's rate is less the bias."""
_RATE_VARIANCES = slice(GYRO_BIAS.start * (ERRORS + 1), None, ERRORS + 1)
"""Of that rate, in a flat covariance of these errors."""


@dataclass(frozen=True)
class PortState:
    """The chaser's docking port seen from the target's, target axes.

    Attributes
    ----------
    position_m, velocity_m_s : (3,)
        Of the chaser's port from the target's; velocity as seen in the turning target.
    dcm_target_from_chaser : (3, 3)
    rate_rad_s : (3,)
        Of the target relative to the chaser.
    covariance : (12, 12)
        Of (position, velocity, theta, rate); dcm_chaser_from_target true = dcm^T exp([theta x]), theta in target axes.
    """

    position_m: Vector
    velocity_m_s: Vector
    dcm_target_from_chaser: Matrix
    rate_rad_s: Vector
    covariance: Matrix

    @property
    def sigma(self) -> Vector:
        """1-sigma of (position m, velocity m/s, attitude rad, rate rad/s), (12,)."""
        return np.sqrt(np.diagonal(self.covariance))

    def protection_level_m(self, probability: float = 1e-7) -> Vector:
        """What the position's error exceeds along each axis with no more than this probability, (3,) m.

        If nothing is at fault: with the stated noise and tolerances, an error of the normal distribution.

        Raises
        ------
        UsageError
            For what is no probability.
        """
        from scipy.special import ndtri

        level: Vector = -ndtri(0.5 * checked_probability("probability", probability)) * self.sigma[:3]
        return level


def checked_probability(name: str, value: float, *, may_be_one: bool = False) -> float:
    """A caller's probability.

    Raises
    ------
    UsageError
        For 0, for 1 unless it may be that, and for what lies outside.
    ValueError
        For what is no number.
    """
    probability = number(name, value)
    if not (0.0 < probability < 1.0 or (may_be_one and probability == 1.0)):
        raise UsageError(f"{name} lies between 0 and 1; got {value!r}")
    return probability


def port_state(
    vehicle: Vehicle,
    frame: OrbitFrame,
    state: VehicleState,
    chaser_rate_rad_s: Vector,
    rate_variance: Vector | None = None,
) -> tuple[PortState, Matrix]:
    """The ports of a settled state, and d(port errors)/d(errors of the state), (12, n).

    rate_variance: of the chaser's rate beyond the errors of the state, (3,) rad^2/s^2; the gyro's noise if left out.
    """
    C_TL = state.dcm_lvlh_from_target.T
    C_TB = C_TL @ frame.dcm_lvlh_from_inertial(state.t_s) @ state.dcm_inertial_from_chaser
    motion = np.concatenate([state.values[POSITION], state.values[VELOCITY]])
    rates, d = np.stack([state.values[TARGET_RATE], chaser_rate_rad_s]), np.array(vehicle.chaser.port_position_m)
    found, by_target, by_chaser = np.empty((3, 3)), np.empty((POSE, POSE)), np.empty((POSE, 3))
    told = C_TB, motion, rates, frame_rate(frame.vector, state.t_s), d, found, by_target, by_chaser
    port_geometry_into(np.ascontiguousarray(C_TL), *told, np.empty((4, 3)))
    by_rate = np.zeros((POSE, 3))  # by the error of the chaser's rate, which is less that of the bias
    by_rate[VELOCITY], by_rate[TARGET_RATE] = by_chaser[POSITION], by_chaser[TARGET_ATTITUDE]
    J = np.zeros((POSE, len(state.values)))
    J[:, :POSE], J[:, CHASER_ATTITUDE], J[:, GYRO_BIAS] = by_target, by_chaser, -by_rate
    noise = vehicle.gyro.random_walk_rad_sqrt_s**2 * vehicle.gyro.rate_hz
    errors = state.covariance[:ERRORS, :ERRORS] * _SIGNS * _SIGNS[:, None]
    if vehicle.gyro.is_off:
        J[:, GYRO_ERRORS] = -by_rate @ by_errors(chaser_rate_rad_s)
        of_rate = np.zeros((ERRORS, len(state.values)))
        of_rate[:, :ERRORS] = np.diag(_SIGNS)
        of_rate[-3:, GYRO_ERRORS] = -by_errors(chaser_rate_rad_s)
        errors = of_rate @ state.covariance @ of_rate.T
    errors.reshape(-1)[_RATE_VARIANCES] += noise if rate_variance is None else rate_variance
    by_moving = J[:, :ERRORS] * _SIGNS
    whole = by_moving @ errors @ by_moving.T
    add_second_order(*told, errors, whole, np.zeros((), SECOND_ORDER)[()])
    position = found[ARM] - np.array(vehicle.target.port_position_m)
    return PortState(position, found[PORT_VELOCITY], C_TB, found[RATE], 0.5 * (whole + whole.T)), J
