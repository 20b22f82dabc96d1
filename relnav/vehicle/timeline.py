"""Events in the order in which they happened, whatever the order in which they came.

An event stands where (time, place of its source in the vehicle file, content) puts it; when it came says nothing. One
that comes late is inserted, and everything after it is done again from the state before it, so that the answer is that
of the same events in order, bit for bit. States never change, so going back costs nothing.

Of the states older than it was gone back so far, the first in every SPARSE_S is kept, and the others are made again
when they are asked for: so few stay that the processor's cache holds them.
"""

import bisect
import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Generic, NamedTuple, TypeVar

from relnav.arrays import Matrix, Vector

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


class Timeline(Generic[State, Result]):
    """The events of the last seconds, and states after them."""

    def __init__(
        self,
        start: State,
        start_s: float,
        window_s: float,
        apply: Callable[[State, Event], tuple[State, Result]],
        again: Callable[[State, Event], State],
    ) -> None:
        """Begin; apply: what an event makes of a state; again: the same, of a state that was not kept."""
        if not abs(start_s) <= LATEST_S:
            raise ValueError(f"t_s of the start is a time in seconds, at most {LATEST_S:g} in size; got {start_s!r}")
        self._base, self._start_s, self._window_s, self._apply, self._again = start, start_s, window_s, apply, again
        self._events: list[Event] = []
        self._times: list[float] = []
        self._after: list[State | None] = []
        self._thinned, self._back_s = 0, 0.0
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
        self._back_s = max(self._back_s, newest - t_s)
        at = count = len(self._times)
        if count and t_s <= self._times[-1]:
            at = bisect.bisect_left(self._times, t_s)
            while at < count and self._times[at] == t_s and self._events[at].key < event.key:
                at += 1
            if at < count and self._events[at].key == event.key:
                return REJECTED, None
        result = self._do(at, [event, *self._events[at:]])
        self._events.insert(at, event)
        self._times.insert(at, t_s)
        self.newest_s = max(newest, t_s)
        self._thin()
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
        at, newest = bisect.bisect_left(self._times, t_s), self.newest_s
        again = at < len(self._times)
        if again:
            self._do(at, self._events[at:])
        self._back_s, self.newest_s = max(self._back_s, newest - t_s), max(newest, t_s)
        return again or t_s < newest

    def forward(self, along: Callable[[State, float], State]) -> State:
        """Bring the state before all events along to the oldest time that can still change, and return it."""
        oldest = max(self._start_s, self.newest_s - self._window_s)
        count = bisect.bisect_left(self._times, oldest)
        self._forget(count, along(self._before(count), oldest))
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
        self._back_s = max(self._back_s, self.newest_s - t_s)
        return self._before(bisect.bisect_right(self._times, t_s))

    @property
    def newest(self) -> State:
        """The state after the last event."""
        return self._before(len(self._times))

    def _before(self, at: int) -> State:
        """The state before place `at`, made again from the last one that was kept."""
        state, first = self._base, at
        while first:
            kept = self._after[first - 1]
            if kept is not None:
                state = kept
                break
            first -= 1
        for k in range(first, at):
            self._after[k] = state = self._again(state, self._events[k])
        self._thinned = min(self._thinned, first)
        return state

    def _do(self, at: int, events: Sequence[Event]) -> Result:
        """Do events from place `at` on, one after the other; the result of the first."""
        state, first = self._apply(self._before(at), events[0])
        after: list[State | None] = [state]
        for event in events[1:]:
            state, _ = self._apply(state, event)
            after.append(state)
        self._after[at:], self._thinned = after, min(self._thinned, at)
        return first

    def _thin(self) -> None:
        """Drop states that need not be kept, and events before the window: nothing can be inserted before them."""
        times, after, k = self._times, self._after, self._thinned
        while k < len(times) - 1 and times[k + 1] <= self.newest_s - self._back_s:
            if k and times[k] // SPARSE_S == times[k - 1] // SPARSE_S:
                after[k] = None
            k += 1
        self._thinned, count = k, bisect.bisect_left(times, self.newest_s - self._window_s)
        while count:
            kept = after[count - 1]
            if kept is not None:
                self._forget(count, kept)
                break
            count -= 1

    def _forget(self, count: int, base: State) -> None:
        """Drop the first events, after which the state is base."""
        self._base, self._thinned = base, max(0, self._thinned - count)
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
