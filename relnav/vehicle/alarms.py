"""What may be at fault, and since when: alarms of the moment, those that hold, and when each was raised.

An alarm of the moment that ends does not say that its fault is over. The filter that watches estimates every error that
lasts, a part of a fault as well, so that innovations become white again while the fault and the wrong estimate stay.
Nothing it knows tells the one from the other. So an alarm holds for a while, and what was ever raised is remembered.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from relnav.vehicle.drifts import Drifts
from relnav.vehicle.health import SensorHealth
from relnav.vehicle.monitor import ALARM_SIGMA

HOLDS_S = 60.0
"""How long an alarm holds after it was raised last.

With a camera's clock off by a quarter of a second no second is then unsaid in which the port is beyond its protection
level; without it, one in eight is (`benchmarks/vehicle_after_alarm.py`).
"""
ASKED_EVERY_S = 2.0
"""Between times at which alarms are noted: at every event it would take longer than the filter; few end sooner."""


def contradicting(drifts: Drifts, sensors: Mapping[str, SensorHealth]) -> tuple[str, ...]:
    """What may be at fault by what was seen last, the most likely first.

    Sensors, "gyro" and "thrust" of which one drifts (`relnav.vehicle.drifts`). Where no drift explains it, sensors that
    contradict the others, the furthest off first. Then those of which nothing is believed (`SensorHealth.shut_out`): no
    test of innovations sees them.
    """
    off = {name: health.deviation for name, health in sensors.items() if health.deviation > ALARM_SIGMA}
    shut_out = [name for name, health in sensors.items() if health.shut_out]
    return tuple(dict.fromkeys([*(drifts.suspects or sorted(off, key=lambda name: -off[name])), *shut_out]))


class AlarmMemory(NamedTuple):
    """When alarms were raised, asked at the first event of every `ASKED_EVERY_S`.

    Attributes
    ----------
    first_s, last_s : mapping
        Of each that ever was, by name: when it was raised first, and last.
    holds_from_s : float
        What was raised until then does not hold: the target was looked for.
    asked_s : float
        When they were asked last.
    """

    first_s: Mapping[str, float] = {}
    last_s: Mapping[str, float] = {}
    holds_from_s: float = -math.inf
    asked_s: float = -math.inf

    def is_due(self, t_s: float) -> bool:
        """Whether an event of t_s is the first of its interval."""
        return self.asked_s < ASKED_EVERY_S * math.floor(t_s / ASKED_EVERY_S)

    def noted(self, t_s: float, names: tuple[str, ...]) -> "AlarmMemory":
        """The same, asked at t_s, when these are raised."""
        raised = dict.fromkeys(names, t_s)
        return AlarmMemory({**raised, **self.first_s}, {**self.last_s, **raised}, self.holds_from_s, t_s)

    def held(self, t_s: float) -> tuple[str, ...]:
        """What still holds at t_s, the last raised first."""
        held = {name: at_s for name, at_s in self.last_s.items() if at_s >= t_s - HOLDS_S and at_s > self.holds_from_s}
        return tuple(sorted(held, key=lambda name: -held[name]))
