"""Images of beacons that arrive some time after their exposure: each is taken in where it belongs."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.estimation.timeline import Timeline
from relnav.navigation.epoch_report import ACCELERATION, ATTITUDE, DELTA_V, REPORT, REPORT_SIZE
from relnav.navigation.status import PREDICTED, STARTED, WAITING
from relnav.sensors.measurement import TOO_LATE

_CONTROL = ACCELERATION | DELTA_V


class Inputs(NamedTuple):
    """What a step is told beside time and spots, in the order of `navigate`: `told` says which of it counts."""

    told: int
    acceleration: Vector
    delta_v: Vector
    dcm: Matrix
    spot_sigma: Matrix
    attitude_noise: float
    attitude_sigma: float

    def only(self, told: int) -> "Inputs":
        """The same with less of it told."""
        return self._replace(told=self.told & told)


class Image(NamedTuple):
    """An epoch: spots (n, 2) m, all NaN where there is none, and their lasting errors, (n,) m, if the model says so."""

    t_s: float
    spots_m: Matrix
    lasting_m: Vector | None
    inputs: Inputs

    @property
    def is_empty(self) -> bool:
        """Whether nothing was seen."""
        return bool(np.isnan(self.spots_m).all())


class LateImages:
    """The epochs of the last seconds, over the memory of a beacon filter.

    Parameters
    ----------
    block, beacons : Vector, Record
        The memory, and its records of beacons.
    navigate : callable
        Takes an epoch into the memory and writes `report`.
    report, kept : Vector
        What `navigate` writes, and the part of it that a record keeps.
    longest_delay_s : float
    """

    def __init__(
        self,
        block: Vector,
        beacons: Record,
        navigate: Callable[..., Any],
        report: Vector,
        kept: Vector,
        longest_delay_s: float,
    ) -> None:
        self._block, self._beacons, self._navigate = block, beacons, navigate
        self._report, self._kept, self._longest_delay_s = report, kept, longest_delay_s
        self.timeline: Timeline[Vector, Image, Vector] = Timeline(block.copy(), math.nan)

    def begin(self, t_s: float) -> None:
        """Go on from what the memory holds now, at t_s."""
        self.timeline = Timeline(self._block.copy(), t_s)

    def check(self, t_s: float, exposed_s: float, told: int) -> None:
        """Refuse times that no epoch can have.

        Raises
        ------
        ValueError
            For an exposure after t_s, a time that goes back, an impulse where time does not go on, or a second image of
            one exposure.
        """
        last = self.timeline.last_s
        if not (math.isfinite(exposed_s) and exposed_s <= t_s):
            raise ValueError(f"image_t_s must be finite and not after t_s = {t_s!r}; got {exposed_s!r}")
        if not math.isfinite(t_s) or t_s < last or (t_s == last and exposed_s == t_s):
            raise ValueError(
                f"t_s must be finite and after the last step's {last!r} s, or at it with an image that is late; "
                f"got {t_s!r}"
            )
        if t_s == last and told & DELTA_V:
            raise ValueError(f"delta_v_m_s comes with the first step to t_s = {t_s!r}, not with a late image after it")
        at = self.timeline.number(exposed_s)
        if at is not None and not self.timeline.passed[at].event.is_empty:
            raise ValueError(f"image_t_s {exposed_s!r} is the time of an image that was taken before; one a time")

    def take(self, t_s: float, image: Image) -> bytes:
        """Go on to t_s and take an image in, of which `check` had nothing to say; what a record keeps."""
        line, oldest, own = self.timeline, t_s - self._longest_delay_s, image.inputs
        if image.t_s == t_s:
            line.insert(t_s, image, self._apply)
            line.forget(oldest)
            return self._kept.tobytes()
        if t_s != line.last_s:
            nothing = np.full(image.spots_m.shape, np.nan)
            line.insert(t_s, Image(t_s, nothing, None, own.only(_CONTROL | ATTITUDE)), self._apply)
        too_late = image.t_s < oldest or image.t_s < line.start_s  # False for NaN: nothing was forgotten
        said = None if too_late else self._insert(image._replace(inputs=own.only(~_CONTROL)))
        line.forget(oldest)
        return self._with_outcome(line.passed[-1].result, said)

    def _insert(self, image: Image) -> Vector:
        """Take a late image in; what was reported of it."""
        line, own = self.timeline, image.inputs
        at = line.number(image.t_s)
        if at is not None:  # there is an epoch without an image
            held = line.passed[at].event.inputs
            own = own._replace(
                told=own.told | held.told & (_CONTROL | ATTITUDE),
                acceleration=held.acceleration,
                delta_v=held.delta_v,
                dcm=own.dcm if own.told & ATTITUDE else held.dcm,
            )
            return line.replace(at, image._replace(inputs=own), self._apply)
        following = line.following(image.t_s)
        if following is not None and following.inputs.told & ACCELERATION:  # held over the interval that it divides
            own = own._replace(told=own.told | ACCELERATION, acceleration=following.inputs.acceleration)
        return line.insert(image.t_s, image._replace(inputs=own), self._apply)

    def _apply(self, before: Vector, image: Image) -> tuple[Vector, Vector]:
        self._block[:] = before
        if image.lasting_m is not None:
            self._beacons["lasting_sigma"] = image.lasting_m
        taken = self._navigate(self._block, image.t_s, image.spots_m, *image.inputs, self._report)
        assert taken is True  # all of it was checked when it came
        return self._block.copy(), self._kept.copy()

    def _with_outcome(self, now: Vector, said: Vector | None) -> bytes:
        """The state of now, with what became of the late image; None: it came too late."""
        out = now.copy()
        head, innovations = out[:REPORT_SIZE].view(REPORT)[0], out[REPORT_SIZE:]
        if said is None:
            head["nis"], head["dof"], head["status"], head["reason"] = math.nan, 0, PREDICTED, TOO_LATE
            innovations[:] = math.nan
        else:
            of_image = said[:REPORT_SIZE].view(REPORT)[0]
            for name in ("nis", "dof", "status", "reason"):
                head[name] = of_image[name]
            innovations[:] = said[REPORT_SIZE:]
        if not head["has_state"]:
            head["status"] = WAITING
        elif head["status"] == WAITING:  # it opened a trial that a later image, here before it, has confirmed
            head["status"] = STARTED
        return out.tobytes()
