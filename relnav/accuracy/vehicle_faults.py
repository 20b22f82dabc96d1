"""Ramps in each sensor of a vehicle, one at a time, and whether the filter that watches tells before the port is lost.

A ramp grows from nothing, for a minute, to RAMP_SIGMA times what is stated of one observation, noise and mounting
together, and stays: all spots of an image shift, the attitude of a star image turns, so does the direction to the sun,
and the gyro's bias grows. A run is silently wrong if at any second the port's position is off by more than its
protection level along an axis while no sensor is in alarm.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from relnav.accuracy.claims import ClaimRow, ClaimsReport, information
from relnav.accuracy.rendezvous import true_port
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
MOST_SILENT = 0.02


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
    """

    alarm_s: float
    named: str
    error: float
    silent: bool


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
    nav, full = VehicleNavigator(vehicle), ramp_of(vehicle, name) if name else 0.0
    second, silent, error = 1.0, False, 0.0
    for seen in sorted(run.observations, key=lambda observation: observation.t_s):
        share = min(max((seen.t_s - BEGINS_S) / RAMP_S, 0.0), 1.0)
        nav.observe(seen.sensor, seen.t_s, bent(vehicle, seen, name, share * full))
        if not second <= seen.t_s < run.truth.end_s - 0.1:
            continue
        second, now = seen.t_s + 1.0, nav.state()
        off = true_port(run, now.t_s)[0][:3] - now.port.position_m
        error = float(np.abs(off / now.port.protection_level_m()).max())
        if now.alarms:
            return Flown(now.t_s, now.alarms[0], error, silent)
        silent = silent or error > 1.0
    return Flown(math.nan, "", error, silent)


def _rows(name: str, flown: list[Flown]) -> list[ClaimRow]:
    from scipy.stats import binomtest

    method = f"a ramp in {name}" if name else "nothing wrong"
    condition = f"{len(flown)} runs"

    def share(quantity: str, count: int, most: float | None) -> ClaimRow:
        bounds = binomtest(count, len(flown)).proportion_ci(0.95, method="wilson")
        met = most is None or bool(bounds.low <= most)
        text = f"share, 95 % [{bounds.low:.3f}, {bounds.high:.3f}]"
        return information(quantity, method, condition, count / len(flown), "ratio", text, met=met)

    told = [one for one in flown if not math.isnan(one.alarm_s)]
    if not name:
        return [
            share("a false alarm", len(told), 0.005),
            share("port beyond its level", sum(one.silent for one in flown), 0.005),
        ]
    rows = [
        share("silently wrong", sum(one.silent for one in flown), MOST_SILENT),
        share("an alarm", len(told), None),
    ]
    if told:
        late = float(np.median([one.alarm_s - BEGINS_S for one in told]))
        rows.append(share("of which names it", sum(one.named == name for one in told), None))
        rows.append(information("alarm after", method, condition, late, "s", "median"))
        largest = max(one.error for one in told)
        rows.append(information("port's error then", method, condition, largest, "ratio", "largest, of its level"))
    return rows


def measure_faults(
    vehicle: Vehicle,
    *,
    runs: int = 4,
    seed: int = 7,
    progress: Callable[[int], None] | None = None,
    flight: Rendezvous = FLIGHT,
) -> ClaimsReport:
    """Fly a vehicle with a ramp in each sensor in turn, and without: alarms, false ones, and silence.

    Parameters as for `rendezvous.measure`; progress is called once a flight, of which a run has one for each sensor,
    the gyro, and nothing.
    """
    flown: dict[str, list[Flown]] = {}
    for k in range(runs):
        run = simulate_rendezvous(vehicle, flight, seed=seed + k)
        for name in ("", "gyro", *vehicle.sensor):
            flown.setdefault(name, []).append(fly_ramp(run, name))
            if progress is not None:
                progress(1)
    rows = [row for name, found in flown.items() for row in _rows(name, found)]
    return ClaimsReport(vehicle.name, runs, seed, tuple(rows), ())
