"""Events in the order of their times, whatever the order in which they came.

An event that comes late is taken in where it belongs, and all that came after it is done again from the state before
it, so that the answer is, bit for bit, that of the same events in order. A filter's state, here, is whatever it can be
set back to: a copy of its memory, or a value that never changes. A state that is not kept is made again when it is
asked for.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeAlias, TypeVar

State = TypeVar("State")
Happening = TypeVar("Happening")
Result = TypeVar("Result")

Apply: TypeAlias = Callable[[State, Happening], tuple[State, Result]]
"""Gives the state and the result of an event after a state."""


class Passed(NamedTuple, Generic[State, Happening, Result]):
    """An event, the filter's state after it, None where it is not kept, and what came of it."""

    event: Happening
    state: State | None
    result: Result


class Timeline(Generic[State, Happening, Result]):
    """The latest events by their times, with states after them.

    Parameters
    ----------
    start : State
        Before all events.
    start_s : float
        Its time: nothing can be taken in before it; NaN if there is none.
    """

    def __init__(self, start: State, start_s: float) -> None:
        self.start, self.start_s = start, start_s
        self.times: list[float] = []
        self.passed: list[Passed[State, Happening, Result]] = []
        self._thinned = 0

    @property
    def last_s(self) -> float:
        """Time of the last event; of the start before there is one."""
        return self.times[-1] if self.times else self.start_s

    def insert(
        self, t_s: float, event: Happening, apply: Apply[State, Happening, Result], at: int | None = None
    ) -> Result:
        """Take an event in, after those of the same time or as number `at`; its result.

        apply: done for it and again for every later event.
        """
        at = bisect_right(self.times, t_s) if at is None else at
        if at == len(self.times):
            state, result = apply(self.state_before(at, apply), event)
            self.append(t_s, event, state, result)
            return result
        self._redo(at, [event, *(one.event for one in self.passed[at:])], apply)
        self.times.insert(at, t_s)
        return self.passed[at].result

    def append(self, t_s: float, event: Happening, state: State, result: Result) -> None:
        """Take an event in that is not earlier than all others, and is done already."""
        self.times.append(t_s)
        self.passed.append(Passed(event, state, result))

    def replace(self, at: int, event: Happening, apply: Apply[State, Happening, Result]) -> Result:
        """Put another event in the place of event number `at`, of the same time; its result."""
        self._redo(at, [event, *(one.event for one in self.passed[at + 1 :])], apply)
        return self.passed[at].result

    def redo(self, at: int, apply: Apply[State, Happening, Result]) -> None:
        """Do all events from number `at` on again."""
        self._redo(at, [one.event for one in self.passed[at:]], apply)

    def _redo(self, at: int, events: Sequence[Happening], apply: Apply[State, Happening, Result]) -> None:
        state, done = self.state_before(at, apply), []
        for event in events:
            state, result = apply(state, event)
            done.append(Passed(event, state, result))
        self.passed[at:], self._thinned = done, min(self._thinned, at)

    def state_before(self, at: int, apply: Apply[State, Happening, Result]) -> State:
        """The state before event number `at`, made again from the last one that was kept."""
        passed, first, state = self.passed, at, self.start
        while first:
            kept = passed[first - 1].state
            if kept is not None:
                state = kept
                break
            first -= 1
        for k in range(first, at):
            event = passed[k].event
            state, result = apply(state, event)
            passed[k] = Passed(event, state, result)
        self._thinned = min(self._thinned, first)
        return state

    def following(self, t_s: float) -> Happening | None:
        """The first event after a time."""
        at = bisect_right(self.times, t_s)
        return self.passed[at].event if at < len(self.times) else None

    def number(self, t_s: float) -> int | None:
        """Number of the event of this very time; None if there is none."""
        at = bisect_left(self.times, t_s)
        return at if at < len(self.times) and self.times[at] == t_s else None

    def thin(self, before_s: float, every_s: float) -> None:
        """Keep, of states before a time that another follows, the first in each `every_s` alone."""
        times, passed, k = self.times, self.passed, self._thinned
        while k < len(times) - 1 and times[k + 1] <= before_s:
            if k and times[k] // every_s == times[k - 1] // every_s:
                passed[k] = passed[k]._replace(state=None)
            k += 1
        self._thinned = k

    def forget(self, before_s: float) -> list[Passed[State, Happening, Result]]:
        """Drop the events before a time, which none can come before any more, and return them.

        Not those behind the last state before it that is kept: that becomes the start.
        """
        count, start = bisect_left(self.times, before_s), None
        while count and start is None:
            start = self.passed[count - 1].state
            count -= start is None
        gone = self.passed[:count]
        if start is not None:
            self.start, self.start_s = start, self.times[count - 1]
            del self.times[:count], self.passed[:count]
            self._thinned = max(0, self._thinned - count)
        return gone
