"""From the pose filter's state to what docking needs: port from port, its rate, the relative attitude and rate."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.mission import VisionMission
from relnav.navigation.pose_state import PoseState


@dataclass(frozen=True)
class DockingState:
    """The chaser's docking port seen from the target's, target axes.

    Attributes
    ----------
    position_m, velocity_m_s : (3,)
        Of the chaser's port from the target's port; velocity as seen in the turning target.
    dcm_target_from_chaser : (3, 3)
    rate_rad_s : (3,)
        Of the target relative to the chaser.
    covariance : (12, 12)
        Of (position, velocity, theta, rate), the true attitude target-to-chaser being dcm^T exp([theta x]), theta in
        target axes; the chaser's own attitude error is in it.
    """

    position_m: Vector
    velocity_m_s: Vector
    dcm_target_from_chaser: Matrix
    rate_rad_s: Vector
    covariance: Matrix


def docking_state(
    state: PoseState, mission: VisionMission, dcm_chaser_from_lvlh: Matrix, chaser_rate_rad_s: Vector | None = None
) -> DockingState:
    """Docking state of an estimate.

    Parameters
    ----------
    state, mission
        Estimate, and where the ports are.
    dcm_chaser_from_lvlh : (3, 3)
        The chaser's attitude.
    chaser_rate_rad_s : (3,), optional
        Its inertial rate, chaser axes; that of a chaser held in `lvlh_ccsds` if left out.
    """
    orbit = cross_matrix([0.0, -mission.orbit.mean_motion_rad_s, 0.0])  # [w_L x]
    own = (
        -dcm_chaser_from_lvlh[:, 1] * mission.orbit.mean_motion_rad_s
        if chaser_rate_rad_s is None
        else chaser_rate_rad_s
    )
    C_TL, w = state.dcm_lvlh_from_target.T, cross_matrix(state.rate_rad_s)
    C_TB = C_TL @ dcm_chaser_from_lvlh.T
    rho, v = state.motion[:3], state.motion[3:]
    d_B, d_T = cross_matrix(mission.chaser.port_position_m), np.array(mission.target.port_position_m)
    lever_rate = cross_matrix(own) @ mission.chaser.port_position_m
    u = C_TL @ rho + C_TB @ mission.chaser.port_position_m  # the chaser's port from the target's centre of mass
    inertial, turning, arm = C_TL @ (v + orbit @ rho) + C_TB @ lever_rate, C_TB @ own, cross_matrix(u)
    G = np.zeros((12, 12))  # by (drho, dv, theta, dw)
    G[:3, :3], G[:3, 6:9] = C_TL, arm
    G[3:6, :3], G[3:6, 3:6] = C_TL @ orbit - w @ C_TL, C_TL
    G[3:6, 6:9], G[3:6, 9:] = cross_matrix(inertial) - w @ arm, arm
    G[[6, 7, 8, 9, 10, 11], [6, 7, 8, 9, 10, 11]] = 1.0
    G[9:, 6:9] = -cross_matrix(turning)
    A = np.empty((12, 3))  # by the chaser's attitude error
    A[:3] = -C_TB @ d_B
    A[3:6] = -C_TB @ cross_matrix(lever_rate) - w @ A[:3]
    A[6:9] = -C_TB
    A[9:] = C_TB @ cross_matrix(own)
    covariance = G @ state.covariance @ G.T + mission.chaser.attitude_sigma_rad**2 * A @ A.T
    relative_rate = state.rate_rad_s - turning
    return DockingState(u - d_T, inertial - w @ u, C_TB, relative_rate, 0.5 * (covariance + covariance.T))
