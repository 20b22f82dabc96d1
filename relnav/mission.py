"""Everything a relative navigation filter or simulator must know about its mission, in SI units: plain values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Lt

from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.inertia_error import inertia_sigma
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.loaded_model import LoadedModel
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.sensors.three_beacon.light import Light
from relnav.sensors.three_beacon.psd import Detector
from relnav.sensors.three_beacon.pulses import Pulses
from relnav.sensors.three_beacon.sensor import ThreeBeaconSensor
from relnav.sensors.three_marker.sensor import ThreeMarkerModel

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]
Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)


def _check_quaternion(name: str, quaternion: Quaternion) -> None:
    norm = sum(component**2 for component in quaternion) ** 0.5
    if abs(norm - 1.0) > 1e-3:
        raise ValueError(f"{name} is a unit quaternion (x, y, z, w); its norm is {norm:.6g}")


@dataclass(frozen=True)
class Docking:
    """Docking frame O-xyz of the target, which is held in `lvlh_ccsds`.

    Attributes
    ----------
    q_dock_from_lvlh : (4,)
        Rotation v_dock = R v_lvlh, scalar last: identity on V-bar.
    port_position_m : (3,)
        O seen from the target's centre of mass, `lvlh_ccsds` axes.
    """

    q_dock_from_lvlh: Quaternion = IDENTITY
    port_position_m: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _check_quaternion("q_dock_from_lvlh", self.q_dock_from_lvlh)


@dataclass(frozen=True)
class Camera:
    """Where the detector's lens sits in the chaser.

    Attributes
    ----------
    position_m : (3,)
        From the chaser's centre of mass, chaser axes.
    q_cam_from_chaser : (4,)
        Mounting rotation v_cam = R v_chaser, scalar last; only needed with a position that is not zero.
    """

    position_m: Triple = (0.0, 0.0, 0.0)
    q_cam_from_chaser: Quaternion = IDENTITY

    def __post_init__(self) -> None:
        _check_quaternion("q_cam_from_chaser", self.q_cam_from_chaser)


@dataclass(frozen=True)
class Attitude:
    """What is known of the camera's attitude.

    Attributes
    ----------
    mode : {"lvlh_hold", "unknown"}
        Held in `lvlh_ccsds` with the quaternion below, or unknown: then only what does not depend on it is used.
    q_cam_from_lvlh : (4,)
        Rotation v_cam = R v_lvlh, scalar last.
    sigma_rad : float
        1-sigma about each axis of the lasting part of this attitude's error, or of the one that comes with an image: by
        it `fix` tells an image that contradicts it, and with `spots` the filter's covariance includes it.
    noise_rad : float
        1-sigma about each axis of what is new in it at every image.
    """

    mode: Literal["lvlh_hold", "unknown"]
    q_cam_from_lvlh: Quaternion = IDENTITY
    sigma_rad: Annotated[float, Ge(0.0)] = math.radians(0.15)
    noise_rad: NonNegative = 0.0

    def __post_init__(self) -> None:
        _check_quaternion("q_cam_from_lvlh", self.q_cam_from_lvlh)


@dataclass(frozen=True)
class Orbit:
    """Target's orbit: filters fly Clohessy-Wiltshire about a circular one, Yamanaka-Ankersen about an eccentric one.

    Attributes
    ----------
    mean_motion_rad_s : float
        sqrt(mu / a^3).
    eccentricity : float
    true_anomaly_rad : float
        At zero of the log's clock, 0 = perigee; on a circular orbit, from the node, where a simulated flight begins.
    """

    mean_motion_rad_s: Positive
    eccentricity: Annotated[float, Ge(0.0), Lt(1.0)] = 0.0
    true_anomaly_rad: float = 0.0


@dataclass(frozen=True)
class ProcessNoise:
    """How far the real motion may depart from Clohessy-Wiltshire and from the commanded control.

    Attributes
    ----------
    acceleration_noise_density_m2_s3 : float
        Density of white acceleration, each axis.
    control_magnitude_sigma, control_direction_sigma_rad : float
        1-sigma relative error of the size, and error of the direction, of every commanded acceleration and impulse.
    control_correlation_time_s : float
        A thruster's error persists; as white noise it has the density (error)^2 times this time.
    """

    acceleration_noise_density_m2_s3: NonNegative
    control_magnitude_sigma: NonNegative = 0.0
    control_direction_sigma_rad: NonNegative = 0.0
    control_correlation_time_s: NonNegative = 0.0


@dataclass(frozen=True)
class FilterSettings:
    """How the filter starts, what it believes, and when it starts again.

    Attributes
    ----------
    initial_velocity_sigma_m_s : float
        1-sigma of each velocity component about zero at a start: the first, and any later one after a fault.
    gate_probability : float
        Probability with which a good spot (or fix) passes the gate.
    restart_after_epochs : int
        Consecutive epochs with at least half of the spots rejected, after which a new start is looked for.
    longest_delay_s : float
        An image may come this long after its exposure; 0: at once.
    """

    initial_velocity_sigma_m_s: Positive
    gate_probability: Annotated[float, Gt(0.0), Lt(1.0)] = 0.9999
    restart_after_epochs: Annotated[int, Ge(1)] = 3
    longest_delay_s: NonNegative = 0.0


@dataclass(frozen=True)
class Tolerances:
    """How well the sensor is built and known, for the error budget; every sigma is 1-sigma of a lasting error.

    Attributes
    ----------
    focal_length_relative_sigma : float
        Of the focal length.
    beacon_placement_sigma_m : float
        Of each coordinate of each beacon.
    camera_mounting_sigma_rad : float
        Of the camera's attitude about each axis: what aligns it with the chaser's attitude reference.
    beacon_mounting_sigma_rad : float
        Of the beacon triangle's attitude about each axis of the docking frame.
    distortion_limit_m : float
        Largest detection error of the uncalibrated detector, each coordinate, uniform within it.
    speed_m_s, turn_rate_rad_s : float
        Motion across the line of sight and turn of the camera, for which slots are wrongly taken as simultaneous.
    considered : bool
        Whether the filter's covariance includes the lasting errors too, not the budget alone.
    """

    focal_length_relative_sigma: NonNegative
    beacon_placement_sigma_m: NonNegative
    camera_mounting_sigma_rad: NonNegative
    beacon_mounting_sigma_rad: NonNegative
    distortion_limit_m: NonNegative
    speed_m_s: NonNegative
    turn_rate_rad_s: NonNegative
    considered: bool = False


@dataclass(frozen=True, repr=False)
class Model(LoadedModel, sensor_type="three_beacon"):
    """One mission: sensor, docking frame, camera, attitude, orbit, noise and filter settings.

    A PSD as an instrument (`detector`, `light`, `pulses`), its calibration and the tolerances of the error budget may
    be left out.

    `provenance` maps a key path ("sensor.focal_length_mm") to its value's source; `path` is the file it came from.
    """

    name: str
    title: str
    sensor: ThreeBeaconSensor
    docking: Docking
    camera: Camera
    attitude: Attitude
    orbit: Orbit
    process_noise: ProcessNoise
    filter: FilterSettings
    detector: Detector | None = None
    light: Light | None = None
    pulses: Pulses | None = None
    calibration: Calibration | None = None
    tolerances: Tolerances | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)
    path: str = ""

    def __post_init__(self) -> None:
        if self.attitude.mode == "unknown" and any(self.camera.position_m):
            raise ValueError(
                "camera.position_m must be zero with attitude mode 'unknown': a lever arm in chaser axes cannot be "
                "applied without the attitude (state the attitude, or let the track describe the camera)"
            )
        if self.pulses is not None and self.detector is not None:
            settled_s = 5.0 / (2.0 * np.pi * self.detector.bandwidth_hz)
            if self.pulses.guard_s < settled_s:
                raise ValueError(
                    f"pulses.guard_s is five time constants of detector.bandwidth_hz or more, {settled_s:.2g} s: "
                    f"sooner the current still holds the last beacon's light; got {self.pulses.guard_s:g} s"
                )

    @property
    def lasting_spot_sigma_m(self) -> float:
        """1-sigma of the constant error of a spot coordinate, as far as the filter considers it.

        The residual of a calibration; without one the detector's distortion, if tolerances are considered.
        """
        if self.calibration is not None:
            return self.calibration.residual_sigma_m
        if self.tolerances is not None and self.tolerances.considered:
            return self.tolerances.distortion_limit_m / math.sqrt(3.0)
        return 0.0

    @property
    def considered(self) -> str:
        """Which constant errors the filter's covariance includes, in words; empty if none."""
        tolerances = self.tolerances is not None and self.tolerances.considered
        spots = "what the calibration leaves" if self.calibration is not None else "distortion of the detector"
        names = [spots] if self.lasting_spot_sigma_m > 0.0 else []
        return ", ".join([*names, "focal length, mountings, beacons"] if tolerances else names)

    @property
    def spot_sigma_m(self) -> float:
        """1-sigma of a spot coordinate that a filter works with: its noise, and its constant error."""
        return float(np.hypot(self.sensor.spot_noise_m, self.lasting_spot_sigma_m))

    def corrected(self, spots_m: Stack) -> Stack:
        """Spots (..., 2) m as the detector measures them, without its distortion as far as it is calibrated."""
        return spots_m if self.calibration is None else self.calibration.correct(spots_m)

    @property
    def dcm_dock_from_lvlh(self) -> Matrix:
        """v_dock = dcm @ v_lvlh, (3, 3)."""
        return dcm_from_quaternion(np.array(self.docking.q_dock_from_lvlh))

    @property
    def dcm_cam_from_lvlh(self) -> Matrix:
        """The held attitude, v_cam = dcm @ v_lvlh, (3, 3)."""
        return dcm_from_quaternion(np.array(self.attitude.q_cam_from_lvlh))

    @property
    def port_position_m(self) -> Vector:
        """O from the target's centre of mass, `lvlh_ccsds`, (3,) m."""
        return np.array(self.docking.port_position_m)

    @property
    def camera_lever_cam_m(self) -> Vector:
        """Camera from the chaser's centre of mass in camera axes, (3,) m: constant, whatever the attitude."""
        return np.asarray(dcm_from_quaternion(np.array(self.camera.q_cam_from_chaser)) @ self.camera.position_m)

    @property
    def beacons_lvlh_m(self) -> Matrix:
        """Beacons A, B, C and further ones from the target's centre of mass, `lvlh_ccsds`, (n, 3) m."""
        return np.asarray(self.port_position_m + self.sensor.beacons_dock_m @ self.dcm_dock_from_lvlh)


@dataclass(frozen=True)
class Target:
    """The target as a body that turns; its axes are the docking axes, x out toward the chaser.

    Attributes
    ----------
    inertia_kg_m2 : (3, 3)
        In target axes.
    q_target_from_lvlh : (4,)
        Attitude that it is meant to hold, v_target = R v_lvlh, scalar last.
    port_position_m : (3,)
        Its docking port from its centre of mass, target axes.
    rate_noise_density_rad2_s3 : float
        Density of white angular acceleration that nothing else accounts for, each axis.
    inertia_sigma_kg_m2 : (3, 3)
        1-sigma of each entry of the inertia, symmetric, >= 0: constant errors, considered.
    """

    inertia_kg_m2: tuple[Triple, Triple, Triple]
    rate_noise_density_rad2_s3: NonNegative
    q_target_from_lvlh: Quaternion = IDENTITY
    port_position_m: Triple = (0.0, 0.0, 0.0)
    inertia_sigma_kg_m2: tuple[Triple, Triple, Triple] = ((0.0, 0.0, 0.0),) * 3

    def __post_init__(self) -> None:
        _check_quaternion("q_target_from_lvlh", self.q_target_from_lvlh)
        inertia_sigma(self.inertia_sigma_kg_m2)

    @property
    def dcm_target_from_lvlh(self) -> Matrix:
        """The held attitude, v_target = dcm @ v_lvlh, (3, 3)."""
        return dcm_from_quaternion(np.array(self.q_target_from_lvlh))


@dataclass(frozen=True)
class Chaser:
    """What the pose filter is told of the chaser.

    Attributes
    ----------
    port_position_m : (3,)
        Its docking port from its centre of mass, chaser axes.
    attitude_sigma_rad, attitude_noise_rad : float
        1-sigma error of its attitude, each axis: the lasting part (alignment; considered), and what an image has anew.
    """

    port_position_m: Triple = (0.0, 0.0, 0.0)
    attitude_sigma_rad: NonNegative = 0.0
    attitude_noise_rad: NonNegative = 0.0


@dataclass(frozen=True)
class PoseFilterSettings(FilterSettings):
    """As FilterSettings, for a filter of position and attitude.

    Attributes
    ----------
    initial_rate_sigma_rad_s : float
        1-sigma of the target's rate about that of its held attitude, each axis.
    few_markers_limit_s : float
        No three markers off one line used within this time: the record says that the attitude is hardly observed.
    """

    initial_rate_sigma_rad_s: Positive = 1e-3
    longest_delay_s: NonNegative = 2.0
    few_markers_limit_s: NonNegative = 30.0


@dataclass(frozen=True)
class MarkerTolerances:
    """How well a marker system is built and known, as `Tolerances`: 1-sigma of errors that last.

    Attributes
    ----------
    focal_length_relative_sigma, marker_placement_sigma_m, camera_mounting_sigma_rad : float
        Of the focal length; of each coordinate of each marker; of the camera about each axis, its lens held.
    considered : bool
        Whether the filter's covariance includes them.
    """

    focal_length_relative_sigma: NonNegative
    marker_placement_sigma_m: NonNegative
    camera_mounting_sigma_rad: NonNegative
    considered: bool = False


@dataclass(frozen=True, kw_only=True, repr=False)
class VisionMission(ThreeMarkerModel):
    """A three-marker vision system on its mission: orbit, target, chaser, noise and filter settings."""

    orbit: Orbit
    target: Target
    chaser: Chaser
    process_noise: ProcessNoise
    filter: PoseFilterSettings
    tolerances: MarkerTolerances | None = None

    @property
    def dcm_dock_from_lvlh(self) -> Matrix:
        """Docking axes are the target's, held: v_dock = dcm @ v_lvlh, (3, 3)."""
        return self.target.dcm_target_from_lvlh

    @property
    def port_position_m(self) -> Vector:
        """Target's port from its centre of mass at the held attitude, `lvlh_ccsds`, (3,) m."""
        return np.asarray(self.target.dcm_target_from_lvlh.T @ self.target.port_position_m)

    @property
    def dcm_chaser_from_lvlh(self) -> Matrix:
        """Attitude with which the chaser sees the target as expected, v_chaser = dcm @ v_lvlh, (3, 3)."""
        cam = self.view.dcm_cam_from_target @ self.target.dcm_target_from_lvlh
        dcm: Matrix = self.camera.dcm_cam_from_chaser.T @ cam
        return dcm
