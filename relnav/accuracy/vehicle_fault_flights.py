"""Flights of a vehicle with one fault at a time: what became of the port's error, and what an alarm named.

What goes wrong is in `relnav.simulation.vehicle_faults`; what it may come to, in `vehicle_faults`.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from relnav.accuracy.rendezvous import checkpoint, true_port
from relnav.arrays import Vector
from relnav.estimation.consistency import nees
from relnav.estimation.gating import gate_limits
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import BEGINS_S, LASTS_S, OF_THRUSTERS, VehicleFault, with_fault
from relnav.simulation.vehicle_sensors import VehicleRun, simulate_rendezvous
from relnav.spacecraft import GYRO, POINTS, THRUST, Vehicle
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.navigator import VehicleNavigator

FLIGHT = Rendezvous(start_m=10.0, final_m=1.0, fast_m_s=0.06, slow_m_s=0.06)
"""Two and a half minutes to a metre from contact."""
LOST_FROM_M = (FLIGHT.start_m, 30.0, 7.6)
"""Where the flights begin in which a sensor is lost, in turn: at the last the loss ends at 2.2 m."""
WITHIN = 0.9973
"""Probability of the ellipsoid of 3 sigma."""
BACK_S, BACK_SHARE = 10.0, 1.25
"""After a loss: how long position and attitude may take until no sigma is more than this many times that without it.

Velocities are told beside it, without a goal: what a minute of images says of a slow closing rate takes long to learn.
"""
POSE = (0, 1, 2, 6, 7, 8)
"""Position and attitude among the port's twelve."""
RETURNS_S = round(BEGINS_S + LASTS_S)
ONE_IN = dict.fromkeys(VehicleFault, 1) | {VehicleFault.LATE: 20}
"""Runs of which one is flown: late images end in the bits of images in time, for twenty times the computing."""
NOTHING_FALSE = (VehicleFault.LOST, VehicleFault.LATE)
"""Nothing false is said: filters without a sensor have nothing to tell."""
TO_THE_END = (VehicleFault.NOTHING, VehicleFault.LOST)
"""Flown on after an alarm."""

Case: TypeAlias = tuple[VehicleFault, str]
"""What goes wrong, and with which sensor."""


class Flown(NamedTuple):
    """What became of a run.

    Attributes
    ----------
    alarm_s : float
        When the first sensor came into alarm; NaN if none did.
    named : tuple of str
        What was named then as what may be at fault, the most likely first.
    error : float
        Of the port's position at that time, largest along an axis, over its protection level; at the end without.
    silent : bool
        Whether it was beyond that level before, or without an alarm.
    one_fault : float
        The largest error until the alarm, over the protection level with one sensor at fault; NaN without that level.
    inside : bool
        Whether the port's twelve errors were within the ellipsoid of 3 sigma when a lost sensor returns.
    sigma : dict
        Of the port's twelve, by the second from then on.
    """

    alarm_s: float
    named: tuple[str, ...]
    error: float
    silent: bool
    one_fault: float
    inside: bool
    sigma: dict[int, Vector]


Runs: TypeAlias = tuple[int, dict[Case, Flown], Flown]
"""A run by number, case by case, and what a loss of it is compared with."""


def fly_fault(
    run: VehicleRun, fault: VehicleFault, name: str, seed: int = 0, *, separation: bool = True, size: float = 1.0
) -> Flown:
    """A run with a fault of one sensor, until the first alarm; where nothing is wrong or a sensor lost, to its end.

    separation: whether the level with one sensor at fault is looked at, for some three times the computing; size: of
    the fault, as of `with_fault`.
    """
    nav = VehicleNavigator(run.truth.vehicle, separation=separation)
    told = Flown(math.nan, (), 0.0, False, 0.0 if separation else math.nan, True, {})
    second = 1
    for seen in with_fault(run, fault, name, np.random.default_rng(seed), size=size):
        nav.observe(seen.sensor, seen.t_s, seen.value)
        if not second <= nav.newest_s < run.truth.end_s - 0.1:
            continue
        told = _after_second(run, told, nav.state(float(second)), second)
        if told.named and fault not in TO_THE_END:
            return told
        second += 1
    return told


def _after_second(run: VehicleRun, told: Flown, now: VehicleEstimate, second: int) -> Flown:
    """What is told of a run until one estimate later."""
    if second >= RETURNS_S:
        told.sigma[second] = now.port.sigma
    if second == RETURNS_S:
        point = checkpoint(run, now)
        off = float(nees(point.port_error[None], point.port_covariance[None])[0])
        told = told._replace(inside=bool(off <= gate_limits(WITHIN, 12)[-1]))
    if told.named or now.ambiguous:  # what is ambiguous says itself that it is not to be used
        return told
    missed = np.abs(true_port(run, now.t_s)[0][:3] - now.port.position_m)
    error, one_fault = float((missed / now.port.protection_level_m()).max()), told.one_fault
    if now.without:
        one_fault = max(one_fault, float((missed / now.protection_level_m()).max()))
    if now.alarms:
        return told._replace(alarm_s=now.t_s, named=now.alarms, error=error, one_fault=one_fault)
    return told._replace(error=error, one_fault=one_fault, silent=told.silent or error > 1.0)


def back_after_s(lost: Flown, usual: Flown, of: Sequence[int] = range(12)) -> float:
    """How long after a sensor returned no sigma of the port is above `BACK_SHARE` times that of the usual flight, s.

    of: which of the port's twelve.
    """
    worse = [s for s, sigma in lost.sigma.items() if (sigma > BACK_SHARE * usual.sigma[s])[[*of]].any()]
    return float(max(worse, default=RETURNS_S - 1) + 1 - RETURNS_S)


def worse_later(lost: Flown, usual: Flown) -> float:
    """The largest sigma of the port over that of the usual flight, from `BACK_S` after a sensor returned on."""
    later = [float((sigma / usual.sigma[s]).max()) for s, sigma in lost.sigma.items() if s >= RETURNS_S + BACK_S]
    return max(later, default=math.nan)


def cases(vehicle: Vehicle) -> list[Case]:
    """Every fault with each sensor, or the thrusters, that can have it; first nothing is wrong, the sensor ""."""
    lights = [name for name in vehicle.sensor if vehicle.kind(name) == POINTS]
    return [
        (VehicleFault.NOTHING, ""),
        *((fault, name) for fault in (VehicleFault.RAMP, VehicleFault.LOST) for name in (GYRO, *vehicle.sensor)),
        *((VehicleFault.GLINT, name) for name in lights),
        *((VehicleFault.CLOCK, name) for name in vehicle.sensor),
        *((VehicleFault.LATE, name) for name in lights),
        *((fault, THRUST) for fault in OF_THRUSTERS),
    ]


def lost_flight(flight: Rendezvous, k: int) -> Rendezvous:
    """The flight of run k in which sensors are lost: long enough for them to be back, and no longer if it is far."""
    start_m = LOST_FROM_M[k % len(LOST_FROM_M)]
    if start_m <= flight.start_m:
        return replace(flight, start_m=start_m)
    return replace(flight, start_m=start_m, final_m=start_m - (RETURNS_S + 3.0 * BACK_S) * flight.fast_m_s)


def fly_run(vehicle: Vehicle, flight: Rendezvous, seed: int, size: float, chosen: Collection[Case], k: int) -> Runs:
    """Run k with every fault chosen, and the flight without any where sensors are lost.

    Hand-over is where a flight begins.
    """

    def simulated(way: Rendezvous) -> VehicleRun:
        hand_over = replace(vehicle.hand_over, port_distance_m=(way.start_m, 0.0, 0.0))
        return simulate_rendezvous(replace(vehicle, hand_over=hand_over), way, seed=seed + k)

    run, losing = simulated(flight), lost_flight(flight, k)
    lost = run if losing == flight else simulated(losing)
    usual = fly_fault(lost, VehicleFault.NOTHING, "", separation=False)
    flown: dict[Case, Flown] = {}
    for fault, name in chosen:
        if k % ONE_IN[fault] == 0:
            way = lost if fault == VehicleFault.LOST else run
            flown[fault, name] = fly_fault(way, fault, name, seed + k, separation=fault not in NOTHING_FALSE, size=size)
    return k, flown, usual
