"""Where the random numbers of a rendezvous come from: one generator in turn, or for each purpose its own stream."""

import math
from collections.abc import Mapping, Sequence
from typing import Protocol, cast

import numpy as np

from relnav.arrays import Vector
from relnav.simulation.streams import Draws, Stream

ONCE = {
    "thrust_scale": 1,
    "thrust_turn": 3,
    "chaser_attitude": 3,
    "start": 3,
    "velocity": 3,
    "target_attitude": 3,
    "target_rate": 3,
    "gyro_bias": 3,
    "speed": 1,
    "gyro_scale": 3,
    "gyro_misalignment": 6,
}
"""What is drawn once a run of every vehicle, and how many numbers it has. What is once here keeps its place."""
ANGLES = {"sway": 6, "orbit": 1}
PAIRS = ("xy", "xz", "yx", "yz", "zx", "zy")
"""Of a misalignment: the axis that measures, and the one of which it measures."""
BUILT = ("mount", "lever", "focal", "points")
"""What a sensor is built with; its names are those of the filter's blocks."""


def number_names(name: str, count: int) -> tuple[str, ...]:
    """Names of the numbers of something that is drawn once: by axis or two of them, of lights numbered from 1."""
    if name == "gyro_misalignment":
        return tuple(f"{name}_{pair}" for pair in PAIRS[:count])
    if count == 1:
        return (name,)
    if count == 3:
        return tuple(f"{name}_{axis}" for axis in "xyz")
    return tuple(f"{name}_{1 + k // 3}_{'xyz'[k % 3]}" for k in range(count))


class VehicleNumbers(Protocol):
    """The random numbers of one rendezvous."""

    def once(self, name: str, count: int) -> Vector:
        """Standard normal numbers (count,) drawn once a run: `ONCE`, or "SENSOR.mount" and the like."""

    def angles(self, name: str, shape: tuple[int, ...]) -> Vector:
        """Angles between 0 and 2 pi, drawn once a run: `ANGLES`."""

    def noise(self, name: str) -> np.random.Generator:
        """What is new all the time: "motion", "gyro", or of a sensor."""


class InTurn:
    """All from one generator, in the order in which they are asked for."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def once(self, name: str, count: int) -> Vector:  # noqa: ARG002  (as of the others)
        """As in `VehicleNumbers`."""
        return self._rng.normal(size=count)

    def angles(self, name: str, shape: tuple[int, ...]) -> Vector:  # noqa: ARG002  (as of the others)
        """As in `VehicleNumbers`."""
        return self._rng.uniform(0.0, 2.0 * math.pi, shape)

    def noise(self, name: str) -> np.random.Generator:  # noqa: ARG002  (as of the others)
        """As in `VehicleNumbers`."""
        return self._rng


class Undisturbed:
    """Nothing is drawn: all zero."""

    def once(self, name: str, count: int) -> Vector:  # noqa: ARG002  (as of the others)
        """As in `VehicleNumbers`."""
        return np.zeros(count)

    def angles(self, name: str, shape: tuple[int, ...]) -> Vector:  # noqa: ARG002  (as of the others)
        """As in `VehicleNumbers`."""
        return np.zeros(shape)

    def noise(self, name: str) -> np.random.Generator:  # noqa: ARG002  (as of the others)
        """As in `VehicleNumbers`."""
        return cast("np.random.Generator", _Silent())


class _Silent:
    """Normal numbers that are zero."""

    def normal(self, size: tuple[int, ...]) -> Vector:
        """Zeros of this shape."""
        return np.zeros(size)


class OfRun:
    """Those of a run of a campaign: each depends on seed, run and what it is for alone.

    sensors: names in the order of the vehicle file. given: numbers that replace what is drawn once, by their names
    (`number_names`).
    """

    def __init__(self, seed: int, run: int, sensors: Sequence[str], given: Mapping[str, float] | None = None) -> None:
        self._draws, self._given = Draws(seed, run), given or {}
        self._sensors = {name: k for k, name in enumerate(sensors)}
        self.drawn: dict[str, Vector] = {}

    def once(self, name: str, count: int) -> Vector:
        """As in `VehicleNumbers`; what was drawn is kept in `drawn`."""
        if name in ONCE:
            everything = self._draws.normals(Stream.VEHICLE_ONCE, (sum(ONCE.values()),))
            first = sum(list(ONCE.values())[: list(ONCE).index(name)])
            found = everything[first : first + count]
        else:
            sensor, _, what = name.rpartition(".")
            found = self._draws.generator(self._of(sensor, 1 + BUILT.index(what))).normal(size=count)
        for k, own in enumerate(number_names(name, count) if self._given else ()):
            found[k] = self._given.get(own, found[k])
        self.drawn[name] = found
        return found

    def drawn_by_number(self) -> dict[str, float]:
        """What was drawn once, number by number."""
        return {
            own: value
            for name, values in self.drawn.items()
            for own, value in zip(number_names(name, len(values)), values.tolist(), strict=True)
        }

    def angles(self, name: str, shape: tuple[int, ...]) -> Vector:
        """As in `VehicleNumbers`."""
        everything = self._draws.uniforms(Stream.VEHICLE_ANGLES, (sum(ANGLES.values()),))
        first = 0 if name == "sway" else ANGLES["sway"]
        return 2.0 * math.pi * everything[first : first + math.prod(shape)].reshape(shape)

    def noise(self, name: str) -> np.random.Generator:
        """As in `VehicleNumbers`."""
        own = {
            "motion": Stream.VEHICLE_MOTION,
            "slow": Stream.VEHICLE_SLOW,
            "gyro": Stream.GYRO,
            "fault": Stream.FAULT,
        }
        return self._draws.generator(own[name] if name in own else self._of(name, 0))

    def _of(self, sensor: str, purpose: int) -> int:
        return Stream.SENSORS + 8 * self._sensors[sensor] + purpose
