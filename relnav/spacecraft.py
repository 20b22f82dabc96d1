"""What flies: a chaser with its sensors, gyro and thrusters, and the target it docks with; the vehicle file in SI.

Axes: `chaser` is what mountings are told from, `target` the docking axes (x out toward the chaser), both from their
centre of mass. A sensor's model (`relnav models`) describes it; the vehicle file names it and says where it sits, how
often it looks, and how well it is aligned.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from typing import Annotated, Any, TypeAlias

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from relnav.arrays import Matrix, Vector
from relnav.dynamics.ephemeris import seconds_since_j2000
from relnav.dynamics.rigid_body import RigidBody
from relnav.estimation.state_layout import Role
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.mission import IDENTITY, NonNegative, Orbit, Positive, Quaternion, Triple, VisionMission
from relnav.mission import Model as BeaconMission
from relnav.mounted_gyro import Gyro
from relnav.mounted_sensor import MountedSensor
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.loaded_model import LoadedModel

RESERVED = GYRO, THRUST = "gyro", "thrust"
"""Names under which samples of the gyro and commands to the thrusters are observed."""
FASTEST_TARGET_RAD_S = 10.0
"""Of a target's rate and its 1-sigma, each axis: more is a mistake, as nothing docks with what turns once a second."""
FORESEEN_RAD = 0.2
"""1-sigma of an attitude up to which errors about it are small ones."""


@dataclass(frozen=True)
class InertialOrbit(Orbit):
    """The target's orbit in inertial (ICRS) axes at zero of the log's clock: it defines the frame of the state.

    Position and velocity are estimated in the `lvlh_ccsds` of this orbit. Off the true one by some milliradians it is
    still an exactly known frame; what it does to the motion is part of the slow acceleration.

    Attributes
    ----------
    inclination_rad, ascending_node_rad, perigee_argument_rad : float
    epoch_utc : str
        When the log's clock is zero, ISO 8601 with zone: "2026-03-20T12:00:00Z". The sun's direction needs it.
    """

    inclination_rad: float = 0.0
    ascending_node_rad: float = 0.0
    perigee_argument_rad: float = 0.0
    epoch_utc: str = "2026-01-01T00:00:00Z"

    def __post_init__(self) -> None:
        try:
            seconds_since_j2000(datetime.fromisoformat(self.epoch_utc))
        except ValueError as error:
            raise ValueError(
                f'epoch_utc is a date with its zone, "2026-03-20T12:00:00Z"; got {self.epoch_utc!r}: {error}'
            ) from None

    @property
    def orientation_deg(self) -> tuple[float, float, float]:
        """Inclination, right ascension of the ascending node, argument of perigee."""
        inclination, node, perigee = map(
            math.degrees, (self.inclination_rad, self.ascending_node_rad, self.perigee_argument_rad)
        )
        return inclination, node, perigee

    @cached_property
    def epoch_s(self) -> float:
        """TT seconds since J2000.0 of the clock's zero."""
        return seconds_since_j2000(datetime.fromisoformat(self.epoch_utc))


@dataclass(frozen=True)
class ChaserBody:
    """The chaser.

    Attributes
    ----------
    q_chaser_from_lvlh : (4,)
        Attitude that it is meant to hold, v_chaser = R v_lvlh, scalar last.
    port_position_m : (3,)
        Its docking port from its centre of mass.
    """

    q_chaser_from_lvlh: Quaternion = IDENTITY
    port_position_m: Triple = (0.0, 0.0, 0.0)

    @cached_property
    def dcm_chaser_from_lvlh(self) -> Matrix:
        """The held attitude, (3, 3)."""
        return dcm_from_quaternion(np.array(self.q_chaser_from_lvlh))


@dataclass(frozen=True)
class TargetBody:
    """The target as a body that turns.

    Attributes
    ----------
    inertia_kg_m2 : (3, 3)
    rate_noise_density_rad2_s3 : float
        Density of white angular acceleration, each axis: its control and all torques but the gravity gradient.
    q_target_from_lvlh : (4,)
        Attitude that it is meant to hold, v_target = R v_lvlh, scalar last.
    port_position_m : (3,)
        Its docking port from its centre of mass.
    """

    inertia_kg_m2: tuple[Triple, Triple, Triple]
    rate_noise_density_rad2_s3: NonNegative
    q_target_from_lvlh: Quaternion = IDENTITY
    port_position_m: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        RigidBody(np.array(self.inertia_kg_m2), 0.0)

    @cached_property
    def dcm_target_from_lvlh(self) -> Matrix:
        """The held attitude, (3, 3)."""
        return dcm_from_quaternion(np.array(self.q_target_from_lvlh))


@dataclass(frozen=True)
class Thrust:
    """What is known of the thrusters; a command is an acceleration in chaser axes that holds until the next.

    Attributes
    ----------
    scale_sigma, direction_sigma_rad : float
        1-sigma of the relative error of the size, and of the turn about each axis; both last.
    role : {"estimated", "considered"}
    largest_m_s2, lasts_s : float
        Largest acceleration an axis, and how long one lasts: for a filter without commands (`vehicle.separation`).
    """

    scale_sigma: NonNegative
    direction_sigma_rad: NonNegative
    role: Role = "estimated"
    largest_m_s2: Positive = 0.02
    lasts_s: Positive = 10.0


@dataclass(frozen=True)
class Motion:
    """How far the real motion departs from that about the stated orbit, each axis.

    Attributes
    ----------
    acceleration_noise_density_m2_s3 : float
        Of white acceleration.
    slow_acceleration_sigma_m_s2, slow_acceleration_time_s : float
        Of a Gauss-Markov acceleration in `lvlh_ccsds`: differential drag, J2, the orbit that is not quite the stated.
    """

    acceleration_noise_density_m2_s3: NonNegative
    slow_acceleration_sigma_m_s2: NonNegative
    slow_acceleration_time_s: Positive


_AxisRate = Annotated[float, Ge(-FASTEST_TARGET_RAD_S), Le(FASTEST_TARGET_RAD_S)]
TargetRate: TypeAlias = tuple[_AxisRate, _AxisRate, _AxisRate]


@dataclass(frozen=True)
class HandOver:
    """What is known when the filter starts: 1-sigma about the values, each axis.

    Attributes
    ----------
    port_distance_m : (3,)
        The chaser's port from the target's, target axes at the held attitude.
    velocity_m_s : (3,)
        In `lvlh_ccsds`.
    position_sigma_m, velocity_sigma_m_s : float
    chaser_attitude_sigma_rad, target_attitude_sigma_rad : float
        About the held attitudes. Above `FORESEEN_RAD` the target's is looked for (`relnav.vehicle.acquisition`).
    target_rate_sigma_rad_s : float
        About its rate.
    target_rate_rad_s : (3,), optional
        Inertial, target axes, of one that is not controlled; that of the held attitude if left out.
    """

    port_distance_m: Triple
    velocity_m_s: Triple
    position_sigma_m: Positive
    velocity_sigma_m_s: Positive
    chaser_attitude_sigma_rad: Annotated[float, Gt(0.0), Le(FORESEEN_RAD)]
    target_attitude_sigma_rad: Annotated[float, Gt(0.0), Le(math.pi)]
    target_rate_sigma_rad_s: Positive
    target_rate_rad_s: TargetRate | None = None


@dataclass(frozen=True)
class VehicleFilter:
    """What the filter believes.

    Attributes
    ----------
    gate_probability : float
        With which a good spot or direction passes the gate.
    replay_window_s : float
        An observation may come this long after a later one, and is then inserted where it belongs.
    restart_after_s : float
        How long no image of lights may be believed, more than half of it, before the target is looked for anew; where
        none ever was, ten images alone count. If left out 5 s, ten images of a camera at 2 Hz.
    """

    gate_probability: Annotated[float, Gt(0.0), Lt(1.0)] = 0.9999
    replay_window_s: Annotated[float, Ge(0.0), Le(60.0)] = 2.0
    restart_after_s: Annotated[float, Gt(0.0)] = 5.0


POINTS, STAR, SUN = "points", "star", "sun"
_KINDS = {
    BeaconMission: POINTS,
    VisionMission: POINTS,
    StarSensor: STAR,
    ApsSunModel: SUN,
    BirefringentSunModel: SUN,
}
_OF_POINTS = (
    "position_m", "lever_sigma_m", "pattern_position_m", "extra_points_m", "points_sigma_m", "focal_sigma"
)  # fmt: skip
SAME_LIGHT_M = 1e-6
"""Lights nearer than this to one another are one: no light is smaller, and places are given in digits of it or more."""


@dataclass(frozen=True, repr=False)
class Vehicle(LoadedModel, sensor_type="vehicle"):
    """A chaser that docks with a target.

    `sensor`: name to mounting, in the order of the file; `models`: name to model; `provenance`, `path`: as for a model.
    """

    name: str
    title: str
    orbit: InertialOrbit
    chaser: ChaserBody
    target: TargetBody
    gyro: Gyro
    thrust: Thrust
    motion: Motion
    hand_over: HandOver
    filter: VehicleFilter
    sensor: Mapping[str, MountedSensor]
    models: Mapping[str, Any]
    provenance: Mapping[str, str] = field(default_factory=dict)
    path: str = ""

    def __post_init__(self) -> None:
        if not self.sensor:
            raise ValueError("a vehicle has sensors: write one section [sensor.NAME] for each")
        dcm_from_quaternion(np.array(self.chaser.q_chaser_from_lvlh), "chaser.q_chaser_from_lvlh")
        dcm_from_quaternion(np.array(self.target.q_target_from_lvlh), "target.q_target_from_lvlh")
        for name, mounted in self.sensor.items():
            if name in RESERVED:
                raise ValueError(f"sensor.{name}: this name is taken; call the sensor something else")
            dcm_from_quaternion(np.array(mounted.q_sensor_from_chaser), f"sensor.{name}.q_sensor_from_chaser")
            kind = self.kind(name)
            given = [key for key in _OF_POINTS if getattr(mounted, key) not in (None, 0.0, ())]
            if kind != POINTS and given:
                raise ValueError(f"sensor.{name}.{given[0]}: model {mounted.model} sees no lights; leave it out")
            if kind == POINTS and (mounted.position_m is None or mounted.pattern_position_m is None):
                raise ValueError(
                    f"sensor.{name}: model {mounted.model} sees lights; position_m (the lens, chaser axes) and "
                    "pattern_position_m (their origin, target axes) are needed"
                )
            if (kind == STAR) != (mounted.noise_rad is not None):
                need = "is needed" if kind == STAR else "is for star sensors; leave it out"
                raise ValueError(f"sensor.{name}.noise_rad {need}, model {mounted.model}")
        for name, lights in self.lights.items():
            for first in dict.fromkeys(first for first, _ in lights if first != name):
                self._check_common(first, name)
        if self.seeks_attitude and not any(self.kind(name) == POINTS for name in self.sensor):
            raise ValueError(
                f"hand_over.target_attitude_sigma: above {math.degrees(FORESEEN_RAD):.3g} deg the target's attitude is "
                "found from its lights; no sensor sees any"
            )

    def _check_common(self, first: str, name: str) -> None:
        told = [(self.sensor[one].points_sigma_m, self.sensor[one].points_role) for one in (first, name)]
        if told[0] != told[1]:
            sizes = " and ".join(f"{1e3 * sigma:g} mm ({role})" for sigma, role in told)
            raise ValueError(
                f"sensor.{name}: lights of it are those of sensor.{first}, and are off by the same: write the same "
                f"points_sigma and points_role in both; got {sizes}"
            )

    @property
    def seeks_attitude(self) -> bool:
        """Whether so little is known of the target's attitude at hand-over that it is looked for."""
        return self.hand_over.target_attitude_sigma_rad > FORESEEN_RAD

    def kind(self, name: str) -> str:
        """What a sensor gives: `POINTS`, `STAR` or `SUN`.

        Raises
        ------
        ValueError
            For a model that no vehicle carries.
        """
        found = _KINDS.get(type(self.models[name]))
        if found is None:
            raise ValueError(
                f"sensor.{name}.model: a three_beacon, three_marker, dual_field, aps_sun or birefringent_sun model is "
                f"expected; {self.sensor[name].model} is a {type(self.models[name]).__name__}"
            )
        return found

    def points_m(self, name: str) -> Matrix:
        """The lights that a sensor looks at, (n, 3) m, target axes from its centre of mass."""
        model, mounted = self.models[name], self.sensor[name]
        own = model.sensor.beacons_dock_m if isinstance(model, BeaconMission) else model.markers.points_m
        points: Matrix = np.array(mounted.pattern_position_m) + np.vstack([own, *mounted.extra_points_m])
        return points

    @cached_property
    def lights(self) -> Mapping[str, tuple[tuple[str, int], ...]]:
        """Of each light of a sensor, the first sensor of the file that sees it, and which new light of that one it is.

        Two sensors have a light in common where both look at one place (`SAME_LIGHT_M`).
        """
        known: list[tuple[Vector, tuple[str, int]]] = []
        found: dict[str, tuple[tuple[str, int], ...]] = {}
        for name in self.sensor:
            if self.kind(name) == POINTS:
                earlier, new, own = tuple(known), 0, []
                for place in self.points_m(name):
                    same = [light for other, light in earlier if np.linalg.norm(other - place) < SAME_LIGHT_M]
                    light = same[0] if same else (name, new)
                    if not same:
                        known.append((place, light))
                        new += 1
                    own.append(light)
                found[name] = tuple(own)
        return found

    def sharing_lights(self, name: str) -> tuple[str, ...]:
        """Sensors whose places of lights are off by the same as a sensor's, itself included, in the file's order."""
        group, size = {name}, 0
        while len(group) > size:
            size = len(group)
            for one, lights in self.lights.items():
                seen = {one, *(first for first, _ in lights)}
                if seen & group:
                    group |= seen
        return tuple(one for one in self.sensor if one in group)

    def new_lights(self, name: str) -> int:
        """How many lights a sensor is the first of the file to see."""
        return sum(first == name for first, _ in self.lights[name])

    @property
    def dcm_dock_from_lvlh(self) -> Matrix:
        """Docking axes are the target's, held: v_dock = dcm @ v_lvlh, (3, 3)."""
        return self.target.dcm_target_from_lvlh

    @property
    def port_position_m(self) -> Vector:
        """Target's port from its centre of mass at the held attitude, `lvlh_ccsds`, (3,) m."""
        port: Vector = self.target.dcm_target_from_lvlh.T @ np.array(self.target.port_position_m)
        return port

    @property
    def start_position_m(self) -> Vector:
        """The chaser's centre of mass from the target's at hand-over with both attitudes held, `lvlh_ccsds`, (3,)."""
        target, chaser = self.target, self.chaser
        port = np.array(target.port_position_m) + np.array(self.hand_over.port_distance_m)
        position: Vector = target.dcm_target_from_lvlh.T @ port
        position = position - chaser.dcm_chaser_from_lvlh.T @ np.array(chaser.port_position_m)
        return position
