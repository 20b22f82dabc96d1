"""The per-epoch navigator of position and attitude: images in time order or late, a record of everything out.

A late image is taken in where it belongs: the filter as it stood before it is looked up, the image used, and all that
came after replayed. The answer is, bit for bit, that of the same events in order.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import LARGEST, Matrix, Stack, Vector, number, numbers
from relnav.dynamics.error_state import POSE
from relnav.dynamics.relative_motion import frame_rate
from relnav.dynamics.rigid_body import lvlh_rate
from relnav.errors import UsageError
from relnav.estimation.factored import compose
from relnav.estimation.timeline import Passed, Timeline
from relnav.geometry.rotation import rotation
from relnav.geometry.rotation_vector import turned
from relnav.mission import VisionMission
from relnav.navigation.arguments import (
    not_negative,
    refuse_another_version,
    refuse_unknown_engine,
    start_values,
    told_time,
)
from relnav.navigation.blocks import marker_layout
from relnav.navigation.memory import fill, orbit_values
from relnav.navigation.observation.marker_poses import state_of
from relnav.navigation.pose_bending import take_bends
from relnav.navigation.pose_call import (
    NO_COVARIANCES,
    NO_SPOTS,
    NOTHING_APART,
    REFUSED,
    Event,
    describe_pose,
    navigate_pose,
    new_report,
    views_of_report,
)
from relnav.navigation.pose_filter import NOTHING
from relnav.navigation.pose_memory import new_pose_memory, pose_views, watch_markers_anew
from relnav.navigation.pose_record import PoseRecord
from relnav.navigation.pose_roots import look_for_roots, mission_as_told
from relnav.navigation.pose_state import PoseState
from relnav.navigation.reference import for_markers
from relnav.navigation.status import EpochStatus
from relnav.sensors.three_marker.camera import usable_covariance


@dataclass(frozen=True)
class Hypothesis:
    """A pose that is still possible.

    Attributes
    ----------
    state : PoseState
        Its state and covariance.
    score : float
        Minus twice the logarithm of how likely it is, up to a constant common to all, the past fading.
    """

    state: PoseState
    score: float


class PoseNavigator:
    """Position, velocity, attitude and rate of chaser and target from marker spots, an epoch at a time.

    `copy.deepcopy` and `pickle` give a navigator that continues from the same state, bit for bit.

    Parameters
    ----------
    mission : VisionMission
        From `relnav.load_model("three_marker_vision")`.
    engine : {"compiled", "filterpy"}
        relnav's own filter, or the same one written a second time in numpy on filterpy's ExtendedKalmanFilter: a
        hundred times slower, for comparison. It takes no late images, and its alarm says UNWATCHED.

    Attributes
    ----------
    layout : StateLayout
        The errors that it estimates and considers, by name; `print` shows them.

    Raises
    ------
    ValueError
        For another kind of model, or an unknown engine.
    """

    def __init__(self, mission: VisionMission, *, engine: str = "compiled") -> None:
        if not isinstance(mission, VisionMission):
            raise ValueError(
                f"PoseNavigator flies a marker mission, such as relnav.load_model('three_marker_vision'); a "
                f"{type(mission).__name__} was given: a beacon mission is flown by relnav.Navigator"
            )
        refuse_unknown_engine(engine)
        self.mission, self.layout = mission, marker_layout(mission)
        self._reference = for_markers(engine, mission)
        self.memory = new_pose_memory(mission)
        self._named = pose_views(self.memory)
        self._held, self._nothing = mission.dcm_chaser_from_lvlh, np.zeros(3)
        self._report = new_report(len(mission.markers.positions_m))
        self._timeline: Timeline[Vector, Event, Vector | None] = Timeline(self.memory.copy(), math.nan)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the views, which are of this memory, and by which version it is laid out."""
        return {**self.__dict__, "_named": None, "version": version("relnav")}

    def __copy__(self) -> PoseNavigator:
        """One that goes on by itself, as `copy.deepcopy` gives: what two share each of them would change."""
        return copy.deepcopy(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """As it was saved; ValueError if another version of relnav saved it."""
        refuse_another_version(state.pop("version"))
        self.__dict__.update(state)
        self._named = pose_views(self.memory)

    def __repr__(self) -> str:
        """One line for the console."""
        count = len(self.hypotheses)
        poses = "pose" if count == 1 else "poses"
        known = f"{count} {poses} possible" if count else "WAITING for two images that agree"
        return f"{type(self).__name__}({self.mission.name}, {told_time(self.last_t_s)}, {known})"

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Every pose that is still possible, the most likely first."""
        if self._reference is not None:
            found = [Hypothesis(one.state, one.rank) for one in self._reference.believed]
        else:
            m = pose_views(self.memory.copy())
            take_bends(m.body, m.bank, m.bents, int(m.clock["running"]))
            tracks = zip(m.bank[: int(m.clock["running"])], m.bank_sensitivities, strict=False)
            found = [Hypothesis(state_of(one, by), float(one["score"] + one["prior"])) for one, by in tracks]
        return tuple(sorted(found, key=lambda one: one.score))

    def start(
        self,
        t_s: float,
        state: ArrayLike,
        dcm_lvlh_from_target: ArrayLike,
        rate_rad_s: ArrayLike,
        covariance: ArrayLike,
    ) -> None:
        """Start from a known state; without it the filter starts itself, on two images that agree.

        Parameters
        ----------
        t_s : float
            Time of the state, not before the last epoch.
        state, dcm_lvlh_from_target, rate_rad_s, covariance : (6,), (3, 3), (3,), (12, 12)
            As in `PoseRecord`.

        Raises
        ------
        ValueError
            For another shape, what is not finite, an invalid attitude or covariance. The filter is then unchanged.
        """
        t, motion, ld = start_values(t_s, state, covariance, POSE)
        attitude = np.array(rotation("dcm_lvlh_from_target", dcm_lvlh_from_target))
        rate = _vector("rate_rad_s", rate_rad_s)
        if t < self.last_t_s:
            raise ValueError(f"t_s must not be before the last epoch, {self.last_t_s!r}; got {t_s!r}")
        m = self._named
        fill(m.bank[0], motion=motion, dcm=attitude, rate=rate, state=0.0, ld=ld)
        fill(m.bank[0], score=0.0, doubt=0.0, prior=0.0, added=-math.inf)
        m.bank_sensitivities[0] = 0.0
        fill(m.clock, t=t, begun=t, confirmed=t, renewed=t, blurred=-math.inf, doubted=-math.inf)
        fill(m.clock, running=1, trial=0, rejected=0)
        m.beaten["t"], m.bents["on"], m.bents["age"] = -math.inf, 0, 0.0
        m.used_s[:] = t
        watch_markers_anew(m)
        if self._reference is not None:
            self._reference.start(t, motion, attitude, rate, compose(ld))
        self._timeline = Timeline(self.memory.copy(), t)

    @property
    def last_t_s(self) -> float:
        """Time of the last epoch; NaN before the first."""
        return self._timeline.last_s

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
        attitude_noise_rad: float | None = None,
        attitude_sigma_rad: float | None = None,
    ) -> PoseRecord:
        """Propagate to t_s, and process the image that arrived then.

        Parameters
        ----------
        t_s : float
            Not before the last epoch.
        spots_px : (n, 2), optional
            One row a marker of the model, NaN = not seen; one is enough, two images of three that agree start.
        image_t_s : float, optional
            Middle of the exposure, at most `longest_delay_s` before t_s; t_s if left out.
        acceleration_m_s2, delta_v_m_s : (3,), optional
            Commanded acceleration, held since the last epoch, and impulse at t_s, `lvlh_ccsds`.
        dcm_chaser_from_lvlh : (3, 3), optional
            The chaser's attitude at the exposure (at t_s without an image); the model's held one if left out.
        chaser_rate_rad_s : (3,), optional
            Its inertial rate, chaser axes, for the docking state, and to propagate its attitude from a late exposure to
            t_s; that of a chaser held in `lvlh_ccsds` if left out.
        spot_covariance_px2 : (n, 2, 2), optional
            Of each spot; the camera's spot noise if left out. A spot whose covariance is not finite, symmetric and
            positive definite counts as not seen.
        attitude_noise_rad : float, optional
            1-sigma about each axis of the part of the chaser's attitude error that is new at the exposure; the model's
            if left out.
        attitude_sigma_rad : float, optional
            And of its constant part; the model's if left out. It remains one error with another sigma: stated at every
            image it is still not noise.

        Raises
        ------
        ValueError
            For a time that goes back, an exposure in the future, arrays of another shape, or a control or an attitude
            that is not finite. The filter is then unchanged.
        """
        last, t_s = self.last_t_s, number("t_s", t_s)
        if not math.isfinite(t_s) or t_s < last:
            raise ValueError(f"t_s must be finite and not before the last epoch, {last!r}; got {t_s!r}")
        exposed = t_s if image_t_s is None else number("image_t_s", image_t_s)
        if not math.isfinite(exposed) or exposed > t_s:
            raise ValueError(f"image_t_s must be finite and not after t_s = {t_s!r}; got {image_t_s!r}")
        if self._reference is not None and spots_px is not None and exposed < t_s:
            raise UsageError('engine="filterpy" takes no late images: leave image_t_s out, or use engine="compiled"')
        chaser = self.mission.chaser
        event = Event(
            t_s,
            self._nothing if acceleration_m_s2 is None else _own("acceleration_m_s2", acceleration_m_s2, (3,)),
            self._nothing if delta_v_m_s is None else _own("delta_v_m_s", delta_v_m_s, (3,)),
            self._held if dcm_chaser_from_lvlh is None else _own("dcm_chaser_from_lvlh", dcm_chaser_from_lvlh, (3, 3)),
            _or_stated("attitude_noise_rad", attitude_noise_rad, chaser.attitude_noise_rad),
            _or_stated("attitude_sigma_rad", attitude_sigma_rad, chaser.attitude_sigma_rad),
        )
        spots, covariance = self._image(spots_px, spot_covariance_px2)
        rate = None if chaser_rate_rad_s is None else _vector("chaser_rate_rad_s", chaser_rate_rad_s)
        if len(spots) == 0 or exposed == t_s:
            return self._in_order(event._replace(spots_px=spots, covariance_px2=covariance), rate, t_s - exposed)
        oldest = t_s - self.mission.filter.longest_delay_s
        self._timeline.insert(t_s, event, self._take)
        too_late = exposed < oldest or exposed < self._timeline.start_s  # False for NaN: nothing was forgotten
        image = event._replace(t_s=exposed, spots_px=spots, covariance_px2=covariance)
        said = None if too_late else self._insert(image)
        self._passed(self._timeline.forget(oldest))
        self._add_late(said)
        return self._record(event, rate, t_s - exposed)

    def _image(self, spots_px: ArrayLike | None, covariance: ArrayLike | None) -> tuple[Matrix, Stack]:
        """Spots and covariances of an `Event`."""
        if spots_px is None:
            return NO_SPOTS, NO_COVARIANCES
        count = len(self.mission.markers.positions_m)
        spots = np.array(numbers("spots_px", spots_px), order="C")
        if spots.shape != (count, 2):
            raise ValueError(f"spots_px has shape ({count}, 2), one row a marker; got {spots.shape}")
        if covariance is None:
            return spots, NO_COVARIANCES
        own = np.array(numbers("spot_covariance_px2", covariance), order="C")
        if own.shape != (count, 2, 2):
            raise ValueError(f"spot_covariance_px2 has shape ({count}, 2, 2), one a marker; got {own.shape}")
        spots[~usable_covariance(own)] = np.nan
        return spots, own

    def _in_order(self, event: Event, rate: Vector | None, delay_s: float) -> PoseRecord:
        """Take an event in that is not before any other: the memory is the state before it."""
        self._navigate(event)
        self._timeline.append(event.t_s, event, self.memory.copy(), None)
        self._passed(self._timeline.forget(event.t_s - self.mission.filter.longest_delay_s))
        return self._record(event, rate, delay_s)

    def _navigate(self, event: Event) -> None:
        """The step, and what it wants of the closed form; the report is written."""
        if self._reference is not None:
            self._report[:] = 0.0
            self._reference.take(event, *views_of_report(self._report))
            return
        wants = navigate_pose(self.memory, *event[:-1], self._report, NOTHING_APART)
        if wants == REFUSED:
            _vector("acceleration_m_s2", event.acceleration_m_s2)
            _vector("delta_v_m_s", event.delta_v_m_s)
            raise ValueError("dcm_chaser_from_lvlh is a rotation matrix (3, 3)")
        if wants != NOTHING:
            look_for_roots(self._named, self.mission, event, wants)
            describe_pose(self.memory, self._report, NOTHING_APART)

    def _take(self, before: Vector, event: Event) -> tuple[Vector, Vector]:
        """Take an event into the filter as it was; what is reported of it."""
        self.memory[:] = before
        self._navigate(event)
        return self.memory.copy(), self._report.copy()

    def _insert(self, image: Event) -> Vector | None:
        """Take a late image in; the acceleration is that held over the interval that it divides."""
        following = self._timeline.following(image.t_s)
        push = self._nothing if following is None else following.acceleration_m_s2
        late = image._replace(acceleration_m_s2=push, delta_v_m_s=self._nothing, row=False)
        return self._timeline.insert(image.t_s, late, self._take)

    def _passed(self, events: list[Passed[Vector, Event, Vector | None]]) -> None:
        """Events that no late image can come before any more: for those who keep them."""

    def _record(self, event: Event, rate: Vector | None, delay_s: float) -> PoseRecord:
        """What the report says."""
        mission, dcm = self.mission, event.dcm_chaser_from_lvlh
        own = event.attitude_noise_rad, event.attitude_sigma_rad
        if own != (mission.chaser.attitude_noise_rad, mission.chaser.attitude_sigma_rad):
            mission = mission_as_told(mission, event)
        if delay_s > 0.0 and rate is not None:
            relative = rate - lvlh_rate(dcm.T, frame_rate(orbit_values(mission.orbit), event.t_s))
            dcm = turned(dcm.T, min(delay_s, LARGEST) * relative).T
        return PoseRecord(self._report.tobytes(), mission, dcm, rate)

    def _add_late(self, said: Vector | None) -> None:
        """Add to the report of now what was reported of a late image; None: it came too late."""
        one, _, accepted = views_of_report(self._report)
        if said is None:
            one["nis"], one["dof"], one["used"], one["too_late"] = math.nan, 0, 0, 1
            one["status"], accepted[:] = EpochStatus.PREDICTED, 0.0
        else:
            image, _, accepted[:] = views_of_report(said)
            for name in ("nis", "dof", "used", "status"):
                one[name] = image[name]
            one["alarm"] |= image["alarm"]
        if one["hypotheses"] == 0:
            one["status"] = EpochStatus.WAITING
        elif one["status"] == EpochStatus.WAITING:  # a trial that a later image, here before it, has confirmed
            one["status"] = EpochStatus.STARTED


def _or_stated(name: str, told: float | None, stated: float) -> float:
    return stated if told is None else not_negative(name, told)


def _own(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Matrix:
    """A copy of a caller's array, in one piece; its numbers are looked at where they are taken."""
    array = np.array(numbers(name, value), order="C")
    if array.shape != shape:
        raise ValueError(f"{name} has shape {shape}; got {array.shape}")
    return array


def _vector(name: str, value: ArrayLike) -> Vector:
    out = np.array(numbers(name, value))
    if out.shape != (3,) or not all(abs(x) <= LARGEST for x in out.tolist()):
        raise ValueError(f"{name} has three finite components, up to {LARGEST:g} in size; got {out.tolist()}")
    return out
