"""How each sensor fares: when it was believed last, and whether what it says agrees with what is believed of it."""

from dataclasses import dataclass
from math import isnan, nan
from typing import NamedTuple

from relnav.vehicle.monitor import ALARM_SIGMA, Sums
from relnav.vehicle.points import LEAST_LIGHTS
from relnav.vehicle.update import Outcome

REFUSED = 10
"""Observations in a row of which nothing is believed that are an alarm.

With a reflection in every fourth image so many in a row happen once in a million times, as seldom as a test of the
monitor is in alarm by chance. The gate alone refuses a good one in ten thousand.
"""


@dataclass(frozen=True)
class SensorHealth:
    """How a sensor fares.

    Attributes
    ----------
    last_used_s : float
        When something of it was believed last; NaN if never.
    refused : int
        Observations in a row of which nothing was, those included that cannot be of its lights at all.
    nis_ratio : float
        NIS over its degrees of freedom, before the gate, faded over some ten observations; NaN before the first. One in
        the mean; where errors are considered, innovations hang together and it wanders, to three and more.
    deviation : float
        How far the squared innovations of the last ten seconds lie above what is expected, 1-sigma, in the filter that
        watches; NaN without one, before the first observation, and while little is known of the start: the chaser's
        attitude, where nothing measures it well, stays so.
    """

    last_used_s: float = nan
    refused: int = 0
    nis_ratio: float = nan
    deviation: float = nan

    @property
    def alarm(self) -> bool:
        """Whether what it says does not agree, or no longer, with what is believed of it.

        By `relnav.vehicle.monitor`, or for it is `shut_out`. The sensor that it contradicts may be the one at fault:
        `VehicleEstimate.alarms` names what may be.
        """
        return self.deviation > ALARM_SIGMA or self.shut_out

    @property
    def shut_out(self) -> bool:
        """Whether nothing of it was believed `REFUSED` times in a row, from the first observation on or later."""
        return self.refused >= REFUSED


class Fare(NamedTuple):
    """How a sensor fares in the filter, and its sums in the one that watches.

    Attributes
    ----------
    sums : Sums
    last_used_s, refused, nis_ratio
        As of `SensorHealth`.
    agreed_s : float
        When more than half of an observation was believed last; NaN if never.
    doubted : int
        Images of LEAST_LIGHTS or more since then, of which half or less was.
    """

    sums: Sums
    last_used_s: float = nan
    refused: int = 0
    nis_ratio: float = nan
    agreed_s: float = nan
    doubted: int = 0

    def after(self, t_s: float, outcomes: list[Outcome], *, misplaced: bool = False) -> "Fare":
        """The same after another observation: what became of it in the filter, and in the one that watches.

        misplaced: something was seen, so that without any group it was where nothing can be.
        """
        nis, dof, groups, used, *_ = outcomes[0]
        sums, last_used_s, refused, mean, agreed_s, doubted = self
        for watched in outcomes[1:2]:
            if watched.groups > 0 and not watched.wide:  # while the start is wide it tells nothing
                sums = sums.after(t_s, min(watched.nis, watched.largest_credible), watched.dof)
        if groups == 0:
            return Fare(sums, last_used_s, refused + misplaced, mean, agreed_s, doubted)
        mean = nis / dof if isnan(mean) else 0.9 * mean + 0.1 * nis / dof
        if 2 * used > groups:
            return Fare(sums, t_s, 0, mean, t_s, 0)
        doubted += groups >= LEAST_LIGHTS
        if used:
            return Fare(sums, t_s, 0, mean, agreed_s, doubted)
        return Fare(sums, last_used_s, refused + 1, mean, agreed_s, doubted)

    @property
    def health(self) -> SensorHealth:
        """What is told of it."""
        return SensorHealth(self.last_used_s, self.refused, self.nis_ratio, self.sums.deviation)
