"""A fault of one sensor of a vehicle or its thrusters at a time, and whether the estimate is ever wrong unsaid.

What goes wrong is in `relnav.simulation.vehicle_faults`. A run is silently wrong if at any second the port's position
is off by more than its protection level along an axis while no sensor is in alarm. That level is of a vehicle without
faults; beside it stands the one with a sensor at fault (`relnav.vehicle.separation`), beyond which the port may never
be before the alarm. A sensor that is lost raises no alarm (`last_used_s` says so): at the end of the loss the port's
twelve errors have to lie within the ellipsoid of 3 sigma, and ten seconds later the port is known as if nothing had
been lost.
"""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from relnav.accuracy.faults import FALSE_ALARM_SHARE, SILENT_SHARE
from relnav.accuracy.rendezvous import checkpoint, true_port
from relnav.accuracy.statistics import wilson_bounds
from relnav.arrays import Vector
from relnav.estimation.consistency import nees
from relnav.estimation.gating import gate_limits
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import BEGINS_S, LASTS_S, OF_THRUSTERS, RAMP_SIGMA, VehicleFault, with_fault
from relnav.simulation.vehicle_sensors import VehicleRun, simulate_rendezvous
from relnav.spacecraft import GYRO, POINTS, THRUST, Vehicle
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.navigator import VehicleNavigator

FLIGHT = Rendezvous(start_m=10.0, final_m=1.0, fast_m_s=0.06, slow_m_s=0.06)
"""Two and a half minutes to a metre from contact."""
LOST_FROM_M = (FLIGHT.start_m, 30.0, 7.6)
"""Where the flights begin in which a sensor is lost, in turn: at the last the loss ends at 2.2 m."""
RUNS = 10
WITHIN, INSIDE_SHARE = 0.9973, 0.99
"""Probability of the ellipsoid of 3 sigma, and in how many runs the port has to be in it when a sensor returns."""
BACK_S, BACK_SHARE = 10.0, 1.25
"""How long position and attitude may take then until no sigma is more than this many times that without a loss.

Velocities are told beside it, without a goal: what a minute of images says of a slow closing rate takes long to learn.
"""
POSE = (0, 1, 2, 6, 7, 8)
"""Position and attitude among the port's twelve."""
RETURNS_S = round(BEGINS_S + LASTS_S)
ONE_IN = dict.fromkeys(VehicleFault, 1) | {VehicleFault.LATE: 20}
"""Runs of which one is flown: late images end in the bits of images in time, for twenty times the computing."""
NOTHING_FALSE = (VehicleFault.LOST, VehicleFault.LATE)
"""Nothing false is said: filters without a sensor have nothing to tell."""
MISSED_SHARE = 2 / 200
"""In how many runs a ramp may raise no alarm."""
TO_THE_END = (VehicleFault.NOTHING, VehicleFault.LOST)
"""Flown on after an alarm."""


HEAD = "alarmed  naming it  alone  after, s  error / level  one fault  silent  95 % bounds"


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


def fly_fault(run: VehicleRun, fault: VehicleFault, name: str, seed: int = 0, *, separation: bool = True) -> Flown:
    """A run with a fault of one sensor, until the first alarm; where nothing is wrong or a sensor lost, to its end.

    separation: whether the level with one sensor at fault is looked at, for some three times the computing.
    """
    nav = VehicleNavigator(run.truth.vehicle, separation=separation)
    told = Flown(math.nan, (), 0.0, False, 0.0 if separation else math.nan, True, {})
    second = 1
    for seen in with_fault(run, fault, name, np.random.default_rng(seed)):
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


@dataclass(frozen=True)
class FaultRow:
    """Runs with a fault of one sensor ("" = none).

    Attributes
    ----------
    fault, sensor : str
    runs, alarmed, named, alone, silent : int
        How many; with an alarm; of which the first names what is at fault, and nothing else; silently wrong.
    silent_low, silent_high : float
        95 % bounds of the silent share (Wilson).
    alarm_s : float
        Median time from the fault's beginning to the alarm; NaN without one.
    error : float
        Largest error of the port then, or at the end of runs without an alarm, over its protection level.
    one_fault : float
        Largest error until then, over the protection level with one sensor at fault; NaN where nothing false is said.
    inside : int
        Of a loss: runs within the ellipsoid of 3 sigma at its end; -1 of other faults.
    inside_low, inside_high : float
        95 % bounds of their share (Wilson); NaN of other faults.
    pose_back_s, back_s : float
        The longest that the port's sigmas took to be about as usual again, those of position and attitude, and all; NaN
        of other faults.
    later : float
        The largest of them over the usual one, from ten seconds after the return on; NaN of other faults.
    """

    fault: str
    sensor: str
    runs: int
    alarmed: int
    named: int
    alone: int
    silent: int
    silent_low: float
    silent_high: float
    alarm_s: float
    error: float
    one_fault: float
    inside: int
    inside_low: float
    inside_high: float
    pose_back_s: float
    back_s: float
    later: float

    @property
    def ok(self) -> bool:
        """Whether the bars may hold.

        Silence, ramps without an alarm, or without a fault false alarms, no more often than stated, and no error beyond
        the protection level with one sensor at fault; after a loss inside and back as well.
        """
        missed_low, _ = wilson_bounds(self.runs - self.alarmed, self.runs)
        if self.fault == VehicleFault.RAMP.value and missed_low > MISSED_SHARE:
            return False
        if self.one_fault > 1.0 or self.inside_high < INSIDE_SHARE or self.pose_back_s > BACK_S:
            return False
        if self.sensor:
            return self.silent_low <= SILENT_SHARE
        return wilson_bounds(self.alarmed, self.runs)[0] <= FALSE_ALARM_SHARE

    def line(self) -> str:
        """For a reader."""

        def told(value: float, form: str) -> str:
            return "-" if math.isnan(value) else format(value, form)

        lost = self.inside >= 0
        inside = (
            f"{self.inside:>8}  {self.inside_low:.3f} .. {self.inside_high:.3f}{self.pose_back_s:>6.0f}"
            f"{self.back_s:>5.0f}{self.later:>7.2f}"
            if lost
            else ""
        )
        named = f"{self.named:>11}{self.alone:>7}" if self.sensor else f"{'-':>11}{'-':>7}"
        return (
            f"  {self.sensor or 'nothing is wrong':<24}{self.alarmed:>7}{named}"
            f"{told(self.alarm_s, '.0f'):>10}{self.error:>15.2f}{told(self.one_fault, '.2f'):>11}"
            f"{self.silent:>8}  {self.silent_low:.3f} .. {self.silent_high:.3f}{inside}".rstrip()
            + ("" if self.ok else "  GOAL NOT MET")
        )


@dataclass(frozen=True)
class VehicleFaultsReport:
    """Faults of each sensor of a vehicle."""

    model: str
    runs: int
    seed: int
    rows: tuple[FaultRow, ...]

    @property
    def ok(self) -> bool:
        """Whether every row meets its goal."""
        return all(row.ok for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        rows = [asdict(row) | {"ok": row.ok} for row in self.rows]
        return {"model": self.model, "runs": self.runs, "seed": self.seed, "ok": self.ok, "rows": rows}

    def lines(self) -> list[str]:
        """For a reader."""
        way = f"from {FLIGHT.start_m:g} to {FLIGHT.final_m:g} m"
        out = [
            f"model {self.model}, {self.runs} runs {way} a row, seed {self.seed}; faults begin at {BEGINS_S:g} s",
            f"a ramp: within {LASTS_S:g} s to {RAMP_SIGMA:g} sigma of an observation, noise and mounting",
            f"late images in every {ONE_IN[VehicleFault.LATE]}th run alone; losses in flights from "
            + ", ".join(f"{start_m:g}" for start_m in LOST_FROM_M)
            + " m in turn",
            "error / level: at the alarm, over the level without faults; one fault: until then, over that with one",
            "of thrusters: from then on, direction drawn once a run",
            "naming it, alone: the first alarm has it among what may be at fault, and has nothing else",
            "after: median, from its beginning; silent: the port off by more than its protection level, and no alarm",
            "inside: within 3 sigma when the sensor returns; pose, all: the longest until no sigma of position and",
            "attitude, and of all twelve, is a quarter larger than usual, s; later: the most times the usual one, from",
            f"{BACK_S:g} s on",
        ]
        fault = None
        for row in self.rows:
            if row.fault != fault:
                fault, lost = row.fault, "     inside  95 % bounds     pose  all  later" if row.inside >= 0 else ""
                out.append(f"{fault:<26}{HEAD}{lost}")
            out.append(row.line())
        out.append("every goal is met" if self.ok else "SOME GOALS ARE NOT MET")
        return out


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


def fly_run(vehicle: Vehicle, flight: Rendezvous, seed: int, chosen: Collection[Case], k: int) -> Runs:
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
            flown[fault, name] = fly_fault(way, fault, name, seed + k, separation=fault not in NOTHING_FALSE)
    return k, flown, usual


def measure_faults(
    vehicle: Vehicle,
    *,
    runs: int = RUNS,
    seed: int = 7,
    progress: Callable[[int], None] | None = None,
    flight: Rendezvous = FLIGHT,
    only: Collection[str] | None = None,
    fly_all: Callable[[Callable[[int], Runs], Iterable[int]], Iterable[Runs]] = map,
) -> VehicleFaultsReport:
    """Fly a vehicle with each fault of each sensor in turn, and without: alarms, false ones, silence, losses.

    progress: called with the number of cases, once a run; only: faults of these alone, "" where nothing is wrong;
    fly_all: how runs are flown, one after the other if left out.
    """
    done = list[Runs]()
    chosen = [(fault, name) for fault, name in cases(vehicle) if only is None or name in only]
    for flown in fly_all(partial(fly_run, vehicle, flight, seed, chosen), range(runs)):
        done.append(flown)
        if progress is not None:
            progress(len(chosen))
    done.sort(key=lambda flown: flown[0])
    rows = [_row(*case, [(by_case[case], usual) for _, by_case, usual in done if case in by_case]) for case in chosen]
    return VehicleFaultsReport(vehicle.name, runs, seed, tuple(rows))


def _row(fault: VehicleFault, name: str, pairs: list[tuple[Flown, Flown]]) -> FaultRow:
    """Of flights with a fault, each beside one without."""
    flown = [one for one, _ in pairs]
    told, lost = [one for one in flown if one.named], fault == VehicleFault.LOST
    silent, inside = sum(one.silent for one in flown), sum(one.inside for one in flown)
    low, high = wilson_bounds(silent, len(flown))
    inside_low, inside_high = wilson_bounds(inside, len(flown)) if lost else (math.nan, math.nan)
    began_s = 0.0 if fault == VehicleFault.GLINT else BEGINS_S
    return FaultRow(
        fault=fault.value,
        sensor=name,
        runs=len(flown),
        alarmed=len(told),
        named=sum(name in one.named for one in told),
        alone=sum(one.named == (name,) for one in told),
        silent=silent,
        silent_low=low,
        silent_high=high,
        alarm_s=float(np.median([one.alarm_s - began_s for one in told])) if told else math.nan,
        error=max(one.error for one in flown),
        one_fault=max(one.one_fault for one in flown),
        inside=inside if lost else -1,
        inside_low=inside_low,
        inside_high=inside_high,
        pose_back_s=max(back_after_s(*pair, POSE) for pair in pairs) if lost else math.nan,
        back_s=max(back_after_s(*pair) for pair in pairs) if lost else math.nan,
        later=max(worse_later(*pair) for pair in pairs) if lost else math.nan,
    )
