"""A vehicle's filter that is locked out, against truth: when it looks for the target anew, and what it then knows.

What goes wrong goes wrong for all lights at once, so that no sensor is left to hold on to.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from relnav.accuracy.rendezvous import checkpoint
from relnav.arrays import Vector
from relnav.estimation.consistency import nees
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import bent
from relnav.simulation.vehicle_sensors import VehicleRun, simulate_rendezvous
from relnav.spacecraft import POINTS, Vehicle
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.navigator import VehicleNavigator

FLIGHT = Rendezvous(start_m=10.0, final_m=5.0, fast_m_s=0.06)
"""A minute and a half."""
BEGINS_S, LASTS_S = 20.0, 20.0
OFF_M, JUMP_S, TURN_RAD = 5.0, 60.0, 0.02
LATER_S = 10


class LockOut(StrEnum):
    """What goes wrong; the word is what reports say."""

    HAND_OVER = "hand-over 5 m off"
    CLOCK = "all clocks jump by 60 s"
    LIE = "all lights off by 20 mrad for 20 s"


@dataclass(frozen=True)
class Restarted:
    """What became of a run.

    Attributes
    ----------
    restarts : int
        Searches that began.
    back_s : float
        From the fault's beginning, of a lie its end, until the estimate was right and usable for good; NaN if never.
    unsaid_s : int
        Seconds of it in which the port was off by more than its protection level, and nothing said so.
    nees_back, nees_later : float
        Of the port's twelve errors at the end of it and LATER_S after; NaN if never.
    """

    restarts: int
    back_s: float
    unsaid_s: int
    nees_back: float
    nees_later: float


def fly_lockout(vehicle: Vehicle, kind: LockOut, seed: int) -> Restarted:
    """An approach in which all lights go wrong at once."""
    hand_over = replace(vehicle.hand_over, port_distance_m=(FLIGHT.start_m, 0.0, 0.0))
    run = simulate_rendezvous(replace(vehicle, hand_over=hand_over), FLIGHT, seed=seed)
    nav = VehicleNavigator(run.truth.vehicle, position_m=_start(run, kind, seed))
    over_s = 0 if kind == LockOut.HAND_OVER else round(BEGINS_S + (LASTS_S if kind == LockOut.LIE else 0.0))
    unusable, unsaid, off = over_s, 0, dict[int, float]()
    for second, now in _every_second(run, nav, kind):
        if second <= over_s:
            continue
        point = checkpoint(run, replace(now, t_s=float(second)))
        wrong = bool((np.abs(point.port_error[:3]) > now.port.protection_level_m()).any())
        if wrong or now.ambiguous or now.alarms:
            unusable = second
            unsaid += not (now.ambiguous or now.alarms)
        off[second] = float(nees(point.port_error[None], point.port_covariance[None])[0])
    back = unusable + 1
    back_s = float(back - over_s) if back in off else math.nan
    return Restarted(nav.state().restarts, back_s, unsaid, off.get(back, math.nan), off.get(back + LATER_S, math.nan))


def _start(run: VehicleRun, kind: LockOut, seed: int) -> Vector:
    """Where the filter is told that the chaser is, (3,)."""
    place = np.array(run.truth.vehicle.start_position_m)
    if kind != LockOut.HAND_OVER:
        return place
    way = np.random.default_rng([seed, 5]).standard_normal(3)
    return place + OFF_M * way / np.linalg.norm(way)


def _every_second(run: VehicleRun, nav: VehicleNavigator, kind: LockOut) -> Iterator[tuple[int, VehicleEstimate]]:
    """The true second, and the estimate after it."""
    vehicle, second = run.truth.vehicle, 1
    lights = [name for name in vehicle.sensor if vehicle.kind(name) == POINTS]
    for seen in run.observations:
        late_s = JUMP_S if kind == LockOut.CLOCK and seen.t_s > BEGINS_S else 0.0
        lied = kind == LockOut.LIE and BEGINS_S < seen.t_s <= BEGINS_S + LASTS_S and seen.sensor in lights
        nav.observe(seen.sensor, seen.t_s + late_s, bent(vehicle, seen, seen.sensor, TURN_RAD) if lied else seen.value)
        if seen.t_s >= second:
            yield second, nav.state(second + late_s)
            second += 1
