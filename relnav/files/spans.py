"""Stretches of epochs of which a reader is told, gathered from a run part after part."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from relnav.arrays import Vector

MOST_EVENTS = 200
"""Of one kind: longer lists nobody reads, and the timeline shows them all."""


@dataclass(frozen=True)
class Event:
    """Something a reader should see on the timeline, from one time to another."""

    begin_s: float
    end_s: float
    what: str
    epochs: int


class Spans:
    """Stretches of epochs with one code, gathered part after part; of some codes there is nothing to tell."""

    def __init__(self, quiet: tuple[int, ...], what: Callable[[int], str]) -> None:
        self.events: list[Event] = []
        self.left_out, self._quiet, self._what, self._last = 0, quiet, what, -1

    def take(self, t: Vector, codes: Any) -> None:
        """Go on with the next epochs."""
        begins = np.append(0, np.flatnonzero(np.diff(codes)) + 1)
        ends = np.append(begins[1:], len(codes)) - 1
        for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
            code, last = int(codes[begin]), self.events[-1] if self.events else None
            if code in self._quiet:
                continue
            if begin == 0 and code == self._last and last is not None and self.left_out == 0:
                self.events[-1] = replace(last, end_s=float(t[end]), epochs=last.epochs + end + 1)
            elif len(self.events) < MOST_EVENTS:
                self.events.append(Event(float(t[begin]), float(t[end]), self._what(code), end - begin + 1))
            else:
                self.left_out += 1
        self._last = int(codes[-1])
