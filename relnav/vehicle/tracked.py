"""All that a vehicle's filters carry from one event to the next."""

from collections.abc import Callable, Mapping
from math import inf
from typing import NamedTuple

from relnav.vehicle.acquisition import Search
from relnav.vehicle.alarms import AlarmMemory
from relnav.vehicle.attitude_jump import Jump
from relnav.vehicle.health import Fare
from relnav.vehicle.state import Estimates
from relnav.vehicle.trial import Trial


class Tracked(NamedTuple):
    """Estimates, how each sensor has fared until then, the search of which they are the best, if it is not over.

    And how many searches there were after a lock-out, the trial of the first image, if it is not over, the alarms, the
    hypothesis that the attitude jumped, if there is one, until when there is no other, and how many were believed.
    """

    estimates: Estimates
    fares: Mapping[str, Fare]
    search: Search | None = None
    restarts: int = 0
    trial: Trial | None = None
    alarms: AlarmMemory = AlarmMemory()
    jump: Jump | None = None
    settled_s: float = -inf
    jumps: int = 0

    @property
    def is_tried(self) -> bool:
        """Whether an image is on trial."""
        return self.trial is not None and self.trial.image is not None

    def moved(self, move: Callable[[Estimates], Estimates]) -> "Tracked":
        """The same with all estimates moved."""
        if self.search is None:
            trial = None if self.trial is None else self.trial._replace(blind=move(self.trial.blind))
            jump = None if self.jump is None else self.jump.moved(move)
            return self._replace(estimates=move(self.estimates), trial=trial, jump=jump)
        search = self.search.moved(move)
        return self._replace(estimates=search.estimates, search=search)
