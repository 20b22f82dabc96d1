"""The sensor as it was built: focal length, mountings and beacons drawn within the model's tolerances."""

import dataclasses
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Matrix, Vector
from relnav.geometry.rotation import dcm_from_quaternion, quaternion_from_dcm
from relnav.geometry.rotation_vector import turned
from relnav.mission import Model, VisionMission
from relnav.sensors.three_beacon import ThreeBeaconSensor


@dataclass(frozen=True)
class BuiltSensor(ThreeBeaconSensor):
    """A sensor whose beacons are not quite where they were meant to be.

    Attributes
    ----------
    displacement_m : n triples
        Of each beacon in the docking frame.
    """

    displacement_m: tuple[tuple[float, float, float], ...] = ()

    @property
    def beacons_dock_m(self) -> Matrix:
        """All beacons in the docking frame, where they really are, m."""
        drawn: Matrix = super().beacons_dock_m
        built: Matrix = drawn + np.array(self.displacement_m)
        return built


def as_built(model: Model, seed: int = 0) -> Model:
    """A model for the simulator that differs from what the filter is told by errors drawn from its [tolerances].

    Errors are normal: relative, of the focal length; turns of the camera about its axes; turns of all beacons about the
    docking axes, at the port; places of each beacon. The detector's distortion is another matter (`distortion.py`).

    Raises
    ------
    ValueError
        If the model states no tolerances.
    """
    if model.tolerances is None:
        raise ValueError(f"model {model.name} has no [tolerances]: what a built sensor may be like is not known")
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])  # `simulate` uses the first two
    return built(model, model.tolerances, rng.normal(size=7 + model.sensor.beacons_dock_m.size))


def attitude_off(model: Model, theta: Vector) -> Model:
    """A model whose camera is really turned by theta (3,) rad about its own axes against what is stated."""
    attitude = model.attitude
    return dataclasses.replace(
        model, attitude=dataclasses.replace(attitude, q_cam_from_lvlh=_turned(attitude.q_cam_from_lvlh, theta))
    )


class BuildErrors(Protocol):
    """1-sigma of each error that a sensor is built with; a model's `Tolerances` say them too."""

    @property
    def focal_length_relative_sigma(self) -> float:
        """As of `Tolerances`."""

    @property
    def camera_mounting_sigma_rad(self) -> float:
        """As of `Tolerances`."""

    @property
    def beacon_mounting_sigma_rad(self) -> float:
        """As of `Tolerances`."""

    @property
    def beacon_placement_sigma_m(self) -> float:
        """As of `Tolerances`."""


def built(model: Model, t: BuildErrors, draws: Vector) -> Model:
    """The same of standard normal numbers (7 + 3 beacons,): focal length, turns of camera and beacons, places."""
    sensor = model.sensor
    focal = float(draws[0]) * t.focal_length_relative_sigma
    camera = -draws[1:4] * t.camera_mounting_sigma_rad
    turn = Rotation.from_rotvec(draws[4:7] * t.beacon_mounting_sigma_rad).as_matrix()
    beacons = sensor.beacons_dock_m
    moved = beacons @ turn.T - beacons + draws[7:].reshape(beacons.shape) * t.beacon_placement_sigma_m
    given = {field.name: getattr(sensor, field.name) for field in dataclasses.fields(sensor)}
    given["focal_length_m"] = sensor.focal_length_m * (1.0 + focal)
    return dataclasses.replace(
        model,
        sensor=BuiltSensor(**given, displacement_m=tuple((float(x), float(y), float(z)) for x, y, z in moved)),
        camera=dataclasses.replace(model.camera, q_cam_from_chaser=_turned(model.camera.q_cam_from_chaser, camera)),
        attitude=dataclasses.replace(model.attitude, q_cam_from_lvlh=_turned(model.attitude.q_cam_from_lvlh, camera)),
    )


def markers_as_built(mission: VisionMission, seed: int = 0) -> VisionMission:
    """As `as_built`, of a marker mission: relative error of the focal length, turns of the camera, places of markers.

    Raises
    ------
    ValueError
        If the model states no tolerances.
    """
    t, markers = mission.tolerances, mission.markers
    if t is None:
        raise ValueError(f"model {mission.name} has no [tolerances]: what a built sensor may be like is not known")
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(4)[3])  # a flight uses the first three
    focal = float(rng.normal()) * t.focal_length_relative_sigma
    turn = -rng.normal(size=3) * t.camera_mounting_sigma_rad
    return markers_off(mission, focal, turn, rng.normal(size=markers.points_m.shape) * t.marker_placement_sigma_m)


def markers_off(mission: VisionMission, focal: float, turn: Vector, moved_m: Matrix) -> VisionMission:
    """A marker mission whose focal length (relative), camera (3,) rad and markers (n, 3) m are off by so much."""
    camera, markers = mission.camera, mission.markers
    places = markers.points_m + moved_m
    fx, fy = camera.focal_length_px
    quaternion = _turned(camera.q_cam_from_chaser, turn)
    lengths = ((1.0 + focal) * fx, (1.0 + focal) * fy)
    return dataclasses.replace(
        mission,
        camera=dataclasses.replace(camera, focal_length_px=lengths, q_cam_from_chaser=quaternion),
        markers=dataclasses.replace(markers, positions_m=tuple((float(x), float(y), float(z)) for x, y, z in places)),
    )


def _turned(quaternion: tuple[float, float, float, float], theta: Vector) -> tuple[float, float, float, float]:
    """Camera attitude after the camera was turned by theta (3,) rad about its own axes: exp(-[theta x]) dcm."""
    q: Vector = quaternion_from_dcm(turned(dcm_from_quaternion(np.array(quaternion)).T, theta).T)
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])
