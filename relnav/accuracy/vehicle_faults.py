"""Ramps in each sensor of a vehicle, one at a time, and whether the filter that watches tells before the port is lost.

A ramp grows from nothing, for a minute, to RAMP_SIGMA times what is stated of one observation, noise and mounting
together, and stays: all spots of an image shift, the attitude of a star image turns, so does the direction to the sun,
and the gyro's bias grows. A run is silently wrong if at any second the port's position is off by more than its
protection level along an axis while no sensor is in alarm. That level is of a vehicle without faults; beside it stands
the one with a sensor at fault (`relnav.vehicle.separation`), beyond which the port may never be before the alarm.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from relnav.accuracy.faults import FALSE_ALARM_SHARE, SILENT_SHARE
from relnav.accuracy.rendezvous import true_port
from relnav.accuracy.statistics import wilson_bounds
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation import dcm_from_quaternion, quaternion_from_dcm
from relnav.geometry.rotation_vector import turned
from relnav.mission import Model as BeaconMission
from relnav.sensors.sun_direction import SunDirection
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import Observation, VehicleRun, simulate_rendezvous
from relnav.spacecraft import POINTS, Vehicle
from relnav.vehicle.navigator import VehicleNavigator

RAMP_SIGMA, RAMP_S, BEGINS_S = 5.0, 60.0, 30.0
FLIGHT = Rendezvous(start_m=10.0, final_m=1.0, fast_m_s=0.06, slow_m_s=0.06)
"""Two and a half minutes to a metre from contact."""
RUNS = 10


class Flown(NamedTuple):
    """What became of a run.

    Attributes
    ----------
    alarm_s : float
        When the first sensor came into alarm; NaN if none did.
    named : str
        Which.
    error : float
        Of the port's position at that time, largest along an axis, over its protection level; at the end without.
    silent : bool
        Whether it was beyond that level before, or without an alarm.
    one_fault : float
        The largest error until the alarm, over the protection level with one sensor at fault.
    """

    alarm_s: float
    named: str
    error: float
    silent: bool
    one_fault: float


def ramp_of(vehicle: Vehicle, name: str) -> float:
    """Full size of the ramp of a sensor: rad, of the gyro rad/s."""
    if name == "gyro":
        return RAMP_SIGMA * vehicle.gyro.bias_sigma_rad_s
    mounted, model = vehicle.sensor[name], vehicle.models[name]
    if vehicle.kind(name) == POINTS:
        beacons = isinstance(model, BeaconMission)
        spot = model.sensor.spot_noise_m if beacons else model.camera.spot_noise_px
        noise = spot / (model.sensor.focal_length_m if beacons else model.camera.focal_length_px[0])
    else:
        noise = max(mounted.noise_rad) if mounted.noise_rad is not None else 0.0
    return RAMP_SIGMA * math.hypot(noise, mounted.mount_sigma_rad)


def bent(vehicle: Vehicle, seen: Observation, name: str, size: float) -> Any:
    """What a sensor says that is off by `size` of its unit, if it is this sensor."""
    value, turn = seen.value, turned(np.eye(3), np.array([size, 0.0, 0.0]))
    if seen.sensor != name or size == 0.0:
        return value
    if isinstance(value, SunDirection):
        across = cross_matrix(value.direction) @ np.array([1.0, 0.0, 0.0])
        return replace(value, direction=turned(np.eye(3), size * across / np.linalg.norm(across)) @ value.direction)
    if name == "gyro":
        return value + np.array([size, 0.0, 0.0])
    if vehicle.kind(name) == POINTS:
        model = vehicle.models[name]
        focal = model.sensor.focal_length_m if isinstance(model, BeaconMission) else model.camera.focal_length_px[0]
        return value + np.array([focal * size, 0.0])
    return quaternion_from_dcm(turn @ dcm_from_quaternion(value))


def fly_ramp(run: VehicleRun, name: str) -> Flown:
    """A run with a ramp in one sensor; name "" flies it as it is."""
    vehicle = run.truth.vehicle
    nav, full = VehicleNavigator(vehicle, separation=True), ramp_of(vehicle, name) if name else 0.0
    second, silent, error, one_fault = 1.0, False, 0.0, 0.0
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        share = min(max((seen.t_s - BEGINS_S) / RAMP_S, 0.0), 1.0)
        nav.observe(seen.sensor, seen.t_s, bent(vehicle, seen, name, share * full))
        if not second <= seen.t_s < run.truth.end_s - 0.1:
            continue
        second, now = seen.t_s + 1.0, nav.state()
        off = np.abs(true_port(run, now.t_s)[0][:3] - now.port.position_m)
        error = float((off / now.port.protection_level_m()).max())
        one_fault = max(one_fault, float((off / now.protection_level_m()).max()))
        if now.alarms:
            return Flown(now.t_s, now.alarms[0], error, silent, one_fault)
        silent = silent or error > 1.0
    return Flown(math.nan, "", error, silent, one_fault)


@dataclass(frozen=True)
class RampRow:
    """Runs with a ramp in one sensor ("" = none).

    Attributes
    ----------
    sensor : str
    runs, alarmed, named, silent : int
        How many; with an alarm; of which the first is that sensor's; silently wrong.
    silent_low, silent_high : float
        95 % bounds of the silent share (Wilson).
    alarm_s : float
        Median time from the ramp's beginning to the alarm; NaN without one.
    error : float
        Largest error of the port then, or at the end of runs without an alarm, over its protection level.
    one_fault : float
        Largest error until then, over the protection level with one sensor at fault.
    """

    sensor: str
    runs: int
    alarmed: int
    named: int
    silent: int
    silent_low: float
    silent_high: float
    alarm_s: float
    error: float
    one_fault: float

    @property
    def ok(self) -> bool:
        """Whether the bars may hold: silence, or without a ramp false alarms, no more often than stated.

        And no error beyond the protection level with one sensor at fault.
        """
        if self.one_fault > 1.0:
            return False
        if self.sensor:
            return self.silent_low <= SILENT_SHARE
        return wilson_bounds(self.alarmed, self.runs)[0] <= FALSE_ALARM_SHARE


@dataclass(frozen=True)
class VehicleFaultsReport:
    """Ramps in each sensor of a vehicle."""

    model: str
    runs: int
    seed: int
    rows: tuple[RampRow, ...]

    @property
    def ok(self) -> bool:
        """Whether every row meets its bar."""
        return all(row.ok for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        rows = [asdict(row) | {"ok": row.ok} for row in self.rows]
        return {"model": self.model, "runs": self.runs, "seed": self.seed, "ok": self.ok, "rows": rows}

    def lines(self) -> list[str]:
        """For a reader."""
        way = f"from {FLIGHT.start_m:g} to {FLIGHT.final_m:g} m"
        out = [
            f"model {self.model}, {self.runs} runs {way} a row, seed {self.seed}",
            f"a ramp: within {RAMP_S:g} s to {RAMP_SIGMA:g} sigma of an observation, noise and mounting",
            "error / level: at the alarm, over the level without faults; one fault: until then, over that with one",
            "after: median, from its beginning; silent: the port off by more than its protection level, and no alarm",
            f"{'ramp in':<20}alarmed  naming it  after, s  error / level  one fault  silent  95 % bounds",
        ]
        for row in self.rows:
            after = "-" if math.isnan(row.alarm_s) else f"{row.alarm_s:.0f}"
            named = str(row.named) if row.sensor else "-"
            out.append(
                f"{row.sensor or 'nothing':<20}{row.alarmed:>7}{named:>11}{after:>10}{row.error:>15.2f}"
                f"{row.one_fault:>11.2f}{row.silent:>8}  {row.silent_low:.3f} .. {row.silent_high:.3f}"
                f"{'' if row.ok else '  BAR NOT MET'}"
            )
        out.append("every bar is met" if self.ok else "SOME BARS ARE NOT MET")
        return out


def cases(vehicle: Vehicle) -> list[str]:
    """Sensors with a ramp; "" = nothing is wrong."""
    return ["", "gyro", *vehicle.sensor]


def measure_faults(
    vehicle: Vehicle,
    *,
    runs: int = RUNS,
    seed: int = 7,
    progress: Callable[[int], None] | None = None,
    flight: Rendezvous = FLIGHT,
) -> VehicleFaultsReport:
    """Fly a vehicle with a ramp in each sensor in turn, and without: alarms, false ones, and silence.

    Hand-over is where the flight begins. progress: called with 1 a flight.
    """
    hand_over = replace(vehicle.hand_over, port_distance_m=(flight.start_m, 0.0, 0.0))
    near = replace(vehicle, hand_over=hand_over)
    flown: dict[str, list[Flown]] = {name: [] for name in cases(vehicle)}
    for k in range(runs):
        run = simulate_rendezvous(near, flight, seed=seed + k)
        for name, found in flown.items():
            found.append(fly_ramp(run, name))
            if progress is not None:
                progress(1)
    return VehicleFaultsReport(vehicle.name, runs, seed, tuple(_row(name, found) for name, found in flown.items()))


def _row(name: str, flown: list[Flown]) -> RampRow:
    told = [one for one in flown if not math.isnan(one.alarm_s)]
    silent = sum(one.silent for one in flown)
    low, high = wilson_bounds(silent, len(flown))
    return RampRow(
        sensor=name,
        runs=len(flown),
        alarmed=len(told),
        named=sum(one.named == name for one in told),
        silent=silent,
        silent_low=low,
        silent_high=high,
        alarm_s=float(np.median([one.alarm_s - BEGINS_S for one in told])) if told else math.nan,
        error=max(one.error for one in flown),
        one_fault=max(one.one_fault for one in flown),
    )
