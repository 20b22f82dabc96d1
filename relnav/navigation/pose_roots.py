"""Poses that explain one image, as hypotheses of the marker filter: to open a trial, and those that none covers."""

import math
from dataclasses import replace

import numpy as np

from relnav.arrays import Flags, Matrix, Record, Stack
from relnav.estimation.factored import compose, factorize
from relnav.estimation.gating import chi_square_limit
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import VisionMission
from relnav.navigation.memory import fill
from relnav.navigation.pose_filter import DROP
from relnav.navigation.pose_memory import MOST_POSES, PoseMemory
from relnav.navigation.pose_state import PoseState, state_from_pose
from relnav.sensors.three_marker.measure import measure
from relnav.sensors.three_marker.outcome import MISFIT_PROBABILITY
from relnav.sensors.three_marker.pose import Pose
from relnav.sensors.three_marker.sensor import View

WIDENED = 4.0
_COVERED = 16.0  # chi-square: a root whose attitude is this near a hypothesis starts none


def state_of(track: Record) -> PoseState:
    """A hypothesis as values of their own."""
    return PoseState(track["motion"].copy(), track["dcm"].copy(), track["rate"].copy(), compose(track["ld"]))


def write_state(track: Record, state: PoseState, score: float = 0.0) -> None:
    """Write a state as a hypothesis."""
    covariance = 0.5 * (state.covariance + state.covariance.T)
    fill(
        track,
        motion=state.motion,
        dcm=state.dcm_lvlh_from_target,
        rate=state.rate_rad_s,
        state=0.0,
        ld=factorize(covariance),
        score=score,
    )


def _with_view(pose: Pose, view: View) -> Pose:
    """A root joined with the expected view, by which alone a flat pattern far off tells its tilt."""
    known = np.zeros((6, 6))
    known[3:, 3:] = np.eye(3) / view.attitude_sigma_rad**2
    covariance = np.asarray(np.linalg.inv(np.linalg.inv(pose.covariance) + known), dtype=np.float64)
    toward = known[:, 3:] @ rotation_vector_between(view.dcm_cam_from_target, pose.dcm_cam_from_target)
    shift = covariance @ toward
    return Pose(pose.position_m + shift[:3], turned(pose.dcm_cam_from_target, shift[3:]), covariance)


def roots(
    spots: Matrix,
    covariances: Stack | None,
    dcm_chaser_from_lvlh: Matrix,
    mission: VisionMission,
    believed: PoseState | None,
) -> tuple[list[PoseState], Flags]:
    """States on the poses that explain an image and are not a million times less credible than the best; markers used.

    The expected view decides and is part of the state. An image whose spots misfit every pose has none.
    """
    result = measure(spots, mission, spot_covariance_px2=covariances)
    used = np.array(result.labels) >= 0
    worst = chi_square_limit(1.0 - MISFIT_PROBABILITY, result.dof) if result.dof > 0 else math.inf
    out = []
    for root in result.roots:
        if root.score - result.roots[0].score > DROP or root.misfit > worst:
            continue
        pose = _with_view(root.pose, mission.view)
        state = state_from_pose(pose, mission, dcm_chaser_from_lvlh, widened=WIDENED)
        if believed is not None:  # the velocity is common to all: unknown, its width alone would cost the odds
            motion, covariance = np.concatenate([state.motion[:3], believed.motion[3:]]), state.covariance.copy()
            covariance[3:6, 3:6] = WIDENED * believed.covariance[3:6, 3:6]
            state = replace(state, motion=motion, covariance=covariance)
        out.append(state)
    return out, used


def open_trial(m: PoseMemory, states: list[PoseState], used: Flags) -> None:
    """Begin a trial on the poses of an image; used: which markers' spots they rest on."""
    for track, state in zip(m.trial, states, strict=False):
        write_state(track, state)
    m.clock["trial"] = min(len(states), MOST_POSES)
    m.trial_used_s[:] = np.where(used, m.clock["t"], np.nan)


def add_uncovered(m: PoseMemory, states: list[PoseState]) -> None:
    """A hypothesis for each pose that none covers, as credible as the best."""
    count = int(m.clock["running"])
    bank = [state_of(track) for track in m.bank[:count]]
    for state in states:
        if all(_distance2(held, state) > _COVERED for held in bank) and m.clock["running"] < MOST_POSES:
            write_state(m.bank[int(m.clock["running"])], state, float(m.bank[0]["score"]))
            m.clock["running"] += 1


def _distance2(held: PoseState, root: PoseState) -> float:
    """Chi-square between the attitudes of a hypothesis and of a root."""
    difference = held.error_of(root)[6:9]
    spread = (held.covariance + root.covariance)[6:9, 6:9]
    return float(difference @ np.linalg.solve(spread, difference))
