"""`engine="filterpy"` for markers: the filter of position and attitude a second time, in numpy over filterpy's algebra.

It is written from the mission and the documented model (ARCHITECTURE.md, "Six degrees of freedom"), reads nothing of
the compiled filter's memory and uses none of its derivatives: the equations of motion are integrated
(`reference.motion`), rows come from one formula of the spots by complex steps (`reference.marker_rows`), the update is
filterpy's ExtendedKalmanFilter in covariance form (`reference.bank`). Shared are the sensor's closed form, from which
poses are taken up (`reference.poses`), what it says of poses that look alike (`observation.marker_twins`), the limits
by which the filter's decisions are defined, and the layout of a record.

It follows the bank of hypotheses of a flat pattern too. It does not take late images, smooth, or watch: its alarm says
UNWATCHED beside what a compiled filter without monitors would say.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from relnav.arrays import Flags, Matrix, Record, Vector
from relnav.estimation.factored import factorize
from relnav.estimation.gating import gate_limits
from relnav.estimation.monitors import CONTRADICTED, UNWATCHED
from relnav.mission import VisionMission
from relnav.navigation.observation.marker_poses import BEATEN, COVERED, FOLLOWED, SAME_RAD, WIDENED, view_at
from relnav.navigation.observation.marker_twins import twins_of
from relnav.navigation.pose_call import Event
from relnav.navigation.pose_epoch import LOWER, SETTLED_S, covariances_of
from relnav.navigation.pose_filter import AGREED, BLURRED, CHANCE, DROP, RENEWED_BLURRED_S, RENEWED_S, TELLING_SHARE
from relnav.navigation.pose_memory import MOST_POSES
from relnav.navigation.pose_propagation import LARGEST_SHARE_OF_RANGE, LARGEST_TURN_RAD, MEMORY_S
from relnav.navigation.pose_update import SETTLING_S
from relnav.navigation.reference.bank import (
    Corrected,
    Exposure,
    carried,
    corrected,
    is_exchanged,
    ordered,
    turn_between,
    with_inertia,
)
from relnav.navigation.reference.bending import taken_into
from relnav.navigation.reference.marker_rows import MarkerOptics, PoseTrack
from relnav.navigation.reference.motion import step_between
from relnav.navigation.reference.poses import Found, find_poses
from relnav.navigation.status import EXCHANGED, OUT_OF_VIEW, PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT
from relnav.sensors.three_marker.sensor import View, span_a_plane


@dataclass
class Result:
    """What an event did to the leading hypothesis."""

    accepted: Flags
    nis: float = math.nan
    dof: int = 0
    used: int = 0
    status: int = WAITING
    alarm: int = 0


@dataclass
class ReferencePose:
    """A marker filter; `take` an event at a time."""

    mission: VisionMission
    t_s: float = math.nan
    begun_s: float = math.nan
    renewed_s: float = -math.inf
    blurred_s: float = -math.inf
    confirmed_s: float = math.nan
    doubted_s: float = -math.inf
    bank: list[PoseTrack] = field(default_factory=list)
    trial: list[PoseTrack] = field(default_factory=list)
    beaten: list[tuple[float, Matrix]] = field(default_factory=list)
    rejected: int = 0
    agreed: int = 0

    def __post_init__(self) -> None:
        """A filter that has seen nothing yet."""
        count = len(self.mission.markers.positions_m)
        self.optics = MarkerOptics(self.mission)
        self._limits = gate_limits(self.mission.filter.gate_probability, 2 * count)
        self._used_s, self._trial_used_s = np.full(count, np.nan), np.full(count, np.nan)
        self._denied, self._is_denied = np.zeros(count, dtype=np.int64), False
        self.result = Result(np.zeros(count, dtype=bool))
        self._control = np.zeros(6)

    def start(self, t_s: float, motion: Vector, dcm: Matrix, rate: Vector, covariance: Matrix) -> None:
        """Begin from a state that is known otherwise."""
        nothing = np.zeros((self.optics.considered, 12))
        self.bank, self.trial = [PoseTrack(motion, dcm, rate, covariance, nothing)], []
        self.t_s, self.begun_s, self.renewed_s, self.confirmed_s, self.rejected = t_s, t_s, t_s, t_s, 0
        self.blurred_s, self.doubted_s, self.beaten = -math.inf, -math.inf, []
        self._used_s[:] = t_s
        self._denied[:], self._is_denied = 0, False

    @property
    def believed(self) -> list[PoseTrack]:
        """The bank, with what has bent since the latest image."""
        return [taken_into(track) for track in self.bank]

    def take(self, event: Event, out: Record, covariance: Matrix, accepted: Vector) -> None:
        """Go on to an event, the control acting until then; write what is then known (`pose_call.views_of_report`)."""
        image = Exposure(
            event.t_s, event.dcm_chaser_from_lvlh, event.attitude_noise_rad, event.spots_px, event.covariance_px2
        )
        self.optics.attitude_sigma = event.attitude_sigma_rad
        self.result = Result(np.zeros(len(self._used_s), dtype=bool))
        self._control = np.concatenate([event.acceleration_m_s2, event.delta_v_m_s])
        self._advance(image.t_s)
        seen, running = image.seen, bool(self.bank)
        if not running:
            self.rejected = 0
        if seen > 0:
            self.bank = self.believed
        if seen == 0:
            self.result.status = PREDICTED if running else WAITING
        elif running and seen >= 3 and _is_wide(self.bank[0], self.optics.shown):
            self.result.status = PREDICTED
            self._look_for_start(image)
        elif not running or self._use(image):
            self._look_for_start(image)
        if self.bank and self._is_contested():
            self.doubted_s = image.t_s
        self.result.alarm |= UNWATCHED | (CONTRADICTED if self.bank and self._is_denied else 0)
        out["chaser"], accepted[:] = image.chaser, self.result.accepted
        self._write_epoch(out)
        covariance[:] = covariances_of(out["factor"][None])[0]

    def _advance(self, t_s: float) -> None:
        """Carry bank and trial to t, the control acting."""
        dt = 0.0 if math.isnan(self.t_s) else step_between(self.t_s, t_s)
        push, impulse = self._control[:3], self._control[3:]
        if t_s > self.t_s or np.any(impulse):
            for tracks in (self.bank, self.trial):
                bends = tracks is self.bank
                moved = [carried(self.mission, one, self.t_s, dt, push, impulse, bends=bends) for one in tracks]
                tracks[:] = [track for track in moved if track is not None]
        self.begun_s = t_s if math.isnan(self.begun_s) else self.begun_s
        self.t_s = t_s

    def _correct(
        self, tracks: list[PoseTrack], far_behind: float, image: Exposure
    ) -> tuple[list[PoseTrack], list[PoseTrack], Corrected, bool]:
        """Correct hypotheses: how they stand, which fell, what the image did to the leading one, whether that is wide.

        The result is of the leading one. Wide: it may cover poses that it cannot tell apart, or has not led before.
        """
        several = len(tracks) > 1
        every = [corrected(self.optics, self._limits, tracks[0], image, compared=several)]
        every += [corrected(self.optics, self._limits, track, image, every[0], compared=True) for track in tracks[1:]]
        k = min(range(len(every)), key=lambda i: every[i].track.rank)
        lead = every[k]
        self.result.accepted = np.isin(np.arange(len(self._used_s)), lead.used)
        self.result.nis, self.result.dof, self.result.used = lead.nis, 2 * len(lead.which), len(lead.used)
        kept, fell = ordered([one.track for one in every], far_behind, image.t_s)
        if k > 0 and tracks is self.bank:
            self.beaten = []
        return kept, fell, lead, k > 0 or lead.bending >= BLURRED

    def _use(self, image: Exposure) -> bool:
        """Correct the bank with an image; whether a start is to be looked for."""
        result, t = self.result, image.t_s
        before = self.bank
        self.bank, fell, lead, wide = self._correct(before, AMBIGUITY_LIMIT, image)
        beaten = [one for one in fell if one.added > -math.inf or self._was_tracked(one)]
        self.beaten = [*self.beaten, *((t, self.bank[0].dcm.T @ one.dcm) for one in beaten)][-MOST_POSES:]
        if _count_first(self.bank) + _count_first(beaten) < _count_first(before):  # its pose gets a second hypothesis
            self.renewed_s = -math.inf
        seen, used = lead.seen, len(lead.used)
        result.status = REJECTED if used == 0 else (UPDATED if used == seen else PARTIAL)
        if used > 0:
            self._used_s[lead.used] = t
            self.blurred_s = t if wide else self.blurred_s
        tells = self._count_denied(image, lead)
        if 2 * used <= seen:
            self.rejected += 1
        else:
            self.rejected, self.trial = 0, []
        if seen - used >= 2 and is_exchanged(self.optics, self._limits, self.bank[0], image):
            result.alarm, self.trial = EXCHANGED, []
            return False
        if self.rejected >= self.mission.filter.restart_after_epochs:
            return True
        often = RENEWED_BLURRED_S if t - self.blurred_s <= SETTLED_S else RENEWED_S
        if seen >= 3 and (used == seen or (used > 0 and tells)) and t - self.renewed_s >= often:
            self.renewed_s = t
            self._add_uncovered(image)
        return False

    def _count_denied(self, image: Exposure, lead: Corrected) -> bool:
        """Count how often in a row spots were refused, others not; whether one was too often and may tell of the pose.

        Of three spots: only one that was not used since the leading hypothesis was too wide.
        """
        used = len(lead.used)
        if used > 0:
            self._denied[np.isfinite(image.spots).all(axis=1)] += 1
            self._denied[lead.used] = 0
        lasting = self._denied >= self.mission.filter.restart_after_epochs
        if used > 0:
            self._is_denied = bool(lasting.any()) and used < 3
        unsettled = ~(self._used_s > self.blurred_s)
        return bool((lasting & (unsettled | (lead.seen > 3))).any())

    def _look_for_start(self, image: Exposure) -> None:
        """Test the trial with an image of three markers or more; open one on its poses if it contradicts it."""
        if image.seen < 3:
            return
        before = self.result
        self.result = replace(before)
        confirmed = self._confirm(image) if self.trial else False
        if confirmed:
            self.result.status = STARTED
            return
        self.result = before
        if self.trial:
            return
        wide = bool(self.bank) and _is_wide(self.bank[0], self.optics.shown)
        found = self._poses(image, self.bank[0] if wide else None, self.mission)
        if found.tracks:
            self.trial, self.agreed = found.tracks[:MOST_POSES], 0
            self._trial_used_s = np.where(found.used, image.t_s, np.nan)
        elif found.contradicted:
            self.result.alarm = OUT_OF_VIEW

    def _confirm(self, image: Exposure) -> bool:
        """Whether the trial now is the bank. It is dropped by an image that contradicts it."""
        self.trial, _, lead, wide = self._correct(self.trial, DROP, image)
        if len(lead.used) < 3 or len(lead.used) < lead.seen:
            self.trial = []
            return False
        self._trial_used_s[lead.used] = image.t_s
        self.agreed += 1
        if not lead.share < TELLING_SHARE or (self.rejected > 0 and self.agreed < AGREED):
            return False
        self.bank, self.trial, self.rejected, self.beaten = self.trial, [], 0, []
        self.confirmed_s, self._is_denied, self._denied[:] = image.t_s, False, 0
        self._used_s, self.renewed_s = self._trial_used_s.copy(), image.t_s
        self.blurred_s, self.doubted_s = image.t_s if wide else -math.inf, -math.inf
        return True

    def _poses(self, image: Exposure, believed: PoseTrack | None, mission: VisionMission) -> Found:
        """Poses of an image that do not contradict what is expected, or the leading hypothesis."""
        at = mission.camera.dcm_cam_from_chaser @ image.chaser
        near = [at @ mission.target.dcm_target_from_lvlh.T, *(at @ track.dcm for track in self.bank[:1])]
        return find_poses(self.optics, mission, image, believed, near, self._view(image.t_s).attitude_sigma_rad)

    def _view(self, t_s: float) -> View:
        """The expected view by now."""
        return view_at(self.mission.view, t_s - self.begun_s, self.mission.filter.initial_rate_sigma_rad_s)

    def _add_uncovered(self, image: Exposure) -> None:
        """A hypothesis for each pose that none covers, as credible as the best.

        If that has been relied on since poses were last looked for, and has beaten another or is more expected, they
        begin a million times less so.
        """
        held, view, at = list(self.bank), self._view(image.t_s), self.mission.camera.dcm_cam_from_chaser @ image.chaser
        mission, lead = replace(self.mission, view=view), held[0]
        twins = [
            PoseTrack(
                one.motion,
                one.dcm_lvlh_from_target,
                one.rate_rad_s,
                WIDENED * one.covariance,
                np.zeros_like(lead.considered),
            )
            for one in twins_of(lead.state, image.t_s, mission, image.chaser, DROP)
        ]

        def unexpected(track: PoseTrack) -> float:
            return float(np.linalg.norm(turn_between(at @ track.dcm, view.dcm_cam_from_target)))

        uncontested = image.t_s - self.doubted_s > RENEWED_S and not self._is_contested()
        seen = self._poses(image, lead, mission).tracks
        for k, one in enumerate(seen + twins):
            others = [_angle(one.dcm, other.dcm) for other in seen + twins]
            covered = any(_attitudes_apart(other, one, k >= len(seen)) <= COVERED for other in held)
            if len(held) < MOST_POSES and not (covered or self._is_followed(one, held, others)):
                held.append(one)
                less = uncontested and (bool(self.beaten) or unexpected(one) > unexpected(lead))
                prior = lead.prior + (DROP if less else 0.0)
                self.bank.append(replace(one, score=lead.score, prior=prior, added=image.t_s))
                self.bank[:] = [replace(track, evidence=None) for track in self.bank]

    def _was_tracked(self, one: PoseTrack) -> bool:
        """Whether one of the start that fell was followed for long enough, and well enough, to be beaten."""
        return one.doubt <= CHANCE and self.t_s - self.confirmed_s > SETTLING_S

    def _is_followed(self, found: PoseTrack, held: list[PoseTrack], others: list[float]) -> bool:
        """Whether a hypothesis follows a pose that was found, or it was beaten lately; others: its angles from all."""
        angles = [_angle(found.dcm, one.dcm) for one in held]
        beaten = [_angle(found.dcm, held[0].dcm @ dcm) for t, dcm in self.beaten if self.t_s - t <= MEMORY_S]
        apart = min((angle for angle in others if angle > SAME_RAD), default=math.pi)
        return min(angles[1:], default=math.pi) < FOLLOWED * apart or min(beaten, default=math.inf) < BEATEN * angles[0]

    def _write_epoch(self, out: Record) -> None:
        """Write what is known after the last event (`pose_epoch.EPOCH`), but for the chaser."""
        result, t = self.result, self.t_s
        out["t"], out["nis"], out["dof"], out["used"] = t, result.nis, result.dof, result.used
        out["status"], out["alarm"], out["row"] = result.status, result.alarm, 1
        out["acceleration"], out["delta_v"] = self._control[:3], self._control[3:]
        out["hypotheses"], out["observable"] = len(self.bank), bool(self.bank) and self._is_observable()
        out["ambiguity"] = self._ambiguity()
        if not self.bank:
            for name in ("motion", "dcm", "rate", "factor"):
                out[name] = math.nan
            return
        lead = self.bank[0]
        out["motion"], out["dcm"], out["rate"], out["by_chaser"] = lead.motion, lead.dcm, lead.rate, lead.considered[:3]
        out["factor"] = factorize(taken_into(lead).covariance + lead.considered.T @ lead.considered)[LOWER]

    def _ambiguity(self) -> float:
        """Odds of the leading hypothesis against the next, zero at most where they do not count yet."""
        odds = min((one.odds_against(self.bank[0]) for one in self.bank[1:]), default=math.inf)
        return min(odds, 0.0) if self._is_undecided() else odds

    def _is_undecided(self) -> bool:
        return self.t_s - self.blurred_s <= SETTLED_S or (bool(self.bank) and self.renewed_s == -math.inf)

    def _is_contested(self) -> bool:
        """Whether the leading one is not relied on, but for hypotheses that began less likely beside it."""
        lead, equals = self.bank[0], [one for one in self.bank[1:] if one.prior <= self.bank[0].prior]
        return self._is_undecided() or any(one.odds_against(lead) < AMBIGUITY_LIMIT for one in equals)

    def _is_observable(self) -> bool:
        """Whether the markers used lately are all of them, or three or more that do not stand on one line."""
        recent = self.t_s - self._used_s <= self.mission.filter.few_markers_limit_s
        return bool(recent.all()) or (recent.sum() >= 3 and span_a_plane(self.optics.points[recent]))


def _count_first(tracks: list[PoseTrack]) -> int:
    """How many hypotheses are of the start."""
    return sum(track.added == -math.inf for track in tracks)


def _is_wide(track: PoseTrack, shown: int) -> bool:
    """Whether errors are no longer small: a full image then tells more than the state that it would correct."""
    variance, range2 = with_inertia(track, shown), track.motion[:3] @ track.motion[:3]
    near = variance[:3].max() <= LARGEST_SHARE_OF_RANGE**2 * range2
    return not near or bool(variance[6:9].max() > LARGEST_TURN_RAD**2)


def _angle(one: Matrix, other: Matrix) -> float:
    return float(np.linalg.norm(turn_between(one, other)))


def _attitudes_apart(held: PoseTrack, found: PoseTrack, predicted: bool) -> float:
    """Chi-square between the attitudes of a hypothesis, with what is considered in it, and of a pose.

    predicted: the pose is of spots that have no noise.
    """
    off = turn_between(found.dcm, held.dcm)
    spread = held.covariance + held.considered.T @ held.considered + (0.0 if predicted else found.covariance)
    return float(off @ np.linalg.solve(spread[6:9, 6:9], off))
