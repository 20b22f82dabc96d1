"""From the pose filter's state to what docking needs: port from port, its rate, the relative attitude and rate."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.relative_motion import frame_rate
from relnav.geometry.linear_algebra import cross_matrix
from relnav.mission import VisionMission
from relnav.navigation.memory import orbit_values


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


def docking_states(
    motion: Matrix,
    dcm_lvlh_from_target: Stack,
    rate_rad_s: Matrix,
    covariance: Stack,
    mission: VisionMission,
    dcm_chaser_from_lvlh: Stack,
    t_s: Vector,
    chaser_rate_rad_s: Matrix | None = None,
    by_chaser: Stack | None = None,
) -> DockingState:
    """Docking states of n estimates, each field with a leading axis (n, ...).

    Parameters
    ----------
    motion, dcm_lvlh_from_target, rate_rad_s, covariance : (n, 6), (n, 3, 3), (n, 3), (n, 12, 12)
        Estimates, as in `PoseRecord`.
    mission
        Where the ports are, and how well the chaser knows its attitude.
    dcm_chaser_from_lvlh : (n, 3, 3)
        The chaser's attitude.
    t_s : (n,)
        When: about an eccentric target `lvlh_ccsds` does not turn evenly.
    chaser_rate_rad_s : (n, 3), optional
        Its inertial rate, chaser axes; that of a chaser held in `lvlh_ccsds` if left out.
    by_chaser : (n, 3, 12), optional
        What one sigma of the chaser's lasting attitude error, each axis, has done to the estimates (estimate minus
        truth). Where from the target is seen by the camera does not depend on that attitude: the two cancel.
    """
    orbit = orbit_values(mission.orbit)
    turn = np.array([frame_rate(orbit, t) for t in t_s])
    w_L = cross_matrix(np.multiply.outer(turn, [0.0, -1.0, 0.0]))
    own = -dcm_chaser_from_lvlh[:, :, 1] * turn[:, None] if chaser_rate_rad_s is None else chaser_rate_rad_s
    count, port = len(motion), np.array(mission.chaser.port_position_m)
    C_TL, w = np.swapaxes(dcm_lvlh_from_target, 1, 2), cross_matrix(rate_rad_s)
    C_TB = C_TL @ np.swapaxes(dcm_chaser_from_lvlh, 1, 2)
    rho, v = motion[:, :3, None], motion[:, 3:, None]
    d_B, lever_rate = cross_matrix(port), np.cross(own, port)[:, :, None]
    u = (C_TL @ rho)[:, :, 0] + C_TB @ port  # the chaser's port from the target's centre of mass
    inertial, turning, arm = C_TL @ (v + w_L @ rho) + C_TB @ lever_rate, C_TB @ own[:, :, None], cross_matrix(u)
    G = np.zeros((count, 12, 12))  # by (drho, dv, theta, dw)
    G[:, :3, :3], G[:, :3, 6:9] = C_TL, arm
    G[:, 3:6, :3], G[:, 3:6, 3:6] = C_TL @ w_L - w @ C_TL, C_TL
    G[:, 3:6, 6:9], G[:, 3:6, 9:] = cross_matrix(inertial[:, :, 0]) - w @ arm, arm
    G[:, np.arange(6, 12), np.arange(6, 12)] = 1.0
    G[:, 9:, 6:9] = -cross_matrix(turning[:, :, 0])
    A = np.empty((count, 12, 3))  # by the chaser's attitude error
    A[:, :3] = -C_TB @ d_B
    A[:, 3:6] = -C_TB @ cross_matrix(lever_rate[:, :, 0]) - w @ A[:, :3]
    A[:, 6:9] = -C_TB
    A[:, 9:] = C_TB @ cross_matrix(own)
    whole = G @ covariance @ np.swapaxes(G, 1, 2)
    chaser = mission.chaser
    whole += (chaser.attitude_sigma_rad**2 + chaser.attitude_noise_rad**2) * A @ np.swapaxes(A, 1, 2)
    if by_chaser is not None:
        both = chaser.attitude_sigma_rad * A @ (by_chaser @ np.swapaxes(G, 1, 2))
        whole -= both + np.swapaxes(both, 1, 2)
    velocity = (inertial - w @ u[:, :, None])[:, :, 0]
    symmetric = 0.5 * (whole + np.swapaxes(whole, 1, 2))
    relative_rate = rate_rad_s - turning[:, :, 0]
    return DockingState(u - np.array(mission.target.port_position_m), velocity, C_TB, relative_rate, symmetric)
