"""What the sensors of a vehicle see of a rendezvous: noise anew each time, and what is built wrong once a run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.ephemeris import sun_direction
from relnav.geometry.pinhole import central_projection
from relnav.mission import Model as BeaconMission
from relnav.sensors import aps_sun, birefringent_sun
from relnav.sensors.aps_sun.rays import project as project_aps
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.birefringent_sun.spots import project as project_birefringent
from relnav.sensors.sun_direction import SunDirection
from relnav.sensors.three_marker.camera import project
from relnav.simulation.rendezvous import Rendezvous, Truth, stated_states
from relnav.simulation.vehicle_numbers import InTurn, VehicleNumbers
from relnav.spacecraft import GYRO, POINTS, STAR, Vehicle

Value: TypeAlias = Vector | Matrix | SunDirection


@dataclass(frozen=True)
class Observation:
    """One observation as `VehicleNavigator.observe` takes it, and when it is there.

    Attributes
    ----------
    sensor : str
        Its name in the vehicle file; "gyro" or "thrust".
    t_s : float
        Of what time it is.
    value : array or SunDirection
        (n, 2) spots, (4,) a star sensor's attitude, (3,) rate or acceleration.
    arrives_s : float
        When it is there.
    """

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
    lasting : dict of (m,)
        Every error that lasts, SI, by the name of the filter's block.
    bias_rad_s : (m, 3)
        The gyro's, at each of its samples.
    samples : (k, 4)
        Of the gyro: t s and rate rad/s, in order of time.
    others : tuple of Observation
        Of everything else.
    in_time : bool
        Whether `observations` come in the order of time, whenever they arrive.
    """

    truth: Truth
    lasting: dict[str, Vector]
    bias_rad_s: Matrix
    samples: Matrix
    others: tuple[Observation, ...]
    in_time: bool = False

    @cached_property
    def observations(self) -> tuple[Observation, ...]:
        """All, in the order in which they arrive, or of time."""
        gyro = [Observation(GYRO, t, rate, t) for t, rate in zip(self.samples[:, 0].tolist(), self._rates, strict=True)]
        return tuple(sorted([*gyro, *self.others], key=attrgetter("t_s" if self.in_time else "arrives_s")))

    @property
    def _rates(self) -> Matrix:
        rates: Matrix = self.samples[:, 1:].copy()
        return rates

    def having(self, observations: Sequence[Observation], *, in_time: bool) -> "VehicleRun":
        """The same run, seen like this."""
        gyro = sorted((seen.t_s, *np.asarray(seen.value).tolist()) for seen in observations if seen.sensor == GYRO)
        others = tuple(seen for seen in observations if seen.sensor != GYRO)
        return replace(self, samples=np.reshape(np.array(gyro), (-1, 4)), others=others, in_time=in_time)

    def bias_at(self, t_s: float) -> Vector:
        """The gyro's bias, (3,) rad/s."""
        k = int(np.clip(round(t_s * self.truth.vehicle.gyro.rate_hz), 0, len(self.bias_rad_s) - 1))
        bias: Vector = self.bias_rad_s[k]
        return bias


def simulate_rendezvous(
    vehicle: Vehicle, flight: Rendezvous | None = None, *, seed: int = 0, numbers: VehicleNumbers | None = None
) -> VehicleRun:
    """Fly a rendezvous and see it with every sensor of the vehicle; `Rendezvous()` if no flight is given.

    numbers: its random numbers, `vehicle_numbers`; those of the seed, all in turn, if left out.
    """
    drawn = InTurn(seed) if numbers is None else numbers
    truth = Truth(vehicle, Rendezvous() if flight is None else flight, drawn)
    lasting, (samples, bias, own) = dict(truth.lasting), _gyro(truth, drawn)
    lasting |= own
    others = [Observation("thrust", t, command, t) for t, command in truth.commands]
    for name, mounted in vehicle.sensor.items():
        lasting[f"{name}.mount"] = drawn.once(f"{name}.mount", 3) * mounted.mount_sigma_rad
        kind = vehicle.kind(name)
        times: Vector = np.arange(mounted.first_s, truth.end_s, 1.0 / mounted.rate_hz)
        values: Sequence[Value | None]
        if kind == POINTS:
            lasting[f"{name}.lever"] = drawn.once(f"{name}.lever", 3) * mounted.lever_sigma_m
            lasting[f"{name}.focal"] = drawn.once(f"{name}.focal", 1) * mounted.focal_sigma
            new = 3 * vehicle.new_lights(name)
            if new:
                lasting[f"{name}.points"] = drawn.once(f"{name}.points", new) * mounted.points_sigma_m
            values = _spots(truth, name, times, lasting, drawn.noise(name))
        else:
            turn: Matrix = Rotation.from_rotvec(-lasting[f"{name}.mount"]).as_matrix()
            sensor = turn @ mounted.dcm_sensor_from_chaser @ truth.dcm_chaser_from_inertial(times)
            rng = drawn.noise(name)
            values = _stars(vehicle, name, sensor, rng) if kind == STAR else _suns(vehicle, name, sensor, times, rng)
        others += [
            Observation(name, t, value, t + mounted.delay_s)
            for t, value in zip(times.tolist(), values, strict=True)
            if value is not None
        ]
    return VehicleRun(truth, lasting, bias, samples, tuple(others))


def _gyro(truth: Truth, numbers: VehicleNumbers) -> tuple[Matrix, Matrix, dict[str, Vector]]:
    """Samples, biases, and what else lasts of the gyro, by the names of the filter's blocks."""
    gyro, lasting = truth.vehicle.gyro, dict[str, Vector]()
    dt = 1.0 / gyro.rate_hz
    times: Vector = np.arange(round(truth.end_s * gyro.rate_hz) + 1, dtype=np.float64) * dt
    body = truth.dcm_chaser_from_inertial(times)
    rate = Rotation.from_matrix(body[:-1] @ body[1:].transpose(0, 2, 1)).as_rotvec() / dt
    rng = numbers.noise("gyro")
    walk = rng.normal(size=rate.shape) * gyro.bias_walk_rad_s_sqrt_s * dt**0.5
    bias = numbers.once("gyro_bias", 3) * gyro.bias_sigma_rad_s + np.cumsum(walk, axis=0) - walk[0]
    sample = rate + bias + rng.normal(size=rate.shape) * gyro.random_walk_rad_sqrt_s / dt**0.5
    if gyro.is_off:
        lasting["gyro.scale"] = numbers.once("gyro_scale", 3) * gyro.scale_sigma
        lasting["gyro.misalignment"] = numbers.once("gyro_misalignment", 6) * gyro.misalignment_sigma_rad
        off = np.diag(lasting["gyro.scale"])
        off[~np.eye(3, dtype=bool)] = lasting["gyro.misalignment"]
        sample += rate @ off.T
    return np.column_stack([times[:-1], sample]), bias, lasting


def _spots(
    truth: Truth, name: str, times: Vector, lasting: dict[str, Vector], rng: np.random.Generator
) -> list[Matrix | None]:
    vehicle = truth.vehicle
    model, mounted = vehicle.models[name], vehicle.sensor[name]
    off = [lasting[f"{first}.points"][3 * k : 3 * k + 3] for first, k in vehicle.lights[name]]
    lights = vehicle.points_m(name) + np.array(off)
    lens = np.array(mounted.position_m) + lasting[f"{name}.lever"]
    sensor = Rotation.from_rotvec(-lasting[f"{name}.mount"]) * Rotation.from_matrix(mounted.dcm_sensor_from_chaser)
    scale = 1.0 + lasting[f"{name}.focal"][0]
    motion = truth.motion(times)[:, None, :3]
    target, chaser = truth.dcm_frame_from_target(times), truth.dcm_chaser_from_frame(times)
    in_frame = lights @ target.transpose(0, 2, 1) - motion
    points = (in_frame @ chaser.transpose(0, 2, 1) - lens) @ sensor.as_matrix().T
    shape, flat = (len(times), len(lights), 2), points.reshape(-1, 3)
    if isinstance(model, BeaconMission):
        clean = (scale * model.sensor.focal_length_m * central_projection(flat)).reshape(shape)
        spots = clean + rng.normal(size=shape) * model.sensor.spot_noise_m
        spots[(np.abs(spots) > 0.5 * np.array(model.sensor.detector_size_m)).any(axis=-1)] = np.nan
    else:
        centre = np.array(model.camera.principal_point_px)
        clean = centre + scale * (project(flat, model.camera).spots_px.reshape(shape) - centre)
        spots = clean + rng.normal(size=shape) * model.camera.spot_noise_px
    seen = np.isfinite(spots).any(axis=(1, 2)).tolist()
    return [image if some else None for image, some in zip(spots, seen, strict=True)]


def _stars(vehicle: Vehicle, name: str, sensor: Stack, rng: np.random.Generator) -> list[Vector | None]:
    noise = rng.normal(size=(len(sensor), 3)) * np.array(vehicle.sensor[name].noise_rad)
    return list((Rotation.from_rotvec(-noise) * Rotation.from_matrix(sensor)).as_quat())


def _suns(
    vehicle: Vehicle, name: str, sensor: Stack, times: Vector, rng: np.random.Generator
) -> list[SunDirection | None]:
    model = vehicle.models[name]
    r, v, _ = stated_states(vehicle.orbit, times)
    toward = np.einsum("kij,kj->ki", sensor, sun_direction(vehicle.orbit.epoch_s + times, r, v))
    above, seen = np.flatnonzero(toward[:, 2] > 0.0), np.full(len(times), None)
    if isinstance(model, ApsSunModel):
        clean = project_aps(model, toward[above])
        spots = clean + rng.normal(size=clean.shape) * model.sensor.spot_noise_px
        measured = [aps_sun.measure(spot, model) for spot in spots]
    else:
        clean = project_birefringent(model.sensor, toward[above])
        spots = clean + rng.normal(size=clean.shape) * model.sensor.spot_noise_px
        measured = [birefringent_sun.measure(spot, model) for spot in spots]
    for k, found in zip(above.tolist(), measured, strict=True):
        seen[k] = found if found.ok else None
    return list(seen)
