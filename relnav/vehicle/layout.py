"""The errors of a vehicle's state as named blocks: what moves (`MOVING`), the thrusters, what is off in each sensor.

The first are those of every filter (`dynamics/error_state.py`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Codes
from relnav.dynamics import error_state
from relnav.estimation.state_layout import Block, Role, StateLayout
from relnav.spacecraft import POINTS, Vehicle

POSITION, VELOCITY = slice(0, error_state.VELOCITY), slice(error_state.VELOCITY, error_state.MOTION)
TARGET_ATTITUDE = slice(error_state.THETA, error_state.RATE)
TARGET_RATE = slice(error_state.RATE, error_state.POSE)
CHASER_ATTITUDE = slice(error_state.POSE, error_state.POSE + 3)
GYRO_BIAS = slice(CHASER_ATTITUDE.stop, CHASER_ATTITUDE.stop + 3)
SLOW_ACCELERATION = slice(GYRO_BIAS.stop, GYRO_BIAS.stop + 3)
MOVING = SLOW_ACCELERATION.stop
"""Errors that change with time; all others last."""
THRUST_SCALE, THRUST_DIRECTION = slice(MOVING, MOVING + 1), slice(MOVING + 1, MOVING + 4)
DRIVING = THRUST_DIRECTION.stop
"""The moving errors depend on these first ones alone."""
GYRO_SCALE, GYRO_MISALIGNMENT = slice(DRIVING, DRIVING + 3), slice(DRIVING + 3, DRIVING + 9)
"""Of a gyro for which one of both is stated (`Gyro.is_off`), before the errors of all sensors."""
GYRO_ERRORS = slice(GYRO_SCALE.start, GYRO_MISALIGNMENT.stop)
LIGHTS = "points"
"""The kind of a lasting error that is where lights are in the target, three errors each: of a sensor's new lights."""


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


def layout_of(vehicle: Vehicle, more: Mapping[str, tuple[LastingError, ...]] | None = None) -> StateLayout:
    """The blocks of a vehicle; more: errors of sensors that are not in its file, by the sensor's name."""
    start, thrust, gyro = vehicle.hand_over, vehicle.thrust, vehicle.gyro
    blocks = [
        Block("position", POSITION, start.position_sigma_m),
        Block("velocity", VELOCITY, start.velocity_sigma_m_s),
        Block("target_attitude", TARGET_ATTITUDE, start.target_attitude_sigma_rad),
        Block("target_rate", TARGET_RATE, start.target_rate_sigma_rad_s),
        Block("chaser_attitude", CHASER_ATTITUDE, start.chaser_attitude_sigma_rad),
        Block("gyro_bias", GYRO_BIAS, gyro.bias_sigma_rad_s),
        Block("slow_acceleration", SLOW_ACCELERATION, vehicle.motion.slow_acceleration_sigma_m_s2),
        Block("thrust.scale", THRUST_SCALE, thrust.scale_sigma, thrust.role),
        Block("thrust.direction", THRUST_DIRECTION, thrust.direction_sigma_rad, thrust.role),
    ]
    if gyro.is_off:
        blocks.append(Block("gyro.scale", GYRO_SCALE, gyro.scale_sigma, gyro.role))
        blocks.append(Block("gyro.misalignment", GYRO_MISALIGNMENT, gyro.misalignment_sigma_rad, gyro.role))
    at = GYRO_ERRORS.stop if gyro.is_off else DRIVING
    for name, errors in {**{name: _lasting(vehicle, name) for name in vehicle.sensor}, **(more or {})}.items():
        for error in errors:
            blocks.append(Block(f"{name}.{error.kind}", slice(at, at + error.size), error.sigma, error.role))
            at += error.size
    return StateLayout(tuple(blocks))


def lights_of(layout: StateLayout) -> Codes:
    """Where the three errors of each light of any sensor begin, (l,)."""
    blocks = (b.place for b in layout.blocks if b.name.endswith(f".{LIGHTS}"))
    return np.array([at for place in blocks for at in range(place.start, place.stop, 3)], dtype=np.int64)


def places_of_lights(layout: StateLayout, vehicle: Vehicle, name: str) -> Codes:
    """Where the three errors of each light that a sensor looks at begin, (n,); those of a common light are common."""
    by_name = layout.by_name
    return np.array([by_name[f"{first}.{LIGHTS}"].start + 3 * k for first, k in vehicle.lights[name]], dtype=np.int64)


def untold(layout: StateLayout, vehicle: Vehicle) -> StateLayout:
    """The same errors where no command is told: the slow acceleration is that of thrusts that nobody knows."""
    sigma = vehicle.thrust.largest_m_s2
    blocks = (replace(b, sigma=sigma) if b.place == SLOW_ACCELERATION else b for b in layout.blocks)
    return StateLayout(tuple(blocks))


def _lasting(vehicle: Vehicle, name: str) -> tuple[LastingError, ...]:
    """What is off in a sensor of the vehicle file for a whole run."""
    own = vehicle.sensor[name]
    mount = LastingError("mount", 3, own.mount_sigma_rad, own.mount_role)
    if vehicle.kind(name) != POINTS:
        return (mount,)
    new = 3 * vehicle.new_lights(name)
    return (
        mount,
        LastingError("lever", 3, own.lever_sigma_m, own.lever_role),
        LastingError("focal", 1, own.focal_sigma, own.focal_role),
        *([LastingError(LIGHTS, new, own.points_sigma_m, own.points_role)] if new else []),
    )
