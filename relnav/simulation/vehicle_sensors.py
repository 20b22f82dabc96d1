"""What the sensors of a vehicle see of a rendezvous: noise anew each time, and what is built wrong once a run."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Matrix, Vector
from relnav.dynamics.ephemeris import sun_direction
from relnav.geometry.pinhole import central_projection
from relnav.mission import Model as BeaconMission
from relnav.sensors import aps_sun, birefringent_sun
from relnav.sensors.aps_sun.rays import project as project_aps
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.birefringent_sun.spots import project as project_birefringent
from relnav.sensors.sun_direction import SunDirection
from relnav.sensors.three_marker.camera import project
from relnav.simulation.rendezvous import Rendezvous, Truth, stated_state
from relnav.spacecraft import POINTS, STAR, Vehicle

Value: TypeAlias = Vector | Matrix | SunDirection


@dataclass(frozen=True)
class Observation:
    """One observation as `VehicleNavigator.observe` takes it, and when it is there."""

    sensor: str
    t_s: float
    value: Value
    arrives_s: float


@dataclass(frozen=True)
class VehicleRun:
    """A rendezvous as the vehicle sees it.

    Attributes
    ----------
    truth : Truth
    lasting : dict
        Every error that lasts, by the name of the filter's block.
    bias_rad_s : (m, 3)
        The gyro's, at each of its samples.
    observations : tuple of Observation
        In the order in which they arrive.
    """

    truth: Truth
    lasting: dict[str, Vector]
    bias_rad_s: Matrix
    observations: tuple[Observation, ...]

    def bias_at(self, t_s: float) -> Vector:
        """The gyro's bias, (3,) rad/s."""
        k = int(np.clip(round(t_s * self.truth.vehicle.gyro.rate_hz), 0, len(self.bias_rad_s) - 1))
        bias: Vector = self.bias_rad_s[k]
        return bias


def simulate_rendezvous(vehicle: Vehicle, flight: Rendezvous | None = None, *, seed: int = 0) -> VehicleRun:
    """Fly a rendezvous and see it with every sensor of the vehicle; `Rendezvous()` if no flight is given."""
    rng = np.random.default_rng(seed)
    truth = Truth(vehicle, Rendezvous() if flight is None else flight, rng)
    lasting, observations = dict(truth.lasting), []
    gyro, bias = _gyro(truth, rng)
    observations += gyro
    observations += [Observation("thrust", t, command, t) for t, command in truth.commands]
    for name, mounted in vehicle.sensor.items():
        lasting[f"{name}.mount"] = rng.normal(size=3) * mounted.mount_sigma_rad
        kind = vehicle.kind(name)
        times: Vector = np.arange(mounted.first_s, truth.end_s, 1.0 / mounted.rate_hz)
        values: Sequence[Value | None]
        if kind == POINTS:
            lasting[f"{name}.lever"] = rng.normal(size=3) * mounted.lever_sigma_m
            lasting[f"{name}.focal"] = rng.normal(size=1) * mounted.focal_sigma
            lasting[f"{name}.points"] = rng.normal(size=vehicle.points_m(name).size) * mounted.points_sigma_m
            values = _spots(truth, name, times, lasting, rng)
        else:
            turn = Rotation.from_rotvec(-lasting[f"{name}.mount"])
            sensor = turn * Rotation.from_matrix(mounted.dcm_sensor_from_chaser) * truth.chaser_from_inertial(times)
            values = _stars(vehicle, name, sensor, rng) if kind == STAR else _suns(vehicle, name, sensor, times, rng)
        observations += [
            Observation(name, float(t), value, float(t) + mounted.delay_s)
            for t, value in zip(times, values, strict=True)
            if value is not None
        ]
    return VehicleRun(truth, lasting, bias, tuple(sorted(observations, key=lambda o: o.arrives_s)))


def _gyro(truth: Truth, rng: np.random.Generator) -> tuple[list[Observation], Matrix]:
    gyro = truth.vehicle.gyro
    dt = 1.0 / gyro.rate_hz
    times: Vector = np.arange(round(truth.end_s * gyro.rate_hz) + 1, dtype=np.float64) * dt
    body = truth.chaser_from_inertial(times).inv()
    rate = (body[:-1].inv() * body[1:]).as_rotvec() / dt
    walk = rng.normal(size=rate.shape) * gyro.bias_walk_rad_s_sqrt_s * dt**0.5
    bias = rng.normal(size=3) * gyro.bias_sigma_rad_s + np.cumsum(walk, axis=0) - walk[0]
    sample = rate + bias + rng.normal(size=rate.shape) * gyro.random_walk_rad_sqrt_s / dt**0.5
    return [Observation("gyro", float(t), w, float(t)) for t, w in zip(times, sample, strict=False)], bias


def _spots(
    truth: Truth, name: str, times: Vector, lasting: dict[str, Vector], rng: np.random.Generator
) -> list[Matrix | None]:
    vehicle = truth.vehicle
    model, mounted = vehicle.models[name], vehicle.sensor[name]
    lights = vehicle.points_m(name) + lasting[f"{name}.points"].reshape(-1, 3)
    lens = np.array(mounted.position_m) + lasting[f"{name}.lever"]
    sensor = Rotation.from_rotvec(-lasting[f"{name}.mount"]) * Rotation.from_matrix(mounted.dcm_sensor_from_chaser)
    scale = 1.0 + lasting[f"{name}.focal"][0]
    motion, target, chaser = truth.motion(times), truth.frame_from_target(times), truth.chaser_from_frame(times)
    images: list[Matrix | None] = []
    for k in range(len(times)):
        points = sensor.apply(chaser[k].apply(target[k].apply(lights) - motion[k, :3]) - lens)
        if isinstance(model, BeaconMission):
            clean = scale * model.sensor.focal_length_m * central_projection(points)
            spots = clean + rng.normal(size=clean.shape) * model.sensor.spot_noise_m
            spots[(np.abs(spots) > 0.5 * np.array(model.sensor.detector_size_m)).any(axis=1)] = np.nan
        else:
            centre = np.array(model.camera.principal_point_px)
            clean = centre + scale * (project(points, model.camera).spots_px - centre)
            spots = clean + rng.normal(size=clean.shape) * model.camera.spot_noise_px
        images.append(spots if np.isfinite(spots).any() else None)
    return images


def _stars(vehicle: Vehicle, name: str, sensor: Rotation, rng: np.random.Generator) -> list[Vector | None]:
    noise = rng.normal(size=(len(sensor), 3)) * np.array(vehicle.sensor[name].noise_rad)
    return list((Rotation.from_rotvec(-noise) * sensor).as_quat())


def _suns(
    vehicle: Vehicle, name: str, sensor: Rotation, times: Vector, rng: np.random.Generator
) -> list[SunDirection | None]:
    model = vehicle.models[name]
    seen: list[SunDirection | None] = []
    for k, t in enumerate(times):
        r, v, _ = stated_state(vehicle.orbit, float(t))
        toward = sensor[k].apply(sun_direction(vehicle.orbit.epoch_s + float(t), r, v))
        if toward[2] <= 0.0:
            seen.append(None)
            continue
        if isinstance(model, ApsSunModel):
            spot = project_aps(model, toward) + rng.normal(size=2) * model.sensor.spot_noise_px
            measured = aps_sun.measure(spot, model)
        else:
            spots = project_birefringent(model.sensor, toward)
            measured = birefringent_sun.measure(spots + rng.normal(size=(2, 2)) * model.sensor.spot_noise_px, model)
        seen.append(measured if measured.ok else None)
    return seen
