"""A whole log of marker spots through the marker filter, chunk by chunk, late images included."""

from __future__ import annotations

from typing import Any

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector, one_piece, vector
from relnav.codegen.kernel import entry
from relnav.dynamics.error_state import POSE
from relnav.errors import UsageError
from relnav.estimation.timeline import Passed, Timeline
from relnav.geometry.rotation import dcm_from_quaternion, dcm_from_quaternion_into, quaternion_from_dcm
from relnav.mission import VisionMission
from relnav.navigation.arguments import controls, quaternions, refuse_no_beacons
from relnav.navigation.pose_call import AS_STATED, Event
from relnav.navigation.pose_epoch import EPOCH, read_epoch, write_epoch
from relnav.navigation.pose_filter import NOTHING, pose_step
from relnav.navigation.pose_memory import pose_views
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.pose_roots import look_for_roots
from relnav.navigation.pose_smoothing import PoseSmoother
from relnav.navigation.relative_pose import PoseNavigator
from relnav.sensors.three_marker.camera import usable_covariance

CHUNK = 4096


@entry
def _run(
    block: Vector,
    first: int,
    t: Vector,
    spots: Stack,
    control: Matrix,
    quaternion: Matrix,
    held: Matrix,
    covariances: Stack,
    chaser: Matrix,
    epochs: Record,
    apart: Stack,
) -> int:
    """`pose_step` over epochs from `first` on; returns the one after which roots are wanted, or their number.

    spots (n, markers, 2); covariances (n, markers, 2, 2), or AS_STATED; control (n, 6) or (0, 6); quaternion (n, 4) or
    (0, 4): then the chaser holds `held` (3, 3).
    chaser (3, 3) is scratch. apart (n, m, 12) as in `write_epoch`.
    """
    m = pose_views(block)
    acceleration, delta_v = m.motion["acceleration"], m.motion["delta_v"]
    for i in range(3):
        for j in range(3):
            chaser[i, j] = held[i, j]
    for e in range(first, t.shape[0]):
        for j in range(3):
            acceleration[j] = control[e, j] if control.shape[0] > 0 else 0.0
            delta_v[j] = control[e, 3 + j] if control.shape[0] > 0 else 0.0
        if quaternion.shape[0] > 0:
            dcm_from_quaternion_into(quaternion[e], chaser)
        own = covariances[e if covariances.shape[0] > 1 else 0]
        wants = pose_step(block, t[e], chaser, spots[e], own)
        write_epoch(m, epochs[e], apart[e])
        if wants != NOTHING:
            m.result["wants"] = wants
            return e
    return int(t.shape[0])


class MarkerLogFilter(PoseNavigator):
    """A marker filter that is fed a log in chunks; `passed`: epochs that nothing later changes, images included."""

    def __init__(self, mission: VisionMission, *, keep: bool = False, engine: str = "compiled") -> None:
        """keep: hand out what passed, for a smoother; engine: as for `PoseNavigator`."""
        super().__init__(mission, engine=engine)
        if keep and self._reference is not None:
            raise UsageError('engine="filterpy" filters marker logs forward alone: leave smoothing out')
        self._keep = keep
        self._past: list[tuple[Any, Stack]] = []
        self._considered = len(self._named.news)

    def forward(
        self,
        t: Vector,
        spots: Stack,
        control: Matrix,
        quaternion: Matrix,
        image_t: Vector | None = None,
        covariances: Stack = AS_STATED,
    ) -> Any:
        """Filter the next epochs: t (n,), spots (n, markers, 2), control (n, 6) or (0, 6), quaternion (n, 4) or (0, 4).

        image_t (n,): when each row's image was exposed; covariances (n, markers, 2, 2) px2, all of them usable, or
        AS_STATED. Returns records of type `EPOCH`, (n,).
        """
        epochs, last, apart = np.zeros(len(t), EPOCH), self.last_t_s, self._room(len(t))
        if t[0] < last or (t[1:] < t[:-1]).any():  # last: NaN at the start
            raise ValueError(f"t_s must not go back; the last epoch was at {last!r} s")
        if image_t is not None or self._timeline.passed or self._reference is not None:
            self._one_by_one(t, spots, control, quaternion, image_t, covariances, epochs)
            return epochs
        done, chaser = 0, np.zeros((3, 3))
        while done < len(t):
            at = _run(self.memory, done, t, spots, control, quaternion, self._held, covariances, chaser, epochs, apart)
            if at < len(t):
                m = self._named
                a, v, chaser_now = m.motion["acceleration"], m.motion["delta_v"], m.camera["chaser"]
                stated = self.mission.chaser.attitude_noise_rad, self.mission.chaser.attitude_sigma_rad
                own = covariances[at if len(covariances) > 1 else 0]
                event = Event(float(t[at]), a, v, chaser_now, *stated, spots[at], own)
                look_for_roots(m, self.mission, event, int(m.result["wants"]))
                read_epoch(self.memory, epochs[at : at + 1], apart[at : at + 1])
            done = at + 1
        self._timeline = Timeline(self.memory.copy(), float(t[-1]))
        if self._keep:
            self._past.append((epochs.copy(), apart))
        return epochs

    def _room(self, n: int) -> Stack:
        """For what considered errors have done to n events, (n, m, 12); (n, 0, 12) where it is not kept apart."""
        return np.zeros((n, self._considered if self._keep else 0, POSE))

    def _one_by_one(
        self,
        t: Vector,
        spots: Stack,
        control: Matrix,
        quaternion: Matrix,
        image_t: Vector | None,
        covariances: Stack,
        epochs: Any,
    ) -> None:
        for k in range(len(t)):
            epochs[k] = self.step(
                float(t[k]),
                spots[k],
                image_t_s=None if image_t is None else float(image_t[k]),
                acceleration_m_s2=control[k, :3] if len(control) else None,
                delta_v_m_s=control[k, 3:] if len(control) else None,
                dcm_chaser_from_lvlh=dcm_from_quaternion(quaternion[k]) if len(quaternion) else None,
                spot_covariance_px2=covariances[k] if covariances.shape[1] else None,
            ).epoch

    def _passed(self, events: list[Passed[Vector, Event, Vector | None]]) -> None:
        if self._keep:
            epochs, apart = np.zeros(len(events), EPOCH), self._room(len(events))
            for k, one in enumerate(events):
                assert one.state is not None  # none of them is thinned
                read_epoch(one.state, epochs[k : k + 1], apart[k : k + 1])
                epochs[k]["row"] = one.event.row
            self._past.append((epochs, apart))

    def passed(self, *, last: bool = False) -> tuple[Any, Stack]:
        """Events that have passed since this was asked last, and what considered errors have done to each, (n, m, 12).

        last: with those that a late image might still change.
        """
        if last:
            self._passed(self._timeline.passed)
        past, self._past = self._past, []
        if not past:
            return np.zeros(0, EPOCH), self._room(0)
        return np.concatenate([one[0] for one in past]), np.concatenate([one[1] for one in past])


def filter_marker_epochs(
    mission: VisionMission,
    t_s: Vector,
    spots_px: Stack,
    *,
    image_t_s: Vector | None = None,
    acceleration_m_s2: Matrix | None = None,
    delta_v_m_s: Matrix | None = None,
    q_chaser_from_lvlh: Matrix | None = None,
    dcm_chaser_from_lvlh: Stack | None = None,
    spot_covariance_px2: Stack | None = None,
    smooth: bool = False,
    engine: str = "compiled",
) -> PoseSolution:
    """Filter a log of marker spots that is already in memory: the same step as `PoseNavigator`, epoch after epoch.

    Parameters
    ----------
    mission : VisionMission
        From `relnav.load_model`.
    t_s : (n,)
        Times that do not decrease.
    spots_px : (n, markers, 2)
        Spots, px; NaN = not seen.
    image_t_s : (n,), optional
        Middle of each row's exposure, where it is not t_s.
    acceleration_m_s2, delta_v_m_s : (n, 3), optional
        Control in `lvlh_ccsds`: acceleration held since the row before, impulse just before the row.
    q_chaser_from_lvlh : (n, 4), optional
        The chaser's attitude at each row, unit quaternions, scalar last; the model's if left out.
    dcm_chaser_from_lvlh : (n, 3, 3), optional
        The same as rotation matrices.
    spot_covariance_px2 : (n, markers, 2, 2), optional
        Of each spot, as for `PoseNavigator.step`.
    smooth : bool
        Run backward too: every state then rests on the images after it as well.
    engine : {"compiled", "filterpy"}
        As for `PoseNavigator`; filterpy's neither smooths nor takes late images.

    Raises
    ------
    ValueError
        For another kind of model, shapes that do not agree, times that go back, control or attitude that is not usable,
        an attitude given twice, an unknown engine.
    """
    if not isinstance(mission, VisionMission):
        refuse_no_beacons(mission, "")
        raise ValueError(
            f"{mission.name} is a beacon mission: its log is filtered by relnav.filter_epochs, not by "
            "relnav.filter_marker_epochs"
        )
    t, spots = one_piece("t_s", t_s), one_piece("spots_px", spots_px)
    if t.ndim != 1 or len(t) == 0:
        raise ValueError(f"t_s has one axis, with at least one epoch; got shape {t.shape}")
    expected = (len(t), len(mission.markers.positions_m), 2)
    if spots.shape != expected:
        raise ValueError(f"spots_px has shape {expected}, one row a marker; got {spots.shape}")
    if not np.all(np.isfinite(t)):
        raise ValueError("t_s must be finite")
    exposed = None if image_t_s is None else one_piece("image_t_s", image_t_s)
    if exposed is not None and exposed.shape != t.shape:
        raise ValueError(f"image_t_s has shape {t.shape}, as t_s; got {exposed.shape}")
    control = controls(len(t), acceleration_m_s2, delta_v_m_s)
    quaternion = quaternions("q_chaser_from_lvlh", len(t), q_chaser_from_lvlh)
    if dcm_chaser_from_lvlh is not None:
        if q_chaser_from_lvlh is not None:
            raise ValueError("q_chaser_from_lvlh and dcm_chaser_from_lvlh are the same attitude: give one of them")
        turns = vector("dcm_chaser_from_lvlh", dcm_chaser_from_lvlh, (len(t), 3, 3))
        quaternion = np.array([quaternion_from_dcm(turn) for turn in turns]).reshape(-1, 4)
    covariances = AS_STATED
    if spot_covariance_px2 is not None:
        covariances = one_piece("spot_covariance_px2", spot_covariance_px2)
        if covariances.shape != (*expected, 2):
            raise ValueError(f"spot_covariance_px2 has shape {(*expected, 2)}, one a spot; got {covariances.shape}")
        spots = with_usable(spots, covariances)
    log = MarkerLogFilter(mission, keep=smooth, engine=engine)
    epochs = log.forward(t, spots, control, quaternion, exposed, covariances)
    if smooth:
        events, apart = log.passed(last=True)
        PoseSmoother(mission).backward(events, apart)
        smoothed_rows(epochs, events[events["row"] > 0])
    seen = spots if image_t_s is None else None
    return PoseSolution(mission, epochs, smooth, spots_px=seen, spot_covariance_px2=covariances)


def with_usable(spots: Stack, covariances: Stack) -> Stack:
    """Spots (n, markers, 2) whose covariances (n, markers, 2, 2) can be used; NaN for the others, as not seen."""
    return np.where(usable_covariance(covariances).reshape(*spots.shape[:2], 1), spots, np.nan)


def smoothed_rows(epochs: Any, events: Any) -> None:
    """Replace the filtered states of rows by the smoothed ones of their events, (n,) both."""
    for name in ("motion", "dcm", "rate", "factor", "by_chaser"):
        epochs[name] = events[name]
