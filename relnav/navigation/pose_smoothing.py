"""Smoothing of a marker log: backward over every event, images where they were exposed.

Rauch, Tung, Striebel (1965) on the twelve errors, with the gain C = Pf Phi^T Pp^-1 of each step and the covariance as a
sum that stays positive definite:

    xs = xf + C (xs later - xp),        Ps = (I - C Phi) Pf (I - C Phi)^T + C (Ps later + Q) C^T.

Differences of attitudes are rotation vectors in target axes, as in the filter. A piece ends where the bank began anew,
and where more than one pose was possible: there the filter's own states stand.
"""

from dataclasses import replace

import numpy as np

from relnav.arrays import Matrix
from relnav.dynamics.rigid_body import RigidBody
from relnav.mission import VisionMission
from relnav.navigation.docking_port import docking_state
from relnav.navigation.pose_log import PoseSolution
from relnav.navigation.pose_state import PoseState, time_update
from relnav.navigation.relative_pose import Passed, PoseNavigator


def smoothed_step(
    state: PoseState, later: PoseState, predicted: PoseState, transition: Matrix, noise: Matrix
) -> PoseState:
    """A filtered state, smoothed by what is known at the next event: `later`, predicted there by Phi, Q (12, 12)."""
    scale = 1.0 / np.sqrt(np.diagonal(predicted.covariance))  # metres and rad/s are far apart
    correlation = predicted.covariance * scale * scale[:, None]
    gain = np.linalg.solve(correlation, (scale[:, None] * transition) @ state.covariance).T * scale
    rest = np.eye(12) - gain @ transition
    covariance = rest @ state.covariance @ rest.T + gain @ (later.covariance + noise) @ gain.T
    return state.moved(gain @ predicted.error_of(later), 0.5 * (covariance + covariance.T))


def smoothed_states(passed: list[Passed], mission: VisionMission) -> list[PoseState | None]:
    """The state at each event, None where there is none."""
    body = RigidBody(np.array(mission.target.inertia_kg_m2), mission.orbit.mean_motion_rad_s)
    out: list[PoseState | None] = [None] * len(passed)
    later: PoseState | None = None
    for k in range(len(passed) - 1, -1, -1):
        bank = passed[k].bank
        if not bank.hypotheses:
            later = None
            continue
        state = bank.hypotheses[0].state
        alone = len(bank.hypotheses) == 1
        if later is not None and alone:
            event = passed[k + 1].event
            step = event.t_s - passed[k].event.t_s
            predicted, phi, noise = time_update(state, step, body, mission, event.acceleration_m_s2, event.delta_v_m_s)
            state = smoothed_step(state, later, predicted, phi, noise)
        out[k] = state
        later = state if alone and not passed[k].started else None
    return out


def smoothed_solution(solution: PoseSolution, navigator: PoseNavigator) -> PoseSolution:
    """The solution of a whole log, smoothed; the navigator that worked through it kept what passed."""
    mission, passed = navigator.mission, navigator.passed
    states = smoothed_states(passed, mission)
    arrays = {
        name: getattr(solution, name).copy()
        for name in (
            *("state", "dcm_lvlh_from_target", "rate_rad_s", "covariance"),
            *("port_m", "port_velocity_m_s", "dcm_target_from_chaser", "relative_rate_rad_s", "docking_covariance"),
        )
    }
    rows = [k for k, one in enumerate(passed) if one.row]
    assert len(rows) == len(solution)
    for i, k in enumerate(rows):
        state = states[k]
        if state is None:
            continue
        docking = docking_state(state, mission, passed[k].event.dcm_chaser_from_lvlh)
        arrays["state"][i], arrays["dcm_lvlh_from_target"][i] = state.motion, state.dcm_lvlh_from_target
        arrays["rate_rad_s"][i], arrays["covariance"][i] = state.rate_rad_s, state.covariance
        arrays["port_m"][i], arrays["port_velocity_m_s"][i] = docking.position_m, docking.velocity_m_s
        arrays["dcm_target_from_chaser"][i] = docking.dcm_target_from_chaser
        arrays["relative_rate_rad_s"][i], arrays["docking_covariance"][i] = docking.rate_rad_s, docking.covariance
    return replace(solution, **arrays, smoothed=True)
