"""The observations of a vehicle's last seconds, in an order that is their own, and what becomes of one that comes late.

An event stands where (time, place of its source in the vehicle file, content) puts it; when it came says nothing. Of
the states older than it was gone back so far, the first in every SPARSE_S is kept: so few stay that the processor's
cache holds them.
"""

import bisect
import math
from collections.abc import Callable
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

from relnav.arrays import Matrix, Vector
from relnav.estimation.timeline import Timeline

State = TypeVar("State")
Result = TypeVar("Result")

LONGEST_GAP_S = 3600.0
SPARSE_S = 0.4
LATEST_S = 1e11
"""As of a log: a larger one was counted in ms or ns; doubles stand 15 us apart there."""


class Observed(IntEnum):
    """What became of an observation when it came; a later one that belongs before it may change the verdict."""

    ACCEPTED = 0
    REPLAYED = 1
    """It was late: inserted where it belongs, and what came after it done again."""
    TOO_OLD = 2
    """It belongs before the replay window, or before the start."""
    REJECTED = 3
    """Nothing of it could be used: not seen, not credible, or here already."""


ACCEPTED, REPLAYED, TOO_OLD, REJECTED = Observed


class Event(NamedTuple):
    """Something that was observed.

    Attributes
    ----------
    t_s, place : float, int
        When, and the place of its source in the vehicle file.
    source : str
    value, noise : arrays
        What was observed; the covariance of its noise.
    """

    t_s: float
    place: int
    source: str
    value: Vector
    noise: Matrix

    @property
    def key(self) -> tuple[float, int, bytes, bytes]:
        """By which events are ordered."""
        return self.t_s, self.place, self.value.tobytes(), self.noise.tobytes()


class Replay(Generic[State, Result]):
    """The events of the last seconds, and states after them.

    Attributes
    ----------
    newest_s : float
        Time of the last observation; of the start before the first.
    """

    def __init__(
        self,
        start: State,
        start_s: float,
        window_s: float,
        apply: Callable[[State, Event], tuple[State, Result]],
        again: Callable[[State, Event], tuple[State, Result]],
    ) -> None:
        """Begin; apply: what an event makes of a state; again: the same, of a state that was not kept."""
        if not abs(start_s) <= LATEST_S:
            raise ValueError(f"t_s of the start is a time in seconds, at most {LATEST_S:g} in size; got {start_s!r}")
        self._start_s, self._window_s, self._apply, self._again = start_s, window_s, apply, again
        self._line = Timeline[State, Event, Result](start, start_s)
        self._back_s = 0.0
        self.newest_s = start_s

    def insert(self, event: Event) -> tuple[Observed, Result | None]:
        """Take an event in; its result unless it was too old or here already.

        Raises
        ------
        ValueError
            For a time that is no number, or so far ahead that it is a mistake.
        """
        t_s, newest, line = event.t_s, self.newest_s, self._line
        if self.is_too_old(event.source, t_s):
            return TOO_OLD, None
        self._back_s = max(self._back_s, newest - t_s)
        times, passed = line.times, line.passed
        at = count = len(times)
        if count and t_s <= times[-1]:
            at = bisect.bisect_left(times, t_s)
            while at < count and times[at] == t_s and passed[at].event.key < event.key:
                at += 1
            if at < count and passed[at].event.key == event.key:
                return REJECTED, None
        if at < count:
            line.state_before(at, self._again)
        result = line.insert(t_s, event, self._apply, at)
        self.newest_s = newest = max(newest, t_s)
        line.thin(newest - self._back_s, SPARSE_S)
        if times[0] < newest - self._window_s:
            line.forget(newest - self._window_s)
        return REPLAYED if at < count or t_s < newest else ACCEPTED, result

    def is_too_old(self, source: str, t_s: float) -> bool:
        """Whether a time lies before all that can still be inserted.

        Raises
        ------
        ValueError
            As `insert`.
        """
        newest = self.newest_s
        check_gap(source, t_s, newest)
        return t_s < self._start_s or t_s < newest - self._window_s

    def goes_on(self, t_s: float) -> bool:
        """Whether t_s is later than all that came so far, and no mistake."""
        newest = self.newest_s
        return newest < t_s <= newest + LONGEST_GAP_S

    def changed(self, t_s: float) -> bool:
        """Do events from t_s on again, because what moves states has changed since; whether t_s is in the past."""
        line, newest = self._line, self.newest_s
        at = bisect.bisect_left(line.times, t_s)
        again = at < len(line.times)
        if again:
            line.state_before(at, self._again)
            line.redo(at, self._apply)
        self._back_s, self.newest_s = max(self._back_s, newest - t_s), max(newest, t_s)
        return again or t_s < newest

    def forward(self, along: Callable[[State, float], State]) -> State:
        """Bring the state before all events along to the oldest time that can still change, and return it."""
        oldest, line = self._oldest_s, self._line
        line.state_before(bisect.bisect_left(line.times, oldest), self._again)
        line.forget(oldest)
        line.start = along(line.start, oldest)
        return line.start

    def before(self, t_s: float) -> State:
        """The state after the last event not later than t_s.

        Raises
        ------
        ValueError
            For a time before the replay window.
        """
        if not t_s >= self._oldest_s:
            raise ValueError(f"t_s is {self._oldest_s:g} s or later, within the replay window; got {t_s!r}")
        self._back_s = max(self._back_s, self.newest_s - t_s)
        return self._line.state_before(bisect.bisect_right(self._line.times, t_s), self._again)

    @property
    def newest(self) -> State:
        """The state after the last event."""
        return self._line.state_before(len(self._line.times), self._again)

    @property
    def _oldest_s(self) -> float:
        """The oldest time that can still change."""
        return max(self._start_s, self.newest_s - self._window_s)


def check_gap(source: str, t_s: float, newest_s: float) -> None:
    """Refuse a time that is so far ahead of the last observation that it is a mistake, or none at all.

    Raises
    ------
    ValueError
        Saying what came.
    """
    if not t_s <= newest_s + LONGEST_GAP_S or t_s == -math.inf:
        raise ValueError(
            f"{source}: t_s is a time at most {LONGEST_GAP_S:g} s after the last observation "
            f"({newest_s:g} s); got {t_s!r}; after such a gap start anew"
        )
