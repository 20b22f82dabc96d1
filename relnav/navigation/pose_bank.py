"""One filter a hypothesis: starts on every pose that explains the first image, and drops what the spots refute.

A flat pattern has up to four poses that explain an image; a filter on the most credible one alone may follow the wrong
one for ever. Here each root starts a filter, with its covariance widened (seen head-on the misfit is no parabola, and
the truth lies up to 3 sigma off). A hypothesis falls when its latest spots are a million times less likely than
another's; every ten seconds roots that no hypothesis covers start new ones; two that have become one are joined.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Flags, Matrix, Stack, Vector
from relnav.dynamics.rigid_body import RigidBody
from relnav.mission import VisionMission
from relnav.navigation.pose_state import PoseState, SpotUpdate, spot_update, state_from_pose, time_update
from relnav.sensors.three_marker.measure import measure
from relnav.sensors.three_marker.pose import Pose

WIDENED = 4.0
DROP = 2.0 * math.log(1e6)
MEMORY_S = 50.0
"""Of the scores: what a filter was before it settled is forgotten."""
RENEWED_S = 10.0
_COVERED = 16.0  # chi-square: a root whose attitude is this near a hypothesis starts none
_JOINED = 1.0  # chi-square of twelve: two hypotheses this near are one
_MOST = 8


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
    full_s : float
        When three or more spots were last used.
    rejected : int
        Epochs in a row with at least half of what was seen rejected.
    """

    t_s: float = math.nan
    hypotheses: tuple[Hypothesis, ...] = ()
    renewed_s: float = -math.inf
    full_s: float = math.nan
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
    """What an event did to the leading hypothesis."""

    nis: float
    dof: int
    accepted: Flags
    started: bool


def _roots(event: Event, spots: Matrix, mission: VisionMission, believed: PoseState | None) -> list[PoseState]:
    """States on the poses that explain an image and are not a million times less credible than the best of them.

    Before a start the expected view decides and is part of the state: a root is then its own and the view's mean width.
    """
    result = measure(spots, mission, spot_covariance_px2=event.covariance_px2)
    out = []
    for root in result.roots:
        if root.score - result.roots[0].score > DROP:
            continue
        prior = np.zeros((6, 6))
        prior[3:, 3:] = np.eye(3) / mission.view.attitude_sigma_rad**2
        narrowed = np.asarray(np.linalg.inv(np.linalg.inv(root.pose.covariance) + prior), dtype=np.float64)
        pose = Pose(root.pose.position_m, root.pose.dcm_cam_from_target, narrowed)
        state = state_from_pose(pose, mission, event.dcm_chaser_from_lvlh, widened=WIDENED)
        if believed is not None:  # the velocity is common to all: unknown, its width alone would cost the odds
            motion, covariance = np.concatenate([state.motion[:3], believed.motion[3:]]), state.covariance.copy()
            covariance[3:6, 3:6] = WIDENED * believed.covariance[3:6, 3:6]
            state = replace(state, motion=motion, covariance=covariance)
        out.append(state)
    return out


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
        for state in _roots(event, spots, mission, best.state)
        if all(_apart(h.state, state, slice(6, 9), h.state.covariance + state.covariance) > _COVERED for h in bank)
    ]
    return bank + [Hypothesis(state, best.score) for state in fresh]


def advance(bank: Bank, event: Event, mission: VisionMission, body: RigidBody, limit: float) -> tuple[Bank, Outcome]:
    """The bank after an event, and what became of it; limit: gate of each spot's NIS."""
    nothing = np.zeros(len(mission.markers.positions_m), dtype=bool)
    spots = event.spots_px
    dt = event.t_s - bank.t_s if math.isfinite(bank.t_s) else 0.0
    if not bank.hypotheses:
        states = [] if spots is None else _roots(event, spots, mission, None)
        if spots is None or not states:
            return replace(bank, t_s=event.t_s), Outcome(math.nan, 0, nothing, started=False)
        begun = Bank(event.t_s, tuple(Hypothesis(state, 0.0) for state in states), event.t_s, event.t_s, 0)
        used = np.logical_and(np.isfinite(spots[:, 0]), np.isfinite(spots[:, 1]))
        return begun, Outcome(math.nan, 0, used, started=True)
    fade = math.exp(-dt / MEMORY_S)
    moved = [Hypothesis(_moved(h.state, dt, event, body, mission), fade * h.score) for h in bank.hypotheses]
    if spots is None or not np.isfinite(spots).all(axis=-1).any():
        return replace(bank, t_s=event.t_s, hypotheses=tuple(moved)), Outcome(math.nan, 0, nothing, started=False)
    updates = [
        spot_update(h.state, spots, mission, event.dcm_chaser_from_lvlh, limit, event.covariance_px2) for h in moved
    ]
    scored = [Hypothesis(u.state, h.score + u.score) for h, u in zip(moved, updates, strict=True)]
    lead = updates[min(range(len(scored)), key=lambda k: scored[k].score)]
    return _after(bank, event, spots, mission, _joined(scored), lead)


def _moved(state: PoseState, dt: float, event: Event, body: RigidBody, mission: VisionMission) -> PoseState:
    return (
        time_update(state, dt, body, mission, event.acceleration_m_s2, event.delta_v_m_s)
        if dt > 0.0 or event.delta_v_m_s.any()
        else state
    )


def _after(
    bank: Bank, event: Event, spots: Matrix, mission: VisionMission, hypotheses: list[Hypothesis], lead: SpotUpdate
) -> tuple[Bank, Outcome]:
    """Count rejections, look for new roots when it is time, give up what is locked out."""
    used, seen = int(lead.accepted.sum()), int(np.isfinite(spots).all(axis=-1).sum())
    rejected = bank.rejected + 1 if 2 * used <= seen else 0
    renewed_s, full_s = bank.renewed_s, event.t_s if used >= 3 else bank.full_s
    outcome = Outcome(lead.nis, lead.dof, lead.accepted, started=False)
    if seen >= 3 and event.t_s - renewed_s >= RENEWED_S:
        hypotheses, renewed_s = _renewed(hypotheses, event, spots, mission), event.t_s
    if rejected >= mission.filter.restart_after_epochs:
        return Bank(event.t_s), outcome
    ordered = tuple(sorted(hypotheses, key=lambda h: h.score))
    return Bank(event.t_s, ordered, renewed_s, full_s, rejected), outcome
