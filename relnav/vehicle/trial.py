"""The first image of lights after a start is on trial until the next one agrees with it.

Before it little is known, so that an image with a reflection in it passes the gate: three lights, one of them false,
fit a place and an attitude that are wrong, and once they are believed the right light is refused for ever. So the
estimate as it was without any light is carried along. Where not every light of the next image is believed the first
one is left, and that next one is on trial. After MOST images the last one stays: they may all hold a reflection.
"""

from collections.abc import Callable
from typing import NamedTuple

from relnav.vehicle.replay import Event
from relnav.vehicle.state import Estimates
from relnav.vehicle.update import Outcome

MOST = 20
"""With a reflection in every fourth image 20 of them have no two in a row that are clean once in 40,000 starts."""

Taken = tuple[Estimates, list[Outcome]]
"""Estimates after an event, and what became of it in each filter."""


class Trial(NamedTuple):
    """A start of which no two images have agreed yet.

    Attributes
    ----------
    blind : Estimates
        What never saw a light.
    image : Event or None
        The image on trial; None before the first.
    images : int
        Images so far.
    """

    blind: Estimates
    image: Event | None = None
    images: int = 0

    def passed(self, through: Callable[[Estimates], Taken]) -> "Trial":
        """The same after an event that is no image of lights."""
        return self._replace(blind=through(self.blind)[0])

    def seen(self, event: Event, taken: Taken, blind: Estimates, anew: Callable[[Estimates], Taken]) -> "Verdict":
        """What an image of lights decides.

        taken: what it makes of the estimates; blind: of its time; anew: what it makes of those.
        """
        outcome = taken[1][0]
        if outcome.used == 0 and self.image is None:
            return Verdict(self._replace(blind=blind), taken)
        if not outcome.wide and self.image is None:  # the gate knew what to expect
            return Verdict(None, taken)
        if self.image is None:
            return Verdict(Trial(blind, event, 1), taken)
        if outcome.used == outcome.groups or self.images >= MOST:
            return Verdict(None, taken)
        return Verdict(Trial(blind, event, self.images + 1), anew(blind))


class Verdict(NamedTuple):
    """The trial, None if it is over, and what the image made of the estimates."""

    trial: Trial | None
    taken: Taken
