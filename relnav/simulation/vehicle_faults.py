"""What goes wrong with one sensor of a vehicle or with its thrusters, done to what was observed.

A fault of the thrusters leaves the flight as it is: told are the commands that a guidance would have had to give for it
to thrusters with the fault.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from typing import Any

import numpy as np

from relnav.arrays import Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation import dcm_from_quaternion, quaternion_from_dcm
from relnav.geometry.rotation_vector import turned
from relnav.mission import Model as BeaconMission
from relnav.sensors.sun_direction import SunDirection
from relnav.simulation.lasting_faults import direction
from relnav.simulation.vehicle_sensors import Observation, VehicleRun
from relnav.spacecraft import GYRO, POINTS, Vehicle


class VehicleFault(StrEnum):
    """What goes wrong; the word is what reports say."""

    NOTHING = "nothing"
    RAMP = "ramp"
    LOST = "lost for 60 s"
    GLINT = "glint in the first image"
    CLOCK = "clock jumps by 0.5 s"
    LATE = "images 1.5 s late"
    WEAK = "thrust 30 % weak"
    TURNED = "thrust 10 deg off"
    LEAK = "leak of 0.03 mm/s^2"


OF_THRUSTERS = VehicleFault.WEAK, VehicleFault.TURNED, VehicleFault.LEAK
SIZED = VehicleFault.RAMP, VehicleFault.CLOCK, *OF_THRUSTERS
BEGINS_S, LASTS_S = 30.0, 60.0
"""When a fault begins, and how long a ramp grows or a sensor is lost."""
RAMP_SIGMA = 5.0
GLINT_RAD, JUMP_S, LATE_S = 0.01, 0.5, 1.5
WEAK_SHARE, TURN_RAD, LEAK_M_S2 = 0.3, math.radians(10.0), 3e-5
"""Of the thrusters: what is missing, by what they are turned, and what nobody ordered; in a direction that is drawn.

Near the worst of a sweep: of less the filter takes little harm, and more is an alarm within seconds.
"""


def ramp_of(vehicle: Vehicle, name: str) -> float:
    """Full size of the ramp of a sensor: rad, of the gyro rad/s."""
    if name == GYRO:
        return RAMP_SIGMA * vehicle.gyro.bias_sigma_rad_s
    mounted, model = vehicle.sensor[name], vehicle.models[name]
    if vehicle.kind(name) == POINTS:
        spot = model.sensor.spot_noise_m if isinstance(model, BeaconMission) else model.camera.spot_noise_px
        noise = spot / _focal_length(vehicle, name)
    else:
        noise = max(mounted.noise_rad) if mounted.noise_rad is not None else 0.0
    return RAMP_SIGMA * math.hypot(noise, mounted.mount_sigma_rad)


def _focal_length(vehicle: Vehicle, name: str) -> float:
    """In the unit of the spots."""
    model = vehicle.models[name]
    return float(model.sensor.focal_length_m if isinstance(model, BeaconMission) else model.camera.focal_length_px[0])


def bent(vehicle: Vehicle, seen: Observation, name: str, size: float) -> Any:
    """What a sensor says that is off by `size` of its unit, if it is this sensor."""
    value, turn = seen.value, turned(np.eye(3), np.array([size, 0.0, 0.0]))
    if seen.sensor != name or size == 0.0:
        return value
    if isinstance(value, SunDirection):
        across = cross_matrix(value.direction) @ np.array([1.0, 0.0, 0.0])
        return replace(value, direction=turned(np.eye(3), size * across / np.linalg.norm(across)) @ value.direction)
    if name == GYRO:
        return value + np.array([size, 0.0, 0.0])
    if vehicle.kind(name) == POINTS:
        return value + np.array([_focal_length(vehicle, name) * size, 0.0])
    return quaternion_from_dcm(turn @ dcm_from_quaternion(value))


def with_fault(
    run: VehicleRun,
    fault: VehicleFault,
    name: str,
    rng: np.random.Generator,
    begins_s: float | None = None,
    lasts_s: float | None = None,
    size: float = 1.0,
) -> list[Observation]:
    """What was observed with a fault of this sensor, or "thrust", in the order in which a navigator is to take it.

    That is the order of time, whatever arrives when, except where images are late. begins_s, lasts_s: `BEGINS_S` and
    `LASTS_S` if left out; a ramp has to end, so that one without end takes `LASTS_S` too. size: of those of `SIZED`,
    as a multiple of the constants.
    """
    begins_s = BEGINS_S if begins_s is None else begins_s
    if lasts_s is None or (fault == VehicleFault.RAMP and math.isinf(lasts_s)):
        lasts_s = LASTS_S
    vehicle, full = run.truth.vehicle, size * ramp_of(run.truth.vehicle, name) if fault == VehicleFault.RAMP else 0.0
    axis = direction(rng, 3) if fault in OF_THRUSTERS else np.zeros(3)

    def faulty() -> Iterator[Observation]:
        first, share = True, 0.0
        for seen in run.observations:
            since_s = seen.t_s - begins_s
            if seen.sensor != name:
                yield seen
            elif fault == VehicleFault.RAMP:
                share = min(max(since_s / lasts_s, 0.0), 1.0)
                yield replace(seen, value=bent(vehicle, seen, name, share * full))
            elif fault == VehicleFault.GLINT and first:
                yield replace(seen, value=_with_glint(vehicle, seen, rng))
            elif fault == VehicleFault.CLOCK and since_s >= 0.0:
                yield replace(seen, t_s=seen.t_s + size * JUMP_S)
            elif fault == VehicleFault.LATE and since_s >= 0.0:
                yield replace(seen, arrives_s=seen.t_s + LATE_S)
            elif fault in OF_THRUSTERS and since_s >= 0.0:
                yield replace(seen, value=_ordered(fault, np.asarray(seen.value), axis, size))
            elif fault != VehicleFault.LOST or not 0.0 <= since_s < lasts_s:
                yield seen
            first = first and seen.sensor != name

    def by(seen: Observation) -> float:
        return seen.arrives_s if fault == VehicleFault.LATE else seen.t_s

    return sorted(faulty(), key=by)


def _ordered(fault: VehicleFault, given: Vector, axis: Vector, size: float) -> Vector:
    """The command, (3,) m/s^2, of which thrusters with a fault make the acceleration that was given; axis (3,): unit.

    They turn about it, or leak along it.
    """
    if fault == VehicleFault.WEAK:
        return given / (1.0 - size * WEAK_SHARE)
    if fault == VehicleFault.TURNED:
        back: Vector = turned(np.eye(3), -size * TURN_RAD * axis) @ given
        return back
    return given - size * LEAK_M_S2 * axis


def _with_glint(vehicle: Vehicle, seen: Observation, rng: np.random.Generator) -> Any:
    """An image of which one spot, drawn, is a reflection some way off in a direction that is drawn too."""
    spots = np.array(seen.value)
    shown = np.flatnonzero(np.isfinite(spots).all(axis=1))
    spots[rng.choice(shown)] += GLINT_RAD * _focal_length(vehicle, seen.sensor) * direction(rng, 2)
    return spots
