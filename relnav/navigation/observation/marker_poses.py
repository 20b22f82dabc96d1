"""Poses that explain one image, as hypotheses of the marker filter: to open a trial, and those that none covers."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from relnav.arrays import Flags, Matrix, Record, Stack
from relnav.dynamics.error_state import MOTION, RATE, THETA, VELOCITY
from relnav.estimation.factored import compose, factorize
from relnav.estimation.gating import chi_square_limit
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import VisionMission
from relnav.navigation.memory import fill
from relnav.navigation.observation.marker_twins import twins_of
from relnav.navigation.pose_filter import DROP, RENEWED_S
from relnav.navigation.pose_memory import MOST_POSES, PoseMemory
from relnav.navigation.pose_propagation import MEMORY_S
from relnav.navigation.pose_state import SHOWN, PoseState, lasting_by_spot, sensitivities_from_pose, state_from_pose
from relnav.sensors.three_marker.camera import image_of
from relnav.sensors.three_marker.jacobians import spot_jacobians
from relnav.sensors.three_marker.measure import measure
from relnav.sensors.three_marker.outcome import MISFIT_PROBABILITY
from relnav.sensors.three_marker.pose import Pose
from relnav.sensors.three_marker.pose import Root as SeenRoot
from relnav.sensors.three_marker.sensor import View

WIDENED = 4.0
COVERED = 6.25  # chi-square, 90 % of three: a root whose attitude is this near a hypothesis starts none
FOLLOWED = 0.25
"""Of the way from a root to the next: nearer than that is one beside the leading one that follows it, if too slowly."""
BEATEN = 0.5
"""Of the way from a root to the leading one: nearer than that is a pose which that one has beaten."""
SAME_RAD = 0.01
"""Two roots nearer than that are one: those of an image, and those of the spots that are predicted for it."""


@dataclass(frozen=True)
class Root:
    """A state on a pose that explains an image; sensitivities: gives what considered errors do to it, (m, 12).

    predicted: the image is one that a hypothesis predicts, without noise.
    """

    state: PoseState
    sensitivities: Callable[[], Matrix]
    predicted: bool = False


def state_of(track: Record, sensitivities: Matrix) -> PoseState:
    """A hypothesis as values of their own, what is considered in its covariance."""
    covariance = compose(track["ld"]) + sensitivities.T @ sensitivities
    return PoseState(track["motion"].copy(), track["dcm"].copy(), track["rate"].copy(), covariance)


def write_root(track: Record, sensitivities: Matrix, root: Root, score: float = 0.0) -> None:
    """Write a root as a hypothesis; the target's inertia has done nothing to it yet."""
    by_root = root.sensitivities()
    sensitivities[:] = 0.0
    sensitivities[: len(by_root)] = by_root
    write_state(track, root.state, score)


def write_state(track: Record, state: PoseState, score: float = 0.0) -> None:
    """Write a state as a hypothesis, its covariance as the filter's own."""
    covariance = 0.5 * (state.covariance + state.covariance.T)
    fill(
        track,
        motion=state.motion,
        dcm=state.dcm_lvlh_from_target,
        rate=state.rate_rad_s,
        state=0.0,
        ld=factorize(covariance),
        score=score,
        doubt=0.0,
        prior=0.0,
        added=-math.inf,
    )


def _with_view(pose: Pose, view: View) -> Pose:
    """A root joined with the expected view, by which alone a flat pattern far off tells its tilt."""
    known = np.zeros(pose.covariance.shape)
    known[3:, 3:] = np.eye(3) / view.attitude_sigma_rad**2
    covariance = np.asarray(np.linalg.solve(np.eye(len(known)) + pose.covariance @ known, pose.covariance))
    toward = known[:, 3:] @ rotation_vector_between(view.dcm_cam_from_target, pose.dcm_cam_from_target)
    shift = covariance @ toward
    return Pose(pose.position_m + shift[:3], turned(pose.dcm_cam_from_target, shift[3:]), covariance)


def roots(
    spots: Matrix,
    covariances: Stack | None,
    dcm_chaser_from_lvlh: Matrix,
    mission: VisionMission,
    believed: tuple[PoseState, Matrix] | None,
    near: Sequence[Matrix],
    view: View,
    t_s: float,
) -> tuple[list[Root], Flags, bool]:
    """States on the poses that explain an image, of t_s, and the markers used.

    view: the expected one by now; it is part of the state. Left out is a pose that is a million times less credible
    than the best, by the mission's own view. An image whose spots misfit every pose has none, and a pose that
    contradicts the view has no state, unless it is as near an attitude of `near`, dcm_cam_from_target: the last value
    says whether one was left out for that.
    """
    result = measure(spots, mission, spot_covariance_px2=covariances)
    expected = [view.dcm_cam_from_target, *near]
    used = np.array(result.labels) >= 0
    worst = chi_square_limit(1.0 - MISFIT_PROBABILITY, result.dof) if result.dof > 0 else math.inf
    out, contradicted = [], False
    explained = [_explained(root, spots, used, covariances, mission, result.dof) for root in result.roots]
    best = min((root.score for root in explained), default=0.0)
    for root in explained:
        if root.score - best > DROP or root.misfit > worst:
            continue
        if all(_contradicts(root.pose, dcm, view.attitude_sigma_rad) for dcm in expected):
            contradicted = True
            continue
        pose = _with_view(root.pose, view)
        state = state_from_pose(pose, mission, dcm_chaser_from_lvlh, t_s=t_s, widened=WIDENED)
        if believed is not None:  # the velocity is common to all: unknown, its width alone would cost the odds
            known = believed[0]
            motion, covariance = np.concatenate([state.motion[:3], known.motion[3:]]), state.covariance.copy()
            covariance[VELOCITY:MOTION, VELOCITY:MOTION] = WIDENED * known.covariance[VELOCITY:MOTION, VELOCITY:MOTION]
            state = replace(state, motion=motion, covariance=covariance)
        held = None if believed is None else believed[1]
        told = (root.pose, pose.covariance, mission, dcm_chaser_from_lvlh, used, covariances)
        out.append(Root(state, partial(_sensitivities, held, *told)))
    return out, used, contradicted


def _explained(
    root: SeenRoot, spots: Matrix, used: Flags, covariances: Stack | None, mission: VisionMission, dof: int
) -> SeenRoot:
    """A root with the misfit of the used spots (n, 2) px that is left where lasting errors explain what they can.

    Of residuals r, slopes H by the pose and G by these errors: r^T (W - W H (H^T W H)^-1 H^T W) r, W = (R + G G^T)^-1.
    """
    if dof <= 0 or mission.tolerances is None or not mission.tolerances.considered:
        return root
    pose = np.vstack([root.pose.dcm_cam_from_target, root.pose.position_m])
    expected, _ = image_of(mission.markers.points_m @ pose[:3].T + pose[3], mission.camera)
    by = spot_jacobians(mission.markers.points_m, pose, mission.camera)
    h = np.concatenate([by.position, by.attitude], axis=2)[used].reshape(-1, len(SHOWN))
    g, r = lasting_by_spot(root.pose, mission)[used].reshape(len(h), -1), (spots - expected)[used].ravel()
    noise = g @ g.T
    for i, marker in enumerate(np.flatnonzero(used)):
        own = mission.camera.spot_noise_px**2 * np.eye(2) if covariances is None else covariances[marker]
        noise[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += own
    weighted = np.linalg.solve(noise, np.column_stack([h, r]))
    right = h.T @ weighted
    misfit = float(r @ weighted[:, -1] - right[:, -1] @ np.linalg.solve(right[:, :-1], right[:, -1]))
    return replace(root, misfit=misfit, score=root.score + misfit - root.misfit)


def _sensitivities(
    held: Matrix | None,
    pose: Pose,
    joint: Matrix,
    mission: VisionMission,
    dcm: Matrix,
    used: Flags,
    covariances: Stack | None,
) -> Matrix:
    """Of the state on a root; held (m, 12): of the hypothesis whose velocity it takes."""
    sensitivities = sensitivities_from_pose(pose, joint, mission, dcm, used, covariances)
    if held is not None:
        sensitivities[:, VELOCITY:MOTION] = held[: len(sensitivities), VELOCITY:MOTION]
    return sensitivities


def view_at(view: View, elapsed_s: float, rate_sigma_rad_s: float) -> View:
    """The expected view after a time, the target's rate being known to a sigma."""
    return replace(
        view, attitude_sigma_rad=min(math.pi, math.hypot(view.attitude_sigma_rad, rate_sigma_rad_s * elapsed_s))
    )


def _contradicts(pose: Pose, dcm_cam_from_target: Matrix, sigma_rad: float) -> bool:
    """Whether a pose's attitude is farther from another, known to a sigma, than chance allows once in a million."""
    off = rotation_vector_between(pose.dcm_cam_from_target, dcm_cam_from_target)
    spread = pose.covariance[3:, 3:] + sigma_rad**2 * np.eye(3)
    return bool(off @ np.linalg.solve(spread, off) > chi_square_limit(1.0 - MISFIT_PROBABILITY, 3))


def open_trial(m: PoseMemory, found: list[Root], used: Flags) -> None:
    """Begin a trial on the poses of an image; used: which markers' spots they rest on."""
    for track, sensitivities, root in zip(m.trial, m.trial_sensitivities, found, strict=False):
        write_root(track, sensitivities, root)
    m.trial_evidence[:] = np.eye(*m.trial_evidence.shape[1:])
    m.clock["trial"], m.clock["agreed"] = min(len(found), MOST_POSES), 0
    m.trial_used_s[:] = np.where(used, m.clock["t"], np.nan)


def add_uncovered(m: PoseMemory, found: list[Root], expected: Matrix) -> None:
    """A hypothesis for each pose that none covers; expected: the attitude as it was told, dcm_cam_from_target.

    It is as credible as the best. Where that has not been contested since roots were last looked for, and has beaten
    another, or is nearer to the expected attitude, it is a million times less credible: the images until then have
    decided against it, or the expected view alone did, which is only wider now.
    """
    count, lead, t = int(m.clock["running"]), m.bank[0], float(m.clock["t"])
    uncontested, off = t - m.clock["doubted"] > RENEWED_S, _turn_from(expected, m, lead["dcm"])
    has_beaten = bool(np.isfinite(m.beaten["t"]).any())
    bank = [state_of(m.bank[k], m.bank_sensitivities[k]) for k in range(count)]
    for root in found:
        k = len(bank)
        if k < MOST_POSES and not _is_covered(m, root, bank, found):
            write_root(m.bank[k], m.bank_sensitivities[k], root, float(lead["score"]))
            less = uncontested and (has_beaten or _turn_from(expected, m, root.state.dcm_lvlh_from_target) > off)
            fill(m.bank[k], prior=lead["prior"] + (DROP if less else 0.0), added=t)
            fill(m.clock, running=k + 1, doubted=m.clock["doubted"] if less else t)
            bank.append(root.state)
            m.bank_evidence[:] = np.eye(*m.bank_evidence.shape[1:])  # the new one knows nothing: compared from now on


def twins(m: PoseMemory, mission: VisionMission, dcm_chaser_from_lvlh: Matrix) -> list[Root]:
    """Poses that look like the leading hypothesis in every image; what is considered is in their covariance."""
    effects, t = m.bank_sensitivities[0], float(m.clock["t"])
    found = twins_of(state_of(m.bank[0], effects), t, mission, dcm_chaser_from_lvlh, DROP)
    return [
        Root(replace(one, covariance=WIDENED * one.covariance), partial(np.zeros, effects.shape), predicted=True)
        for one in found
    ]


def _is_covered(m: PoseMemory, root: Root, bank: list[PoseState], found: list[Root]) -> bool:
    """Whether a hypothesis may be on a root, or follows it, or its pose was beaten lately."""
    at = root.state.dcm_lvlh_from_target

    def turn_from(dcm: Matrix) -> float:
        return float(np.linalg.norm(rotation_vector_between(at, dcm)))

    turns = [turn_from(held.dcm_lvlh_from_target) for held in bank]
    others = [turn_from(other.state.dcm_lvlh_from_target) for other in found]
    next_rad = min((turn for turn in others if turn > SAME_RAD), default=math.pi)
    return (
        any(_distance2(held, root) <= COVERED for held in bank)
        or min(turns[1:], default=math.pi) < FOLLOWED * next_rad
        or any(
            turn_from(bank[0].dcm_lvlh_from_target @ one["dcm"]) < BEATEN * turns[0]
            for one in m.beaten
            if m.clock["t"] - one["t"] <= MEMORY_S
        )
    )


def _turn_from(expected: Matrix, m: PoseMemory, dcm_lvlh_from_target: Matrix) -> float:
    """By what angle an attitude is off the expected one, dcm_cam_from_target."""
    return float(np.linalg.norm(rotation_vector_between(m.camera["cam_from_lvlh"] @ dcm_lvlh_from_target, expected)))


def _distance2(held: PoseState, root: Root) -> float:
    """Chi-square between the attitudes of a hypothesis and of a root."""
    difference = held.error_of(root.state)[THETA:RATE]
    spread = (held.covariance + (0.0 if root.predicted else root.state.covariance))[THETA:RATE, THETA:RATE]
    return float(difference @ np.linalg.solve(spread, difference))
