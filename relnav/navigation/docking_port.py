"""From the pose filter's state to what docking needs: port from port, its rate, the relative attitude and rate."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry
from relnav.dynamics.docking_port import ARM, RATE, VELOCITY, port_geometry_into
from relnav.dynamics.error_state import POSE
from relnav.dynamics.port_second_order import ALPHA, ERRORS, SECOND_ORDER, add_second_order
from relnav.dynamics.relative_motion import frame_rate
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
    orbit, count, chaser = orbit_values(mission.orbit), len(motion), mission.chaser
    turn = np.array([frame_rate(orbit, t) for t in t_s])
    own = -dcm_chaser_from_lvlh[:, :, 1] * turn[:, None] if chaser_rate_rad_s is None else chaser_rate_rad_s
    ports = np.array([chaser.port_position_m, mission.target.port_position_m], dtype=np.float64)
    if by_chaser is None:
        by_chaser = np.zeros((count, 3, POSE))
    values, C_TB, whole = np.empty((count, 3, 3)), np.empty((count, 3, 3)), np.empty((count, POSE, POSE))
    told = motion, dcm_lvlh_from_target, rate_rad_s, covariance, dcm_chaser_from_lvlh, own, turn, by_chaser, ports
    sigma = np.array([chaser.attitude_sigma_rad, chaser.attitude_noise_rad])
    scratch = np.empty((3 * POSE, POSE)), np.zeros((ERRORS, ERRORS)), np.zeros((), SECOND_ORDER)[()]
    arguments = [*map(np.ascontiguousarray, told), sigma, values, C_TB, whole, *scratch]
    _write_docking(*arguments)
    return DockingState(values[:, ARM], values[:, VELOCITY], C_TB, values[:, RATE], whole)


@entry
def _write_docking(
    motion: Matrix,
    dcm: Stack,
    rate: Matrix,
    covariance: Stack,
    chaser: Stack,
    own: Matrix,
    turn: Vector,
    by_chaser: Stack,
    ports: Matrix,
    sigma: Vector,
    values: Stack,
    relative: Stack,
    whole: Stack,
    work: Matrix,
    errors: Matrix,
    second: Record,
) -> None:
    """Write values (n, 3, 3), relative attitudes (n, 3, 3) and covariances (n, 12, 12) of `docking_states`.

    sigma (2,): of the chaser's attitude, lasting and new at an image; work (36, 12), errors (18, 18), zero before, and
    second, of SECOND_ORDER, are scratch.
    """
    G, product, taken = work[:POSE], work[POSE : 2 * POSE], work[2 * POSE : 2 * POSE + 3]
    A, rows = work[2 * POSE + 3 : 2 * POSE + 6].reshape((POSE, 3)), work[2 * POSE + 6 :].reshape((2 * POSE, 3))
    total = sigma[0] * sigma[0] + sigma[1] * sigma[1]
    for k in range(motion.shape[0]):
        C_TL, C_TB, rates, P, out = rows[:3], relative[k], rows[3:5], covariance[k], whole[k]
        for i in range(3):
            rates[0, i], rates[1, i] = rate[k, i], own[k, i]
            for j in range(3):
                C_TL[i, j] = dcm[k, j, i]
        for i in range(3):
            for j in range(3):
                C_TB[i, j] = C_TL[i, 0] * chaser[k, j, 0] + C_TL[i, 1] * chaser[k, j, 1] + C_TL[i, 2] * chaser[k, j, 2]
        port_geometry_into(C_TL, C_TB, motion[k], rates, turn[k], ports[0], values[k], G, A, rows[5:9])
        for i in range(POSE):
            for j in range(POSE):
                product[i, j] = 0.0
            for c in range(3):
                taken[c, i] = 0.0
            for r in range(POSE):
                if G[i, r] != 0.0:
                    for j in range(POSE):
                        product[i, j] += G[i, r] * P[r, j]
                    for c in range(3):
                        taken[c, i] += by_chaser[k, c, r] * G[i, r]
        for i in range(POSE):
            for j in range(i + 1):
                variance = 0.0
                for r in range(POSE):
                    if G[j, r] != 0.0:
                        variance += product[i, r] * G[j, r]
                for c in range(3):
                    variance += total * A[i, c] * A[j, c] - sigma[0] * (A[i, c] * taken[c, j] + A[j, c] * taken[c, i])
                out[i, j], out[j, i] = variance, variance
        for i in range(POSE):
            for j in range(POSE):
                errors[i, j] = P[i, j]
            for c in range(3):
                errors[i, ALPHA + c] = errors[ALPHA + c, i] = -sigma[0] * by_chaser[k, c, i]
        for c in range(3):
            errors[ALPHA + c, ALPHA + c] = total
        add_second_order(C_TB, motion[k], rates, turn[k], ports[0], values[k], G, A, errors, out, second)
        for i in range(3):
            values[k, ARM, i] -= ports[1, i]
