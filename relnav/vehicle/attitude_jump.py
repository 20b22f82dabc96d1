"""A second hypothesis where a star or sun sensor is refused: the chaser's attitude has jumped, or the gyro's bias.

A gyro sample that is wrong turns the estimate by what was never turned. Lights do then not fit either, and nothing in
the filter widens its attitude again, so that a star sensor that is right is refused for ever. So where one is refused
a copy of the estimates before that image is carried along, with attitude and bias opened: known to START_RAD and
START_RAD_S more than they were. Everything that is seen goes into both. The copy is believed once it is a million times
(DROP) as likely, by

    sum of (NIS of the filter - NIS of the copy), each no more than the gate lets pass, - 2 x (nats that it learnt more)

The last term charges the copy for its freedom: as half the logarithm by which the chaser's attitude shrank, it adds up
to the ratio of the innovations' determinants.

A wrong star sensor makes the same copy, about its own attitude. Lights and sun sensors then agree with the filter, and
contradict the copy: AGAINST in all is too much. Each of them that was believed lately is heard before the copy is,
unless that takes longer than until lights are locked out.
"""

import math
from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from relnav.vehicle.acquisition import DROP, START_RAD, START_RAD_S
from relnav.vehicle.health import Fare
from relnav.vehicle.layout import CHASER_ATTITUDE, GYRO_BIAS
from relnav.vehicle.state import Estimates
from relnav.vehicle.update import Outcome

AGAINST = 2.0 * math.log(10.0)
"""Twice the logarithm of how much less likely what other sensors saw may be in the copy than in the filter.

One direction of a sun sensor that the copy's gate refuses adds 14 or so. Noise adds that much to a right copy one time
in sixty at the most, for a jump of two sigmas of a direction; it then waits for the next one.
"""
LONGEST = 2.0
"""Of the time after which a lock-out of lights is one: a copy that is not believed by then is left."""


class Verdict(Enum):
    """What is made of the copy."""

    CARRIED = auto()
    BELIEVED = auto()
    LEFT = auto()


class Jump(NamedTuple):
    """The copy.

    Attributes
    ----------
    estimates : Estimates
    fares : mapping
        How each sensor fares in it.
    source : str
        The sensor that was refused.
    since_s : float
        When.
    unheard : frozenset of str
        Other sensors, believed lately, of which nothing was seen since the copy knew its attitude.
    gain, against : float
        The sum of above; of other sensors than the refused one, how much less likely what they saw is in the copy.
    """

    estimates: Estimates
    fares: Mapping[str, Fare]
    source: str
    since_s: float
    unheard: frozenset[str]
    gain: float = 0.0
    against: float = 0.0

    def moved(self, move: Callable[[Estimates], Estimates]) -> "Jump":
        """The same with its estimates moved."""
        return self._replace(estimates=move(self.estimates))

    def after(self, at: Estimates, source: str, fares: Mapping[str, Fare], own: Outcome, main: Outcome) -> "Jump":
        """The same after an observation: estimates and fares then, what became of it in the copy and in the filter."""
        most = max(own.groups, main.groups)
        unlike = _unlike(main, most) - _unlike(own, most)
        others = 0.0 if source == self.source else unlike
        return self._replace(
            estimates=at,
            fares=fares,
            unheard=self.unheard - {source} if most and not own.wide else self.unheard,
            gain=self.gain + unlike - 2.0 * (own.gains[2] - main.gains[2]),
            against=self.against - others,
        )

    @property
    def is_likely(self) -> bool:
        """Whether it explains what was seen better than the filter does, and no other sensor contradicts it."""
        return self.gain > DROP and self.against < AGAINST

    @property
    def suspects(self) -> tuple[str, ...]:
        """The sensor that was refused, unless others say that it is right: it may have jumped instead of the gyro."""
        return () if self.against < -DROP else (self.source,)

    def verdict(self, t_s: float, source: str, main: Outcome, patience_s: float) -> Verdict:
        """What is made of it after an observation of which this became in the filter."""
        old_s = t_s - self.since_s
        if source == self.source and main.used > 0:
            return Verdict.LEFT
        if self.is_likely and (not self.unheard or old_s >= patience_s):
            return Verdict.BELIEVED
        if self.against > DROP or old_s > LONGEST * patience_s:
            return Verdict.LEFT
        return Verdict.CARRIED


def jumped(before: Estimates, fares: Mapping[str, Fare], source: str, t_s: float, patience_s: float) -> Jump:
    """A copy of the estimates before an observation that is refused; fares: of the sensors then."""
    at = before.copied()
    for place, sigma in ((CHASER_ATTITUDE, START_RAD), (GYRO_BIAS, START_RAD_S)):
        own = np.arange(place.start, place.stop)
        at.covariance[:, own, own] += sigma * sigma
    lately = {name for name, fare in fares.items() if fare.last_used_s >= t_s - patience_s}
    return Jump(at, fares, source, t_s, frozenset(lately - {source}))


def _unlike(outcome: Outcome, groups: int) -> float:
    """Twice the negative logarithm of how likely an observation is, of which so many groups could be seen."""
    return min(outcome.nis, outcome.largest_credible) + DROP * (groups - outcome.groups)
