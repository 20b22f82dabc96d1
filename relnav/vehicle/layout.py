"""The errors of a vehicle's state as named blocks: where each stands, how large it is at the start, and its role.

A block is `estimated`, or `considered` (Schmidt 1966): its error is carried in the covariance, with all that it does to
the rest, and never corrected. Errors of attitudes are those of `relnav.geometry.rotation_vector`. Order: what moves
(`MOVING`), the thrusters, then what is off in each sensor.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from relnav.arrays import Flags, Matrix, Vector
from relnav.spacecraft import POINTS, Role, Vehicle

POSITION, VELOCITY = slice(0, 3), slice(3, 6)
TARGET_ATTITUDE, TARGET_RATE = slice(6, 9), slice(9, 12)
CHASER_ATTITUDE, GYRO_BIAS = slice(12, 15), slice(15, 18)
SLOW_ACCELERATION = slice(18, 21)
MOVING = 21
"""Errors that change with time; all others last."""
THRUST_SCALE, THRUST_DIRECTION = slice(21, 22), slice(22, 25)
DRIVING = 25
"""The moving errors depend on these first ones alone."""


@dataclass(frozen=True)
class LastingError:
    """Some errors of a sensor that last a run.

    Attributes
    ----------
    kind : str
        "mount".
    size : int
        How many.
    sigma : float
        1-sigma of each at the start, SI.
    role : {"estimated", "considered"}
    """

    kind: str
    size: int
    sigma: float
    role: Role = "estimated"


@dataclass(frozen=True)
class Block:
    """Some errors of one kind.

    Attributes
    ----------
    name : str
        "position", or of a sensor "camera.mount".
    place : slice
        Of the error state.
    sigma : float
        1-sigma of each at the start, SI.
    role : {"estimated", "considered"}
    """

    name: str
    place: slice
    sigma: float
    role: Role = "estimated"


@dataclass(frozen=True)
class Layout:
    """All blocks of a vehicle's errors.

    Attributes
    ----------
    blocks : tuple of Block
        In order.
    """

    blocks: tuple[Block, ...]

    @cached_property
    def size(self) -> int:
        """Number of errors."""
        return int(self.blocks[-1].place.stop)

    @cached_property
    def by_name(self) -> dict[str, slice]:
        """Place of each block."""
        return {block.name: block.place for block in self.blocks}

    @cached_property
    def considered(self) -> Flags:
        """Which errors are never corrected, (n,)."""
        flags = np.zeros(self.size, dtype=bool)
        for block in self.blocks:
            flags[block.place] = block.role == "considered"
        return flags

    @cached_property
    def prior(self) -> Matrix:
        """Covariance at the start, (n, n)."""
        sigma = np.empty(self.size)
        for block in self.blocks:
            sigma[block.place] = block.sigma
        return np.diag(sigma**2)

    def sigmas(self, covariance: Matrix) -> dict[str, Vector]:
        """1-sigma of every block, by name, of a covariance (n, n)."""
        sigma = np.sqrt(np.diagonal(covariance))
        return {block.name: sigma[block.place] for block in self.blocks}


def layout_of(vehicle: Vehicle, more: Mapping[str, tuple[LastingError, ...]] | None = None) -> Layout:
    """The blocks of a vehicle; more: errors of sensors that are not in its file, by the sensor's name."""
    start, thrust = vehicle.hand_over, vehicle.thrust
    blocks = [
        Block("position", POSITION, start.position_sigma_m),
        Block("velocity", VELOCITY, start.velocity_sigma_m_s),
        Block("target_attitude", TARGET_ATTITUDE, start.target_attitude_sigma_rad),
        Block("target_rate", TARGET_RATE, start.target_rate_sigma_rad_s),
        Block("chaser_attitude", CHASER_ATTITUDE, start.chaser_attitude_sigma_rad),
        Block("gyro_bias", GYRO_BIAS, vehicle.gyro.bias_sigma_rad_s),
        Block("slow_acceleration", SLOW_ACCELERATION, vehicle.motion.slow_acceleration_sigma_m_s2),
        Block("thrust.scale", THRUST_SCALE, thrust.scale_sigma, thrust.role),
        Block("thrust.direction", THRUST_DIRECTION, thrust.direction_sigma_rad, thrust.role),
    ]
    at = DRIVING
    for name, errors in {**{name: _lasting(vehicle, name) for name in vehicle.sensor}, **(more or {})}.items():
        for error in errors:
            blocks.append(Block(f"{name}.{error.kind}", slice(at, at + error.size), error.sigma, error.role))
            at += error.size
    return Layout(tuple(blocks))


def _lasting(vehicle: Vehicle, name: str) -> tuple[LastingError, ...]:
    """What is off in a sensor of the vehicle file for a whole run."""
    own = vehicle.sensor[name]
    mount = LastingError("mount", 3, own.mount_sigma_rad, own.mount_role)
    if vehicle.kind(name) != POINTS:
        return (mount,)
    return (
        mount,
        LastingError("lever", 3, own.lever_sigma_m, own.lever_role),
        LastingError("focal", 1, own.focal_sigma, own.focal_role),
        LastingError("points", 3 * len(vehicle.points_m(name)), own.points_sigma_m, own.points_role),
    )
