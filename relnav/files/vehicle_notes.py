"""Sentences on a sensor of a vehicle's log that does not fit the attitude at which its file holds the chaser."""

import math

import numpy as np

from relnav.arrays import Matrix
from relnav.dynamics.ephemeris import sun_direction
from relnav.files.attitude_reading import away_deg, reading_that_looks
from relnav.files.vehicle_log import Row
from relnav.geometry.linear_algebra import lengths
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.sun_direction import SunDirection
from relnav.spacecraft import POINTS, RESERVED, STAR, Vehicle
from relnav.vehicle.health import SensorHealth
from relnav.vehicle.orbit_frame import OrbitFrame

FAR_FROM_HELD_DEG = 30.0
"""No chaser on its way to a port turns so far away from the attitude of its file."""
_MOUNTING, _TIMES = "q_sensor_from_chaser", "that t_s = 0 is epoch_utc, with the target at true_anomaly"


def _held(name: str, t_s: float, vehicle: Vehicle) -> Matrix:
    """A sensor's inertial attitude at t_s while the chaser's is as held, dcm_sensor_from_inertial (3, 3)."""
    inertial = OrbitFrame(vehicle.orbit).dcm_lvlh_from_inertial(t_s)
    held: Matrix = vehicle.sensor[name].dcm_sensor_from_chaser @ vehicle.chaser.dcm_chaser_from_lvlh @ inertial
    return held


def attitude_note(row: Row, vehicle: Vehicle) -> str:
    """A sentence on a star sensor's quaternion that fits read another way (scalar first, inverse); else empty."""
    name, t_s, value = row
    if name in RESERVED or vehicle.kind(name) != STAR or isinstance(value, SunDirection):
        return ""
    size = float(lengths(value))
    if not 0.5 < size < 2.0:
        return ""
    said, called = dcm_from_quaternion(value / size), (f"{name}'s quaternion", ("sensor", "inertial"))
    return reading_that_looks(said, _held(name, t_s, vehicle), *called, "the attitude that is held", FAR_FROM_HELD_DEG)


def refused_note(row: Row, health: SensorHealth, vehicle: Vehicle) -> str:
    """A sentence on a sensor of which nothing was believed for long, and what to check; row: the last that it gave."""
    name, t_s, value = row
    if name not in vehicle.sensor or not health.shut_out:
        return ""
    told = f"{name}: {health.refused} observations in a row were refused, up to the last"
    if vehicle.kind(name) == POINTS:
        return f"{told}: check {_MOUNTING}, position_m, pattern_position_m, and the order and unit of its spots"
    held = _held(name, t_s, vehicle)
    if isinstance(value, SunDirection):
        sun = held @ sun_direction(vehicle.orbit.epoch_s + t_s)
        off = math.degrees(math.atan2(float(lengths(np.cross(value.direction, sun))), float(value.direction @ sun)))
        return f"{told}; its sun is {off:.1f} deg off that of the attitude that is held: check {_MOUNTING} and {_TIMES}"
    off = away_deg(dcm_from_quaternion(value / lengths(value)), held)
    return (
        f"{told}; it is {off:.1f} deg off the attitude that is held: check {_MOUNTING}, {_TIMES}, and that "
        "x, y, z, w are of v_sensor = R v_inertial"
    )
