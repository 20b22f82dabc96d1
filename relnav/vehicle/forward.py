"""A flight of which all is known, filtered in order of time: the bits of `VehicleNavigator`, without its way back."""

import math
from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from relnav.arrays import Matrix
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.replay import Event


def estimates_at(
    filters: VehicleFilters, samples: Matrix, events: Iterable[Event | None], times_s: Sequence[float]
) -> Iterator[VehicleEstimate]:
    """The estimates at rising times, from all that is not later than each; their `final_before_s` is infinite.

    samples: the gyro's (m, 4), t s and rate, rising and none twice. events: of everything else, from the start on, as
    `VehicleFilters.event` gives them, none twice.
    """
    filters.samples.fill(samples)
    left = sorted((event for event in events if event is not None), key=attrgetter("key"), reverse=True)
    tracked = filters.start
    for t_s in times_s:
        while left and left[-1].t_s <= t_s:
            tracked, _ = filters.apply(tracked, left.pop())
        yield filters.estimate(tracked, t_s, math.inf)
