"""The first image of lights after a start is on trial until the next one agrees with it.

Before it little is known, so that an image with a reflection in it passes the gate: three lights, one of them false,
fit a place and an attitude that are wrong, and once they are believed the right light is refused for ever. So the
estimate as it was without any light is carried along. Where not every light of the next image is believed the first
one is left, and that next one is on trial. After MOST images the last one stays: they may all hold a reflection.

Where the target's attitude is known to some degrees only, a light may be refused because the target is turned far: an
image shows the square of such a turn, of which its rows know nothing, and the other two lights fit a mirrored attitude.
So an image is not on trial there unless every light is believed; else it is left, and the one on trial stays. A few of
them in a row open a search among all explanations (`acquisition`).
"""

from collections.abc import Callable
from typing import NamedTuple

from relnav.vehicle.replay import Event
from relnav.vehicle.state import Estimates
from relnav.vehicle.update import Outcome

MOST = 20
"""With a reflection in every fourth image 20 of them have no two in a row that are clean once in 40,000 starts."""

FOLDS_RAD = 0.05
"""1-sigma of the target's attitude above which images may be bent by more than the gate of the first one expects.

Three times as much shortens a pattern by a hundredth, to which the places of lights have to be known.
"""

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
    images, refused : int
        Images so far; those since the last one on trial that were left because not every light was believed.
    """

    blind: Estimates
    image: Event | None = None
    images: int = 0
    refused: int = 0

    def passed(self, through: Callable[[Estimates], Taken]) -> "Trial":
        """The same after an event that is no image of lights."""
        return self._replace(blind=through(self.blind)[0])

    def seen(
        self,
        event: Event,
        taken: Taken,
        blind: Estimates,
        anew: Callable[[Estimates], Taken],
        without: Callable[[], Estimates] | None = None,
    ) -> "Verdict":
        """What an image of lights decides.

        taken: what it makes of the estimates; blind: of its time; anew: what it makes of those; without: the estimates
        without it, where the target may be turned too far for the gate.
        """
        outcome = taken[1][0]
        if outcome.used == 0 and self.image is None and without is None:
            return Verdict(self._replace(blind=blind), taken)
        if not outcome.wide and self.image is None:  # the gate knew what to expect
            return Verdict(None, taken)
        if self.image is None:
            return self._begun(event, taken, blind, without)
        if outcome.used == outcome.groups or self.images >= MOST:
            return Verdict(None, taken)
        return self._begun(event, anew(blind), blind, without)

    def _begun(
        self, event: Event, taken: Taken, blind: Estimates, without: Callable[[], Estimates] | None
    ) -> "Verdict":
        """The trial of this image, or as it was if that is left; taken: what it makes of the blind estimates."""
        outcomes = taken[1]
        if without is not None and outcomes[0].used < outcomes[0].groups:
            same = Trial(blind, self.image, self.images + 1, self.refused + 1)
            return Verdict(same, (without(), [each._replace(used=0) for each in outcomes]))
        return Verdict(Trial(blind, event, self.images + 1), taken)


class Verdict(NamedTuple):
    """The trial, None if it is over, and what the image made of the estimates."""

    trial: Trial | None
    taken: Taken
