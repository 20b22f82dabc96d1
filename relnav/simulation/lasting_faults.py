"""Faults of spots that last, of beacons or markers: no single image tells them, a filter may follow without a word."""

from dataclasses import replace
from enum import StrEnum

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import Model, VisionMission
from relnav.simulation.as_built import BuiltSensor


class Fault(StrEnum):
    """What goes wrong; the word is what reports say of beacons."""

    HEALTHY = "healthy"
    STUCK = "one beacon stuck for 20 s"
    REFLECTION = "static reflection beside C for 10 s"
    CLOCK = "clock jumps by 3 s"
    BIAS_SMALL = "one spot off by 3 sigma"
    BIAS_LARGE = "one spot off by 10 sigma"
    ATTITUDE = "attitude off by 1 deg, stated 0.05"
    LATE = "spots 0.5 s late"
    FOCAL_LENGTH = "focal length off by 1 %"
    PLACED = "one beacon off by 5 mm"


STUCK_S, REFLECTION_S, JUMP_S, LATE_S = 20.0, 10.0, 3.0, 0.5
REFLECTION_M = 300e-6
"""1-sigma of each coordinate of a reflection from where C is when it begins; that of markers begins where one is."""
FOCAL_LENGTH_SHARE, PLACED_M, ATTITUDE_RAD = 0.01, 5e-3, np.radians(1.0)
BIAS_SIGMAS = {Fault.BIAS_SMALL: 3.0, Fault.BIAS_LARGE: 10.0}


def direction(rng: np.random.Generator, axes: int) -> Vector:
    """A unit vector, all directions alike."""
    v = rng.normal(size=axes)
    out: Vector = v / np.linalg.norm(v)
    return out


def faulty_sensor(model: Model, fault: Fault, rng: np.random.Generator) -> Model:
    """The model as it really is where a fault is one of how it was built."""
    sensor = model.sensor
    if fault == Fault.FOCAL_LENGTH:
        scale = 1.0 + FOCAL_LENGTH_SHARE * rng.choice([-1.0, 1.0])
        return replace(model, sensor=replace(sensor, focal_length_m=scale * sensor.focal_length_m))
    if fault == Fault.PLACED:
        assert isinstance(sensor, BuiltSensor)
        moved = np.array(sensor.displacement_m)
        moved[rng.integers(3)] += PLACED_M * direction(rng, 3)
        places = tuple((float(x), float(y), float(z)) for x, y, z in moved)
        return replace(model, sensor=replace(sensor, displacement_m=places))
    return model


def faulty_camera(mission: VisionMission, fault: Fault, rng: np.random.Generator) -> VisionMission:
    """The same of a marker mission."""
    camera, markers = mission.camera, mission.markers
    if fault == Fault.FOCAL_LENGTH:
        scale = 1.0 + FOCAL_LENGTH_SHARE * float(rng.choice([-1.0, 1.0]))
        fx, fy = camera.focal_length_px
        return replace(mission, camera=replace(camera, focal_length_px=(scale * fx, scale * fy)))
    if fault == Fault.PLACED:
        moved = markers.points_m.copy()
        moved[rng.integers(len(moved))] += PLACED_M * direction(rng, 3)
        places = tuple((float(x), float(y), float(z)) for x, y, z in moved)
        return replace(mission, markers=replace(markers, positions_m=places))
    return mission


def end_of(fault: Fault, from_s: float) -> float:
    """When a fault that begins at a time is over; NaN for one that stays."""
    lasts = {Fault.STUCK: STUCK_S, Fault.REFLECTION: REFLECTION_S, Fault.CLOCK: 0.0}.get(fault, np.nan)
    return from_s + lasts


def with_fault(
    t_s: Vector,
    seen: Stack,
    fault: Fault,
    from_s: float,
    noise: float,
    last: Matrix,
    reflection: float,
    rng: np.random.Generator,
) -> tuple[Vector, Stack]:
    """Times (n,) and spots (n, 3, 2) as a log has them with a fault from a time on.

    noise: 1-sigma of a spot's coordinates; last (n, 2): the third one's true places; reflection: 1-sigma of each
    coordinate of a reflection from there when it begins.
    """
    t, spots = t_s.copy(), seen.copy()
    first = int(np.searchsorted(t_s, from_s))
    if fault == Fault.STUCK:
        beacon = rng.integers(3)
        spots[(t_s >= from_s) & (t_s < from_s + STUCK_S), beacon] = spots[first - 1, beacon]
    elif fault == Fault.REFLECTION:
        lit = (t_s >= from_s) & (t_s < from_s + REFLECTION_S)
        place = last[first] + reflection * rng.normal(size=2)
        spots[lit, 2] = place + noise * rng.normal(size=(int(lit.sum()), 2))
    elif fault == Fault.CLOCK:
        t[first:] += JUMP_S
    elif fault in BIAS_SIGMAS:
        spots[first:, rng.integers(3)] += BIAS_SIGMAS[fault] * noise * direction(rng, 2)
    elif fault == Fault.LATE:
        shift = round(LATE_S / float(t_s[1] - t_s[0]))
        spots[shift:] = seen[:-shift]
        spots[:shift] = np.nan
    return t, spots
