"""The per-epoch navigator of position and attitude: images in time order or late, a record of everything out.

A late image is taken in where it belongs: the bank of that time is looked up, the image used, and all that came after
replayed. The answer is, bit for bit, that of the same events in order.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Flags, Matrix, Vector
from relnav.dynamics.rigid_body import RigidBody, lvlh_rate
from relnav.estimation.gating import chi_square_limit
from relnav.geometry.rotation import is_rotation
from relnav.geometry.rotation_vector import turned
from relnav.mission import VisionMission
from relnav.navigation.docking_port import DockingState, docking_state
from relnav.navigation.pose_bank import Bank, Event, Hypothesis, Outcome, advance
from relnav.navigation.pose_state import PoseState
from relnav.navigation.status import EpochStatus
from relnav.sensors.three_marker.camera import usable_covariance
from relnav.sensors.three_marker.sensor import span_a_plane

_EMPTY = PoseState(np.full(6, np.nan), np.full((3, 3), np.nan), np.full(3, np.nan), np.full((12, 12), np.nan))


@dataclass(frozen=True)
class PoseRecord:
    """What is known after one epoch.

    Attributes
    ----------
    t_s : float
    state : (6,)
        Chaser's centre of mass from the target's, m and m/s, `lvlh_ccsds`; NaN with the rest while WAITING.
    dcm_lvlh_from_target : (3, 3)
    rate_rad_s : (3,)
        Inertial rate of the target, target axes.
    covariance : (12, 12)
        Of (position, velocity, theta, rate), the true attitude being dcm exp([theta x]), theta in target axes.
    docking : DockingState or None
        Port from port, with joint covariance.
    nis, dof : float, int
        Of everything seen, before the gate (spots off the image, or of a marker that should be behind the camera, are
        refused without); NaN where nothing was, and at a start.
    accepted : (n,)
        Which markers' spots were used.
    status : EpochStatus
    too_late : bool
        The image was older than the window and was not used.
    hypotheses : int
        How many poses are still possible: beyond one, the state is that of the most credible alone.
    ambiguity : float
        Twice the log of the odds of that one against the next; infinite if there is no other. Below 18.4 (odds of ten
        thousand, as in `PoseMeasurement`) do not rely on the attitude.
    observable : bool
        False while the markers used within the model's limit are fewer than three, or stand on one line: a turn about
        it is then hardly seen, and the covariance may be too small.
    """

    t_s: float
    state: Vector
    dcm_lvlh_from_target: Matrix
    rate_rad_s: Vector
    covariance: Matrix
    docking: DockingState | None
    nis: float
    dof: int
    accepted: Flags
    status: EpochStatus
    too_late: bool
    hypotheses: int
    ambiguity: float
    observable: bool


@dataclass(frozen=True)
class Passed:
    """An event that no late image can come before any more: what was known after it.

    row: an epoch of the log, not the exposure of a late image; started: the bank began anew with it.
    """

    event: Event
    bank: Bank
    started: bool
    row: bool


class PoseNavigator:
    """Position, velocity, attitude and rate of chaser and target from marker spots, an epoch at a time."""

    def __init__(self, mission: VisionMission, *, keep: bool = False) -> None:
        """Take a loaded model, `relnav.load_model("three_marker_vision")`; keep: remember all, for a smoother."""
        self.mission = mission
        self._body = RigidBody(np.array(mission.target.inertia_kg_m2), mission.orbit.mean_motion_rad_s)
        self._limit = chi_square_limit(mission.filter.gate_probability, 2)
        self._held, self._nothing = mission.dcm_chaser_from_lvlh, np.zeros(3)
        self._events: list[Event] = []
        self._banks: list[Bank] = []
        self._marks: list[tuple[bool, bool]] = []  # of each event: started, a row
        self._before = Bank()
        self._past: list[Passed] | None = [] if keep else None

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Every pose that is still possible, the most credible first."""
        return self._banks[-1].hypotheses if self._banks else ()

    def step(
        self,
        t_s: float,
        spots_px: ArrayLike | None = None,
        *,
        image_t_s: float | None = None,
        acceleration_m_s2: ArrayLike | None = None,
        delta_v_m_s: ArrayLike | None = None,
        dcm_chaser_from_lvlh: ArrayLike | None = None,
        chaser_rate_rad_s: ArrayLike | None = None,
        spot_covariance_px2: ArrayLike | None = None,
    ) -> PoseRecord:
        """Go on to t_s, and use the image that arrived there.

        Parameters
        ----------
        t_s : float
            Not before the last epoch.
        spots_px : (n, 2), optional
            One row a marker of the model, NaN = not seen; one is enough, three start the filter.
        image_t_s : float, optional
            Middle of the exposure, at most `longest_delay_s` before t_s; t_s if left out.
        acceleration_m_s2, delta_v_m_s : (3,), optional
            Commanded acceleration, held since the last epoch, and impulse at t_s, `lvlh_ccsds`.
        dcm_chaser_from_lvlh : (3, 3), optional
            The chaser's attitude at the exposure (at t_s without an image); the model's held one if left out.
        chaser_rate_rad_s : (3,), optional
            Its inertial rate, chaser axes, for the docking state, and to carry its attitude on from a late exposure to
            t_s there; that of a chaser held in `lvlh_ccsds` if left out.
        spot_covariance_px2 : (n, 2, 2), optional
            Of each spot; the camera's spot noise if left out. A spot whose covariance is not finite, symmetric and
            positive definite counts as not seen.

        Raises
        ------
        ValueError
            For a time that goes back, an exposure in the future, arrays of another shape, or a control or an attitude
            that is not finite.
        """
        last = self._events[-1].t_s if self._events else -math.inf
        if not math.isfinite(t_s) or t_s < last:
            raise ValueError(f"t_s must be finite and not before the last epoch, {last!r}; got {t_s!r}")
        exposed = t_s if image_t_s is None else image_t_s
        if not math.isfinite(exposed) or exposed > t_s:
            raise ValueError(f"image_t_s must be finite and not after t_s = {t_s!r}; got {image_t_s!r}")
        event = self._event(t_s, acceleration_m_s2, delta_v_m_s, dcm_chaser_from_lvlh)
        image = self._with_image(event, spots_px, spot_covariance_px2)
        rate = None if chaser_rate_rad_s is None else _vector("chaser_rate_rad_s", chaser_rate_rad_s)
        outcome: Outcome | None
        if image.spots_px is None or exposed == t_s:
            outcome = self._append(image)
        else:
            self._append(event)
            outcome = self._insert(replace(image, t_s=exposed), t_s - self.mission.filter.longest_delay_s)
        self._forget(t_s)
        return self._record(event, outcome, rate, t_s - exposed)

    def _event(
        self, t_s: float, acceleration: ArrayLike | None, delta_v: ArrayLike | None, dcm: ArrayLike | None
    ) -> Event:
        attitude = self._held if dcm is None else np.array(dcm, dtype=np.float64)
        if dcm is not None and not is_rotation(attitude):
            raise ValueError("dcm_chaser_from_lvlh is a rotation matrix (3, 3)")
        push = self._nothing if acceleration is None else _vector("acceleration_m_s2", acceleration)
        impulse = self._nothing if delta_v is None else _vector("delta_v_m_s", delta_v)
        return Event(t_s, push, impulse, None, None, attitude)

    def _with_image(self, event: Event, spots_px: ArrayLike | None, covariance: ArrayLike | None) -> Event:
        if spots_px is None:
            return event
        count, spots = len(self.mission.markers.positions_m), np.array(spots_px, dtype=np.float64)
        if spots.shape != (count, 2):
            raise ValueError(f"spots_px has shape ({count}, 2), one row a marker; got {spots.shape}")
        spots[~np.isfinite(spots).all(axis=-1)] = np.nan
        own = None if covariance is None else np.array(covariance, dtype=np.float64)
        if own is not None and own.shape != (count, 2, 2):
            raise ValueError(f"spot_covariance_px2 has shape ({count}, 2, 2), one a marker; got {own.shape}")
        if own is not None:
            spots[~usable_covariance(own)] = np.nan
        return replace(event, spots_px=spots, covariance_px2=own)

    @property
    def passed(self) -> list[Passed]:
        """All events so far, in the order of their times; of a navigator that keeps them."""
        assert self._past is not None
        return [*self._past, *self._kept(len(self._events))]

    def _kept(self, count: int) -> list[Passed]:
        rows = zip(self._events[:count], self._banks, self._marks, strict=False)
        return [Passed(event, bank, *marks) for event, bank, marks in rows]

    def _append(self, event: Event, *, row: bool = True) -> Outcome:
        before = self._banks[-1] if self._banks else self._before
        bank, outcome = advance(before, event, self.mission, self._body, self._limit)
        self._events.append(event)
        self._banks.append(bank)
        self._marks.append((outcome.started, row))
        return outcome

    def _insert(self, image: Event, oldest: float) -> Outcome | None:
        """Take a late image in and replay what came after; None if it is older than the window or all that is kept."""
        times = [event.t_s for event in self._events]
        place = bisect_right(times, image.t_s)
        if image.t_s < oldest or (place == 0 and image.t_s < self._before.t_s):  # False for NaN: nothing was forgotten
            return None
        later, rows = self._events[place:], [row for _, row in self._marks[place:]]
        push = later[0].acceleration_m_s2 if later else np.zeros(3)  # held over the interval that the image divides
        del self._events[place:], self._banks[place:], self._marks[place:]
        outcome = self._append(replace(image, acceleration_m_s2=push, delta_v_m_s=np.zeros(3)), row=False)
        for event, row in zip(later, rows, strict=True):
            self._append(event, row=row)
        return outcome

    def _forget(self, t_s: float) -> None:
        """Keep what a late image may still need."""
        oldest = t_s - self.mission.filter.longest_delay_s
        keep = 0
        while keep < len(self._events) - 1 and self._events[keep].t_s < oldest:
            keep += 1
        if keep:
            if self._past is not None:
                self._past.extend(self._kept(keep))
            self._before = self._banks[keep - 1]
            del self._events[:keep], self._banks[:keep], self._marks[:keep]

    def _record(self, event: Event, outcome: Outcome | None, rate: Vector | None, delay_s: float) -> PoseRecord:
        bank, docking = self._banks[-1], None
        state = bank.hypotheses[0].state if bank.hypotheses else _EMPTY
        if bank.hypotheses:
            dcm = event.dcm_chaser_from_lvlh
            if delay_s > 0.0 and rate is not None:
                relative = rate - lvlh_rate(dcm.T, self.mission.orbit.mean_motion_rad_s)
                dcm = turned(dcm.T, delay_s * relative).T
            docking = docking_state(state, self.mission, dcm, rate)
        nothing = np.zeros(len(self.mission.markers.positions_m), dtype=bool)
        accepted = nothing if outcome is None else outcome.accepted.copy()
        for array in (*vars(state).values(), accepted, *(() if docking is None else vars(docking).values())):
            array.setflags(write=False)
        return PoseRecord(
            event.t_s,
            state.motion,
            state.dcm_lvlh_from_target,
            state.rate_rad_s,
            state.covariance,
            docking,
            math.nan if outcome is None else outcome.nis,
            0 if outcome is None else outcome.dof,
            accepted,
            _status(bank, outcome),
            outcome is None,
            len(bank.hypotheses),
            bank.hypotheses[1].score - bank.hypotheses[0].score if len(bank.hypotheses) > 1 else math.inf,
            self._is_observable(bank, event.t_s),
        )

    def _is_observable(self, bank: Bank, t_s: float) -> bool:
        """Whether the markers used of late span a plane; all of a model's do."""
        recent = [t_s - used_s <= self.mission.filter.few_markers_limit_s for used_s in bank.used_s]
        if all(recent) or sum(recent) < 3:
            return all(recent) and bool(bank.hypotheses)
        return span_a_plane(self.mission.markers.points_m[recent])


def _status(bank: Bank, outcome: Outcome | None) -> EpochStatus:
    if not bank.hypotheses:
        return EpochStatus.WAITING
    if outcome is None or not np.count_nonzero(outcome.seen):
        return EpochStatus.PREDICTED
    if outcome.started:
        return EpochStatus.STARTED
    used = np.count_nonzero(outcome.accepted)
    if used == 0:
        return EpochStatus.REJECTED
    return EpochStatus.UPDATED if used == np.count_nonzero(outcome.seen) else EpochStatus.PARTIAL


def _vector(name: str, value: ArrayLike) -> Vector:
    out = np.array(value, dtype=np.float64)
    if out.shape != (3,) or not all(map(math.isfinite, out.tolist())):
        raise ValueError(f"{name} has three finite components; got {np.asarray(value).tolist()}")
    return out
