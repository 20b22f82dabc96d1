"""A fault of one sensor of a vehicle or its thrusters at a time, and whether the estimate is ever wrong unsaid.

What goes wrong is in `relnav.simulation.vehicle_faults`. A run is silently wrong if at any second the port's position
is off by more than its protection level along an axis before any alarm. That level is of a vehicle without
faults; beside it stands the one with a sensor at fault (`relnav.vehicle.separation`), beyond which the port may never
be before the alarm. A sensor that is lost raises no alarm (`last_used_s` says so): at the end of the loss the port's
twelve errors have to lie within the ellipsoid of 3 sigma, and ten seconds later its position and attitude are known as
if nothing had been lost.
"""

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from relnav.accuracy.faults import FALSE_ALARM_SHARE, SILENT_SHARE
from relnav.accuracy.statistics import wilson_bounds
from relnav.accuracy.vehicle_fault_flights import (
    BACK_S,
    FLIGHT,
    LOST_FROM_M,
    ONE_IN,
    POSE,
    Flown,
    Runs,
    back_after_s,
    cases,
    fly_run,
    worse_later,
)
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import BEGINS_S, LASTS_S, RAMP_SIGMA, SIZED, VehicleFault
from relnav.spacecraft import Vehicle

RUNS = 10
INSIDE_SHARE = 0.99
"""In how many runs the port has to be in the ellipsoid of 3 sigma when a sensor returns."""
MISSED_SHARE = 2 / 200
"""In how many runs a ramp may raise no alarm: of fewer than a hundred, in none."""
HEAD = "alarmed  naming it  alone  after, s  error / level  one fault  silent  95 % bounds"


@dataclass(frozen=True)
class FaultRow:
    """Runs with a fault of one sensor ("" = none).

    Attributes
    ----------
    fault, sensor : str
    size : float
        Of the fault, one as it is stated; a smaller ramp may raise no alarm.
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
    size: float
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
        missed = self.runs - self.alarmed
        if self.fault == VehicleFault.RAMP.value and self.size >= 1.0 and missed > MISSED_SHARE * self.runs:
            return False
        if self.one_fault > 1.0 or self.inside_high < INSIDE_SHARE or self.pose_back_s > BACK_S:
            return False
        if self.sensor:
            return self.silent_low <= SILENT_SHARE
        return self.alarmed <= max(1.0, FALSE_ALARM_SHARE * self.runs)

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
    size: float
    rows: tuple[FaultRow, ...]

    @property
    def ok(self) -> bool:
        """Whether every row meets its goal."""
        return all(row.ok for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        rows = [asdict(row) | {"ok": row.ok} for row in self.rows]
        told = {"model": self.model, "runs": self.runs, "seed": self.seed, "size": self.size}
        return told | {"ok": self.ok, "rows": rows}

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
            "after: median, from its beginning; silent: the port beyond its protection level before any alarm",
            "inside: within 3 sigma when the sensor returns; pose, all: the longest until no sigma of position and",
            "attitude, and of all twelve, is a quarter larger than usual, s; later: the most times the usual one, from",
            f"{BACK_S:g} s on",
        ]
        if self.size != 1.0:
            out.append(f"EVERY FAULT {self.size:g} TIMES AS LARGE as is said here")
        fault = None
        for row in self.rows:
            if row.fault != fault:
                fault, lost = row.fault, "     inside  95 % bounds     pose  all  later" if row.inside >= 0 else ""
                out.append(f"{fault:<26}{HEAD}{lost}")
            out.append(row.line())
        out.append("every goal is met" if self.ok else "SOME GOALS ARE NOT MET")
        return out


def measure_faults(
    vehicle: Vehicle,
    *,
    runs: int = RUNS,
    seed: int = 7,
    progress: Callable[[int], None] | None = None,
    flight: Rendezvous = FLIGHT,
    only: Collection[str] | None = None,
    size: float = 1.0,
    fly_all: Callable[[Callable[[int], Runs], Iterable[int]], Iterable[Runs]] = map,
) -> VehicleFaultsReport:
    """Fly a vehicle with each fault of each sensor in turn, and without: alarms, false ones, silence, losses.

    progress: called with the number of cases, once a run; only: faults of these alone, "" where nothing is wrong; size:
    of those that have one (`SIZED`), which are flown alone unless it is one; fly_all: how runs are flown, one after the
    other if left out.
    """
    done = list[Runs]()
    chosen = [(fault, name) for fault, name in cases(vehicle) if only is None or name in only]
    if size != 1.0:
        chosen = [(fault, name) for fault, name in chosen if fault in SIZED]
    for flown in fly_all(partial(fly_run, vehicle, flight, seed, size, chosen), range(runs)):
        done.append(flown)
        if progress is not None:
            progress(len(chosen))
    done.sort(key=lambda flown: flown[0])
    pairs = {case: [(by_case[case], usual) for _, by_case, usual in done if case in by_case] for case in chosen}
    rows = tuple(_row(*case, size, pairs[case]) for case in chosen)
    return VehicleFaultsReport(vehicle.name, runs, seed, size, rows)


def _row(fault: VehicleFault, name: str, size: float, pairs: list[tuple[Flown, Flown]]) -> FaultRow:
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
        size=size,
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
