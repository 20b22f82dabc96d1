"""From a vehicle's state to what docking needs: port from port, its rate, attitude and rate, with joint covariance.

    r = C_TL rho + C_TB d - p,   v = C_TL (v_L + w_L x rho) + C_TB (w_B x d) - w_T x (r + p),   w = w_T - C_TB w_B

in target axes: d and p are the ports of chaser and target, w_B the chaser's inertial rate, sample less bias, and w_L
that of `lvlh_ccsds`. The errors of the gyro's bias and the noise of its sample are in velocity and rate.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.dynamics.relative_motion import frame_rate
from relnav.geometry.linear_algebra import cross_matrix
from relnav.spacecraft import Vehicle
from relnav.vehicle.layout import (
    CHASER_ATTITUDE,
    GYRO_BIAS,
    POSITION,
    TARGET_ATTITUDE,
    TARGET_RATE,
    VELOCITY,
)
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.state import VehicleState


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
        """
        from scipy.special import ndtri

        level: Vector = -ndtri(0.5 * probability) * self.sigma[:3]
        return level


def port_state(
    vehicle: Vehicle, frame: OrbitFrame, state: VehicleState, chaser_rate_rad_s: Vector
) -> tuple[PortState, Matrix]:
    """The ports of a settled state, and d(port errors)/d(errors of the state), (12, n)."""
    d, p = np.array(vehicle.chaser.port_position_m), np.array(vehicle.target.port_position_m)
    rho, v, w_T = state.values[POSITION], state.values[VELOCITY], state.values[TARGET_RATE]
    C_TL = state.dcm_lvlh_from_target.T
    C_TB = C_TL @ frame.dcm_lvlh_from_inertial(state.t_s) @ state.dcm_inertial_from_chaser
    w_L = np.array([0.0, -frame_rate(frame.vector, state.t_s), 0.0])
    arm, swing = C_TL @ rho + C_TB @ d, np.cross(chaser_rate_rad_s, d)
    inertial, turning = C_TL @ (v + np.cross(w_L, rho)) + C_TB @ swing, C_TB @ chaser_rate_rad_s
    w, u = cross_matrix(w_T), cross_matrix(arm)
    J = np.zeros((12, len(state.values)))
    J[:3, POSITION], J[:3, TARGET_ATTITUDE], J[:3, CHASER_ATTITUDE] = C_TL, u, -C_TB @ cross_matrix(d)
    J[3:6, POSITION], J[3:6, VELOCITY] = C_TL @ cross_matrix(w_L) - w @ C_TL, C_TL
    J[3:6, TARGET_ATTITUDE], J[3:6, TARGET_RATE] = cross_matrix(inertial) - w @ u, u
    J[3:6, CHASER_ATTITUDE] = -C_TB @ cross_matrix(swing) - w @ J[:3, CHASER_ATTITUDE]
    J[6:9, TARGET_ATTITUDE], J[6:9, CHASER_ATTITUDE] = np.eye(3), -C_TB
    J[9:, TARGET_RATE], J[9:, TARGET_ATTITUDE] = np.eye(3), -cross_matrix(turning)
    J[9:, CHASER_ATTITUDE] = C_TB @ cross_matrix(chaser_rate_rad_s)
    by_rate = np.zeros((12, 3))  # by the error of the chaser's rate, which is less that of the bias
    by_rate[3:6], by_rate[9:] = -C_TB @ cross_matrix(d), -C_TB
    J[:, GYRO_BIAS] = -by_rate
    noise = vehicle.gyro.random_walk_rad_sqrt_s**2 * vehicle.gyro.rate_hz
    whole = J @ state.covariance @ J.T + noise * by_rate @ by_rate.T
    velocity = inertial - np.cross(w_T, arm)
    return PortState(arm - p, velocity, C_TB, w_T - turning, 0.5 * (whole + whole.T)), J
