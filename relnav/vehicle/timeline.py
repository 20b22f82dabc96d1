"""Events in the order in which they happened, whatever the order in which they came.

An event stands where (time, place of its source in the vehicle file, content) puts it; when it came says nothing. One
that comes late is inserted, and everything after it is done again from the state before it, so that the answer is that
of the same events in order, bit for bit. States never change, so going back costs nothing.
"""

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Generic, TypeVar

from relnav.arrays import Matrix, Vector

State = TypeVar("State")
Result = TypeVar("Result")

LONGEST_GAP_S = 3600.0


class Observed(IntEnum):
    """What became of an observation when it came; a later one that belongs before it may change the verdict."""

    ACCEPTED = 0
    REPLAYED = 1
    """It was late: inserted where it belongs, and what came after it done again."""
    TOO_OLD = 2
    """It belongs before the replay window, or before the start."""
    REJECTED = 3
    """Nothing of it could be used: not seen, not credible, or here already."""


@dataclass(frozen=True)
class Event:
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
        self._base, self._start_s, self._window_s, self._apply = start, start_s, window_s, apply
        self._events: list[Event] = []
        self._keys: list[tuple[float, int, bytes, bytes]] = []
        self._after: list[tuple[State, Result]] = []
        self.newest_s = start_s

    def insert(self, event: Event) -> tuple[Observed, Result | None]:
        """Take an event in; its result unless it was too old or here already.

        Raises
        ------
        ValueError
            For a time that is no number, or so far ahead that it is a mistake.
        """
        if not math.isfinite(event.t_s) or event.t_s > self.newest_s + LONGEST_GAP_S:
            raise ValueError(
                f"{event.source}: t_s is a time at most {LONGEST_GAP_S:g} s after the last observation "
                f"({self.newest_s:g} s); got {event.t_s!r}; after such a gap start anew"
            )
        if event.t_s < max(self._start_s, self.newest_s - self._window_s):
            return Observed.TOO_OLD, None
        key = event.key
        at = bisect.bisect_left(self._keys, key)
        if at < len(self._keys) and self._keys[at] == key:
            return Observed.REJECTED, None
        late = at < len(self._keys)
        state, after = self._base if at == 0 else self._after[at - 1][0], []
        for each in (event, *self._events[at:]):
            after.append(self._apply(state, each))
            state = after[-1][0]
        self._events.insert(at, event)
        self._keys.insert(at, key)
        self._after[at:] = after
        self.newest_s = max(self.newest_s, event.t_s)
        self._forget()
        return Observed.REPLAYED if late else Observed.ACCEPTED, after[0][1]

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
        at = bisect.bisect_right(self._keys, t_s, key=lambda key: key[0])
        return self._base if at == 0 else self._after[at - 1][0]

    @property
    def newest(self) -> State:
        """The state after the last event."""
        return self._after[-1][0] if self._after else self._base

    def _forget(self) -> None:
        """Drop events before the window: nothing can be inserted before them any more."""
        count = bisect.bisect_left(self._keys, self.newest_s - self._window_s, key=lambda key: key[0])
        if count:
            self._base = self._after[count - 1][0]
            del self._events[:count], self._keys[:count], self._after[:count]
