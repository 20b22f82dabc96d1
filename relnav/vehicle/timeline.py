"""Events in the order in which they happened, whatever the order in which they came.

An event stands where (time, place of its source in the vehicle file, content) puts it; when it came says nothing. One
that comes late is inserted, and everything after it is done again from the state before it, so that the answer is that
of the same events in order, bit for bit. States never change, so going back costs nothing.
"""

import bisect
import math
from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

from relnav.arrays import Matrix, Vector

State = TypeVar("State")
Result = TypeVar("Result")

LONGEST_GAP_S = 3600.0
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


class Timeline(Generic[State, Result]):
    """The events of the last seconds, each with the state after it."""

    def __init__(
        self, start: State, start_s: float, window_s: float, apply: Callable[[State, Event], tuple[State, Result]]
    ) -> None:
        if not abs(start_s) <= LATEST_S:
            raise ValueError(f"t_s of the start is a time in seconds, at most {LATEST_S:g} in size; got {start_s!r}")
        self._base, self._start_s, self._window_s, self._apply = start, start_s, window_s, apply
        self._events: list[Event] = []
        self._times: list[float] = []
        self._after: list[tuple[State, Result]] = []
        self.newest_s = start_s

    def insert(self, event: Event) -> tuple[Observed, Result | None]:
        """Take an event in; its result unless it was too old or here already.

        Raises
        ------
        ValueError
            For a time that is no number, or so far ahead that it is a mistake.
        """
        t_s, newest = event.t_s, self.newest_s
        if self.is_too_old(event.source, t_s):
            return TOO_OLD, None
        at = count = len(self._times)
        if count and t_s <= self._times[-1]:
            at = bisect.bisect_left(self._times, t_s)
            while at < count and self._times[at] == t_s and self._events[at].key < event.key:
                at += 1
            if at < count and self._events[at].key == event.key:
                return REJECTED, None
        after = self._done(at, [event, *self._events[at:]])
        self._events.insert(at, event)
        self._times.insert(at, t_s)
        self._after[at:] = after
        self.newest_s = max(newest, t_s)
        self._forget()
        return REPLAYED if at < count or t_s < newest else ACCEPTED, after[0][1]

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
        """Whether t_s is later than all that came so far, and no mistake: then it is the newest time from now on."""
        newest = self.newest_s
        if newest < t_s <= newest + LONGEST_GAP_S:
            self.newest_s = t_s
            return True
        return False

    def changed(self, t_s: float) -> bool:
        """Do events from t_s on again, because what moves states has changed since; whether t_s is in the past."""
        at, late = bisect.bisect_left(self._times, t_s), t_s < self.newest_s
        if at < len(self._times):
            self._after[at:], late = self._done(at, self._events[at:]), True
        return late

    def forward(self, along: Callable[[State, float], State]) -> State:
        """Bring the state before all events along to the oldest time that can still change, and return it."""
        self._forget()
        self._base = along(self._base, max(self._start_s, self.newest_s - self._window_s))
        return self._base

    def before(self, t_s: float) -> State:
        """The state after the last event not later than t_s.

        Raises
        ------
        ValueError
            For a time before the replay window.
        """
        oldest = max(self._start_s, self.newest_s - self._window_s)
        if not t_s >= oldest:
            raise ValueError(f"t_s is {oldest:g} s or later, within the replay window; got {t_s!r}")
        at = bisect.bisect_right(self._times, t_s)
        return self._base if at == 0 else self._after[at - 1][0]

    @property
    def newest(self) -> State:
        """The state after the last event."""
        return self._after[-1][0] if self._after else self._base

    def _done(self, at: int, events: Iterable[Event]) -> list[tuple[State, Result]]:
        """What events make of the state before place `at`, one after the other."""
        state, after = self._base if at == 0 else self._after[at - 1][0], []
        for each in events:
            after.append(self._apply(state, each))
            state = after[-1][0]
        return after

    def _forget(self) -> None:
        """Drop events before the window: nothing can be inserted before them any more."""
        count = bisect.bisect_left(self._times, self.newest_s - self._window_s)
        if count:
            self._base = self._after[count - 1][0]
            del self._events[:count], self._times[:count], self._after[:count]


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
