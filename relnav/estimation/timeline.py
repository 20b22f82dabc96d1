"""Events in the order of their times, whatever the order in which they came.

An event that comes late is taken in where it belongs, and all that came after it is done again from the state before
it, so that the answer is, bit for bit, that of the same events in order. A filter's state, here, is whatever it can be
set back to: a copy of its memory, or a value that never changes.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

State = TypeVar("State")
Happening = TypeVar("Happening")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Passed(Generic[State, Happening, Result]):
    """An event, the filter's state after it, and what came of it."""

    event: Happening
    state: State
    result: Result


class Timeline(Generic[State, Happening, Result]):
    """The latest events by their times, each with the state after it.

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

    @property
    def last_s(self) -> float:
        """Time of the last event; of the start before there is one."""
        return self.times[-1] if self.times else self.start_s

    def insert(self, t_s: float, event: Happening, apply: Callable[[State, Happening], tuple[State, Result]]) -> Result:
        """Take an event in, after those of the same time; its result.

        apply: gives the state and the result of an event after a state; done again for every later event.
        """
        at = bisect_right(self.times, t_s)
        self._redo(at, [event, *(one.event for one in self.passed[at:])], apply)
        self.times.insert(at, t_s)
        return self.passed[at].result

    def replace(self, at: int, event: Happening, apply: Callable[[State, Happening], tuple[State, Result]]) -> Result:
        """Put another event in the place of event number `at`, of the same time; its result."""
        self._redo(at, [event, *(one.event for one in self.passed[at + 1 :])], apply)
        return self.passed[at].result

    def _redo(
        self, at: int, events: list[Happening], apply: Callable[[State, Happening], tuple[State, Result]]
    ) -> None:
        state, done = self.start if at == 0 else self.passed[at - 1].state, []
        for event in events:
            state, result = apply(state, event)
            done.append(Passed(event, state, result))
        self.passed[at:] = done

    def following(self, t_s: float) -> Happening | None:
        """The first event after a time."""
        at = bisect_right(self.times, t_s)
        return self.passed[at].event if at < len(self.times) else None

    def number(self, t_s: float) -> int | None:
        """Number of the event of this very time; None if there is none."""
        at = bisect_left(self.times, t_s)
        return at if at < len(self.times) and self.times[at] == t_s else None

    def forget(self, before_s: float) -> list[Passed[State, Happening, Result]]:
        """Drop the events before a time, which none can come before any more, and return them."""
        count = bisect_left(self.times, before_s)
        gone = self.passed[:count]
        if count:
            self.start, self.start_s = gone[-1].state, self.times[count - 1]
            del self.times[:count], self.passed[:count]
        return gone
