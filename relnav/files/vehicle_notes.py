"""Sentences on a vehicle's log: attitudes that do not fit that of its file, and gaps of the gyro."""

import math

import numpy as np

from relnav.arrays import Matrix
from relnav.dynamics.ephemeris import sun_direction
from relnav.files.attitude_reading import away_deg, reading_that_looks
from relnav.files.vehicle_log import Row
from relnav.geometry.linear_algebra import lengths
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.sun_direction import SunDirection
from relnav.spacecraft import GYRO, POINTS, RESERVED, STAR, Vehicle
from relnav.vehicle.health import SensorHealth
from relnav.vehicle.motion import HELD_S
from relnav.vehicle.orbit_frame import OrbitFrame

FAR_FROM_HELD_DEG = 30.0
"""No chaser on its way to a port turns so far away from the attitude of its file."""
OFTEN = 1.2
"""Mean spacing of a gyro's samples over its period above which samples are missing: one of six. Below 1 / OFTEN there
are more than its rate says."""
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


class GyroTimes:
    """When a log has samples of the gyro: how far apart, and for how long there is none."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._period_s = 1.0 / vehicle.gyro.rate_hz
        self._holds_s = vehicle.gyro.lost_after_periods * self._period_s
        self._first_s = self._end_s = self._sampled_s = math.nan
        self._samples, self._steps, self._stepped_s = 0, 0, 0.0
        self._gaps = list[tuple[float, float]]()

    def take(self, name: str, t_s: float) -> None:
        """The next row of any sensor."""
        if math.isnan(self._first_s):
            self._first_s = self._end_s = self._sampled_s = t_s
        self._end_s = max(self._end_s, t_s)
        apart_s = t_s - self._sampled_s
        if name != GYRO or (self._samples and apart_s <= 0.0):
            return
        if apart_s > self._holds_s:
            self._gaps.append((apart_s, self._sampled_s))
        elif self._samples:
            self._steps, self._stepped_s = self._steps + 1, self._stepped_s + apart_s
        self._sampled_s, self._samples = t_s, self._samples + 1

    def notes(self) -> list[str]:
        """A sentence on their spacing, and one on gaps, where there is something to say."""
        if not self._samples:
            return [f"{GYRO}: no row; the chaser's rate is learnt from the other sensors"]
        said, rest_s = list[str](), self._end_s - self._sampled_s
        spacing_s = self._stepped_s / self._steps if self._steps else self._period_s
        if not 1.0 / OFTEN <= spacing_s / self._period_s <= OFTEN:
            said.append(
                f"{GYRO}: samples are {spacing_s:.4g} s apart on average, and {self._period_s:.4g} s by its rate_hz: "
                "if none is missing, state the rate that it has"
            )
        gaps = [*self._gaps, *([(rest_s, self._sampled_s)] if rest_s > self._holds_s else [])]
        if gaps:
            longest_s, from_s = max(gaps)
            said.append(
                f"{GYRO}: gaps of {sum(apart_s for apart_s, _ in gaps):.4g} s in {self._end_s - self._first_s:.4g} s, "
                f"the longest {longest_s:.4g} s from {from_s:.2f} s on; there the last rate is held, and after "
                f"{HELD_S:g} s the rate is learnt from the other sensors"
            )
        return said
