"""One filter a hypothesis: starts on every pose that explains the first image, and drops what the spots refute.

A flat pattern has up to four poses that explain an image; a filter on the most credible one alone may follow the wrong
one for ever. Here each root starts a filter, with its covariance widened (seen head-on the misfit is no parabola, and
the truth lies up to 3 sigma off). A hypothesis falls when its latest spots are a million times less likely than
another's; every ten seconds roots that no hypothesis covers start new ones; two that have become one are joined.

The bank begins anew on an image of three markers when the filters are locked out, or when after a gap they know too
little for errors to count as small. An image that no pose explains begins nothing: the filters go on.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from relnav.arrays import Flags, Matrix, Stack, Vector
from relnav.dynamics.rigid_body import RigidBody
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import VisionMission
from relnav.navigation.pose_state import PoseState, state_from_pose, time_update
from relnav.navigation.spot_update import SpotUpdate, spot_update, spots_seen
from relnav.sensors.three_marker.measure import measure
from relnav.sensors.three_marker.outcome import MISFIT_PROBABILITY
from relnav.sensors.three_marker.pose import Pose
from relnav.sensors.three_marker.sensor import View

WIDENED = 4.0
DROP = 2.0 * math.log(1e6)
MEMORY_S = 50.0
"""Of the scores: what a filter was before it settled is forgotten."""
RENEWED_S = 10.0
_COVERED = 16.0  # chi-square: a root whose attitude is this near a hypothesis starts none
_JOINED = 1.0  # chi-square of twelve: two hypotheses this near are one
_MOST = 8
_LARGEST_TURN_RAD = 0.3
_LARGEST_SHARE_OF_RANGE = 0.2
"""1-sigma of attitude and position up to which errors count as small (tests: NEES after gaps)."""


@dataclass(frozen=True)
class Hypothesis:
    """A filter and minus twice its log-likelihood, the past fading."""

    state: PoseState
    score: float


@dataclass(frozen=True)
class Bank:
    """Everything that the navigator knows at one time; never changed, only replaced.

    Attributes
    ----------
    t_s : float
        NaN before the first epoch.
    hypotheses : tuple of Hypothesis
        The most credible first; empty before a start.
    renewed_s : float
        When roots were last looked for.
    used_s : tuple of float
        When each marker was last used, NaN = never; empty before a start.
    rejected : int
        Epochs in a row with at least half of what was seen rejected.
    """

    t_s: float = math.nan
    hypotheses: tuple[Hypothesis, ...] = ()
    renewed_s: float = -math.inf
    used_s: tuple[float, ...] = ()
    rejected: int = 0


@dataclass(frozen=True)
class Event:
    """What happens at one time: the control over the interval that ends there, and what was seen there.

    Attributes
    ----------
    t_s : float
    acceleration_m_s2, delta_v_m_s : (3,)
        `lvlh_ccsds`.
    spots_px : (n, 2) or None
    covariance_px2 : (n, 2, 2) or None
    dcm_chaser_from_lvlh : (3, 3)
    """

    t_s: float
    acceleration_m_s2: Vector
    delta_v_m_s: Vector
    spots_px: Matrix | None
    covariance_px2: Stack | None
    dcm_chaser_from_lvlh: Matrix


@dataclass(frozen=True)
class Outcome:
    """What an event did to the leading hypothesis: which markers had a spot (n,), which were used (n,), and so on."""

    seen: Flags
    accepted: Flags
    nis: float = math.nan
    dof: int = 0
    started: bool = False


def _with_view(pose: Pose, view: View) -> Pose:
    """A root joined with the expected view, by which alone a flat pattern far off tells its tilt."""
    known = np.zeros((6, 6))
    known[3:, 3:] = np.eye(3) / view.attitude_sigma_rad**2
    covariance = np.asarray(np.linalg.inv(np.linalg.inv(pose.covariance) + known), dtype=np.float64)
    toward = known[:, 3:] @ rotation_vector_between(view.dcm_cam_from_target, pose.dcm_cam_from_target)
    shift = covariance @ toward
    return Pose(pose.position_m + shift[:3], turned(pose.dcm_cam_from_target, shift[3:]), covariance)


def _roots(
    event: Event, spots: Matrix, mission: VisionMission, believed: PoseState | None
) -> tuple[list[PoseState], Flags]:
    """States on the poses that explain an image and are not a million times less credible than the best; markers used.

    The expected view decides and is part of the state. An image whose spots misfit every pose has none.
    """
    result = measure(spots, mission, spot_covariance_px2=event.covariance_px2)
    used = np.array(result.labels) >= 0
    worst = float(chdtri(result.dof, MISFIT_PROBABILITY)) if result.dof > 0 else math.inf
    out = []
    for root in result.roots:
        if root.score - result.roots[0].score > DROP or root.misfit > worst:
            continue
        pose = _with_view(root.pose, mission.view)
        state = state_from_pose(pose, mission, event.dcm_chaser_from_lvlh, widened=WIDENED)
        if believed is not None:  # the velocity is common to all: unknown, its width alone would cost the odds
            motion, covariance = np.concatenate([state.motion[:3], believed.motion[3:]]), state.covariance.copy()
            covariance[3:6, 3:6] = WIDENED * believed.covariance[3:6, 3:6]
            state = replace(state, motion=motion, covariance=covariance)
        out.append(state)
    return out, used


def _apart(one: PoseState, other: PoseState, parts: slice, spread: Matrix) -> float:
    difference = one.error_of(other)[parts]
    return float(difference @ np.linalg.solve(spread[parts, parts], difference))


def _joined(bank: list[Hypothesis]) -> list[Hypothesis]:
    """The most credible first, those that have become one with a better one left out."""
    kept: list[Hypothesis] = []
    for one in sorted(bank, key=lambda h: h.score):
        if one.score - (kept[0].score if kept else one.score) > DROP:
            break
        if all(_apart(h.state, one.state, slice(0, 12), h.state.covariance) > _JOINED for h in kept):
            kept.append(one)
    return kept[:_MOST]


def _renewed(bank: list[Hypothesis], event: Event, spots: Matrix, mission: VisionMission) -> list[Hypothesis]:
    """With a hypothesis for each root that none covers, as credible as the best."""
    best = bank[0]
    fresh = [
        state
        for state in _roots(event, spots, mission, best.state)[0]
        if all(_apart(h.state, state, slice(6, 9), h.state.covariance + state.covariance) > _COVERED for h in bank)
    ]
    return bank + [Hypothesis(state, best.score) for state in fresh]


def _begun(event: Event, mission: VisionMission, believed: PoseState | None = None) -> tuple[Bank, Outcome] | None:
    """A bank of the poses that explain the image; None if there are none."""
    if event.spots_px is None:
        return None
    states, used = _roots(event, event.spots_px, mission, believed)
    if not states:
        return None
    last_used = tuple(event.t_s if one else math.nan for one in used)
    bank = Bank(event.t_s, tuple(Hypothesis(state, 0.0) for state in states), event.t_s, last_used, 0)
    return bank, Outcome(spots_seen(event.spots_px), used, started=True)


def _is_wide(state: PoseState) -> bool:
    """Whether errors are no longer small: a full image then tells more than the state that it would correct."""
    variances: list[float] = np.diagonal(state.covariance).tolist()
    share = max(variances[:3]) / float(state.motion[:3] @ state.motion[:3])
    return max(variances[6:9]) > _LARGEST_TURN_RAD**2 or share > _LARGEST_SHARE_OF_RANGE**2


def _is_forgotten(state: PoseState, dt: float, mission: VisionMission) -> bool:
    """Whether after dt nothing is known of the attitude any more: 1-sigma of half a turn."""
    variances: list[float] = np.diagonal(state.covariance).tolist()
    drift = mission.target.rate_noise_density_rad2_s3 * dt**3 / 3.0
    return max(variances[6:9]) + max(variances[9:]) * dt**2 + drift > math.pi**2


def advance(bank: Bank, event: Event, mission: VisionMission, body: RigidBody, limit: float) -> tuple[Bank, Outcome]:
    """The bank after an event, and what became of it; limit: gate of each spot's NIS."""
    spots = event.spots_px
    count = len(mission.markers.positions_m)
    seen = np.zeros(count, dtype=bool) if spots is None else spots_seen(spots)
    nothing = Outcome(seen, np.zeros(count, dtype=bool))
    dt = event.t_s - bank.t_s if math.isfinite(bank.t_s) else 0.0
    known = [h for h in bank.hypotheses if not _is_forgotten(h.state, dt, mission)]
    if not known:
        return _begun(event, mission) or (Bank(event.t_s), nothing)
    fade = math.exp(-dt / MEMORY_S)
    moved = [Hypothesis(_moved(h.state, dt, event, body, mission), fade * h.score) for h in known]
    if spots is None or not np.count_nonzero(seen):
        return replace(bank, t_s=event.t_s, hypotheses=tuple(moved)), nothing
    if np.count_nonzero(seen) >= 3 and _is_wide(moved[0].state) and (anew := _begun(event, mission, moved[0].state)):
        return anew
    updates = [
        spot_update(h.state, spots, mission, event.dcm_chaser_from_lvlh, limit, event.covariance_px2) for h in moved
    ]
    scored = [Hypothesis(u.state, h.score + u.score) for h, u in zip(moved, updates, strict=True)]
    lead = updates[min(range(len(scored)), key=lambda k: scored[k].score)]
    return _after(bank, event, spots, mission, _joined(scored), lead)


def _moved(state: PoseState, dt: float, event: Event, body: RigidBody, mission: VisionMission) -> PoseState:
    return (
        time_update(state, dt, body, mission, event.acceleration_m_s2, event.delta_v_m_s)[0]
        if dt > 0.0 or np.count_nonzero(event.delta_v_m_s)
        else state
    )


def _after(
    bank: Bank, event: Event, spots: Matrix, mission: VisionMission, hypotheses: list[Hypothesis], lead: SpotUpdate
) -> tuple[Bank, Outcome]:
    """Count rejections, begin anew if locked out, look for new roots when it is time."""
    used, seen = np.count_nonzero(lead.accepted), np.count_nonzero(lead.seen)
    rejected = bank.rejected + 1 if 2 * used <= seen else 0
    if rejected >= mission.filter.restart_after_epochs and (anew := _begun(event, mission)):
        return anew
    renewed_s = bank.renewed_s
    if seen >= 3 and event.t_s - renewed_s >= RENEWED_S:
        hypotheses, renewed_s = _renewed(hypotheses, event, spots, mission), event.t_s
    used_s = tuple(event.t_s if now else last for now, last in zip(lead.accepted.tolist(), bank.used_s, strict=True))
    ordered = tuple(sorted(hypotheses, key=lambda h: h.score))
    outcome = Outcome(lead.seen, lead.accepted, lead.nis, lead.dof)
    return Bank(event.t_s, ordered, renewed_s, used_s, rejected), outcome
