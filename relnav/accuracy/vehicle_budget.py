"""Error budget of a vehicle: what its filter reports at the docking port on the planned approach, and what limits it.

One approach as planned, with nothing drawn, is flown through the filter; then again with each source of error halved,
noise by its 1-sigma and what lasts by that of the vehicle file. The filter weighs anew each time, so that what is found
is what a better part would buy. A variance v = c + s^2 a of which a source with 1-sigma s has the share s^2 a falls by
three quarters of it where s is halved: the share of a source is 4/3 of what the variance fell by. Shares add up to more
or less than one, as the filter leans on what is better; one below zero says that less noise makes it lean on what is
only considered, where Schmidt's gain is not the best one.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from relnav.accuracy.rendezvous import RANGES_M
from relnav.arrays import Vector
from relnav.mission import Model
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_numbers import Undisturbed
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.spacecraft import POINTS, STAR, Vehicle
from relnav.vehicle.filters import VehicleFilters
from relnav.vehicle.forward import estimates_at

QUANTITIES = {
    "along": ("mm", 1e3, slice(0, 1)),
    "across": ("mm", 1e3, slice(1, 3)),
    "attitude": ("deg", math.degrees(1.0), slice(6, 9)),
    "rate": ("deg/s", math.degrees(1.0), slice(9, 12)),
    "closing": ("mm/s", 1e3, slice(3, 4)),
}
"""Of the port from the port, target axes, rms of the axes: unit, its size, and which of the port's twelve."""


@dataclass(frozen=True)
class Source:
    """A source of error: its name, its size in words, and the vehicle with half of it."""

    name: str
    stated: str
    halved: Vehicle


@dataclass(frozen=True)
class VehicleBudget:
    """Budget of one vehicle.

    Attributes
    ----------
    model : str
        Its name.
    start_m, final_m : float
        Port from port, at the beginning and the end of the approach.
    ranges_m : (k,)
        Port from port, the last one the end.
    sigma : (k, 5)
        1-sigma of `QUANTITIES` there, m, rad and s.
    shares : mapping
        Of each source, by name, in the variances at the end, (5,).
    stated : mapping
        How large each source is, in words.
    """

    model: str
    start_m: float
    final_m: float
    ranges_m: tuple[float, ...]
    sigma: tuple[Vector, ...]
    shares: Mapping[str, Vector]
    stated: Mapping[str, str]

    def lines(self) -> list[str]:
        """The budget for a reader."""
        units = [f"{name} {unit}" for name, (unit, _, _) in QUANTITIES.items()]
        factors = np.array([size for _, size, _ in QUANTITIES.values()])
        lines = [
            f"model {self.model}: port from port on the planned approach from {self.start_m:g} m, "
            "1-sigma as the filter reports it",
            f"{'range m':>8}" + "".join(f"{unit:>15}" for unit in units),
        ]
        for range_m, sigma in zip(self.ranges_m, self.sigma, strict=True):
            lines.append(f"{range_m:>8g}" + "".join(f"{value:>15.3g}" for value in sigma * factors))
        lines.append(f"share in the variance at {self.final_m:g} m, %: 4/3 of its fall where a source is halved")
        lines.append(f"{'source':<26}{'1-sigma':<24}" + "".join(f"{name:>10}" for name in QUANTITIES))
        for name, share in sorted(self.shares.items(), key=lambda entry: -entry[1][0]):
            cells = "".join(f"{100.0 * value:>10.1f}" if abs(value) >= 5e-4 else f"{'-':>10}" for value in share)
            lines.append(f"{name:<26}{self.stated[name]:<24}{cells}")
        return lines

    def to_dict(self) -> dict[str, Any]:
        """The budget as plain values, SI units and radians."""
        names = list(QUANTITIES)
        return {
            "model": self.model,
            "start_m": self.start_m,
            "final_m": self.final_m,
            "rows": [
                {"range_m": range_m, "sigma": dict(zip(names, sigma.tolist(), strict=True))}
                for range_m, sigma in zip(self.ranges_m, self.sigma, strict=True)
            ],
            "sources": [
                {"name": name, "stated": self.stated[name], "shares": dict(zip(names, share.tolist(), strict=True))}
                for name, share in self.shares.items()
            ],
        }

    def change_lines(self, before: "VehicleBudget", change: str) -> list[str]:
        """What a change of the design bought at the end, `before` being the budget before it."""
        names = [
            f"{name} {was * size:.3g} -> {now * size:.3g} {unit}"
            for (name, (unit, size, _)), was, now in zip(
                QUANTITIES.items(), before.sigma[-1], self.sigma[-1], strict=True
            )
        ]
        return [f"{change}, 1-sigma at {self.final_m:g} m: {', '.join(names)}"]


def budget(vehicle: Vehicle, flight: Rendezvous | None = None) -> VehicleBudget:
    """What a vehicle's filter reports on the planned approach, and each source's share in it at the end.

    Parameters
    ----------
    vehicle : Vehicle
    flight : Rendezvous, optional
        The approach; from the file's hand-over to 1 m if left out.
    """
    begin = vehicle.hand_over
    flown = flight or Rendezvous(start_m=begin.port_distance_m[0])
    there = (flown.start_m, *begin.port_distance_m[1:])
    vehicle = replace(vehicle, hand_over=replace(begin, port_distance_m=there))
    flown = replace(flown, as_believed=True)  # no disturbance but those that are drawn, and none is
    ranges = (*(range_m for range_m in RANGES_M if flown.final_m < range_m < flown.start_m), flown.final_m)
    sigma = _reported(vehicle, flown, ranges)
    shares, stated = {}, {}
    for source in sources(vehicle):
        less = _reported(source.halved, flown, (flown.final_m,))[-1]
        shares[source.name], stated[source.name] = (1.0 - (less / sigma[-1]) ** 2) * 4.0 / 3.0, source.stated
    return VehicleBudget(vehicle.name, flown.start_m, flown.final_m, ranges, sigma, shares, stated)


def _reported(vehicle: Vehicle, flight: Rendezvous, ranges_m: tuple[float, ...]) -> tuple[Vector, ...]:
    """1-sigma of `QUANTITIES` at each range, (5,)."""
    run = simulate_rendezvous(vehicle, flight, numbers=Undisturbed())
    filters = VehicleFilters(vehicle, 0.0, monitor=False)
    events = (filters.event(seen.sensor, seen.t_s, seen.value, None) for seen in run.others)
    found = estimates_at(filters, run.samples, events, run.truth.times_of(ranges_m).tolist())
    return tuple(_rms(estimate.port.sigma) for estimate in found)


def _rms(sigma: Vector) -> Vector:
    return np.array([math.sqrt(float(np.mean(sigma[part] ** 2))) for _, _, part in QUANTITIES.values()])


def sources(vehicle: Vehicle) -> Iterator[Source]:
    """All sources of error that a vehicle file states, but those of size zero."""
    for name in vehicle.sensor:
        yield from _of_sensor(vehicle, name)
    gyro, thrust, motion = vehicle.gyro, vehicle.thrust, vehicle.motion
    target, begin = vehicle.target, vehicle.hand_over
    walk = f"{math.degrees(gyro.random_walk_rad_sqrt_s) * 60.0:.3g} deg/sqrt(h)"
    yield Source("gyro noise", walk, replace(vehicle, gyro=_less(gyro, "random_walk_rad_sqrt_s")))
    bias = f"{math.degrees(gyro.bias_sigma_rad_s) * 3600.0:.3g} deg/h"
    steadier = _less(gyro, "bias_sigma_rad_s", "bias_walk_rad_s_sqrt_s")
    yield Source("gyro bias and its walk", bias, replace(vehicle, gyro=steadier))
    if gyro.is_off:
        said = f"{1e6 * gyro.scale_sigma:.3g} ppm, {1e3 * gyro.misalignment_sigma_rad:.3g} mrad"
        better = replace(vehicle, gyro=_less(gyro, "scale_sigma", "misalignment_sigma_rad"))
        yield Source("gyro scale and misalignment", said, better)
    off = f"{100.0 * thrust.scale_sigma:.3g} %, {math.degrees(thrust.direction_sigma_rad):.3g} deg"
    yield Source("thrusters", off, replace(vehicle, thrust=_less(thrust, "scale_sigma", "direction_sigma_rad")))
    key, density = "acceleration_noise_density_m2_s3", f"{motion.acceleration_noise_density_m2_s3:.3g} m^2/s^3"
    yield Source("jitter of the thrusters", density, replace(vehicle, motion=_less(motion, key, factor=0.25)))
    key, slow = "slow_acceleration_sigma_m_s2", f"{motion.slow_acceleration_sigma_m_s2:.3g} m/s^2"
    yield Source("slow acceleration", slow, replace(vehicle, motion=_less(motion, key)))
    key, torque = "rate_noise_density_rad2_s3", f"{target.rate_noise_density_rad2_s3:.3g} rad^2/s^3"
    yield Source("torques on the target", torque, replace(vehicle, target=_less(target, key, factor=0.25)))
    start = f"{begin.position_sigma_m:g} m, {math.degrees(begin.target_attitude_sigma_rad):.3g} deg"
    sigmas = [key for key in vars(begin) if "sigma" in key]
    yield Source("hand-over", start, replace(vehicle, hand_over=_less(begin, *sigmas)))


def _less(part: Any, *keys: str, factor: float = 0.5) -> Any:
    """A section of the file with less of some of its values: half of a sigma, a quarter of a density."""
    return replace(part, **{key: factor * getattr(part, key) for key in keys})


SAID: Mapping[str, Callable[[float], str]] = {
    "mount_sigma_rad": lambda value: f"{1e3 * value:.3g} mrad",
    "lever_sigma_m": lambda value: f"{1e3 * value:.3g} mm",
    "focal_sigma": lambda value: f"{100.0 * value:.3g} %",
    "points_sigma_m": lambda value: f"{1e3 * value:.3g} mm",
}
"""How what a sensor is built with is told."""


def _of_sensor(vehicle: Vehicle, name: str) -> Iterator[Source]:
    mounted, kind, model = vehicle.sensor[name], vehicle.kind(name), vehicle.models[name]

    def having(*others: str, **changed: Any) -> Vehicle:
        better = {one: replace(vehicle.sensor[one], **changed) for one in (name, *others)}
        return replace(vehicle, sensor={**vehicle.sensor, **better})

    if kind == STAR and mounted.noise_rad is not None:
        noise = tuple(0.5 * value for value in mounted.noise_rad)
        said = f"{math.degrees(max(mounted.noise_rad)) * 3600.0:.3g} arcsec"
        yield Source(f"{name} noise", said, having(noise_rad=noise))
    elif kind != STAR:
        camera = kind == POINTS and not isinstance(model, Model)
        part, key = "camera" if camera else "sensor", "spot_noise_m" if isinstance(model, Model) else "spot_noise_px"
        seen = getattr(model, part)
        size = getattr(seen, key)
        quieter = replace(model, **{part: replace(seen, **{key: 0.5 * size})})
        said = f"{1e6 * size:.3g} um a spot" if key == "spot_noise_m" else f"{size:.3g} px a spot"
        yield Source(f"{name} noise", said, replace(vehicle, models={**vehicle.models, name: quieter}))
    for key, said_of in SAID.items():
        value = getattr(mounted, key)
        others = vehicle.sharing_lights(name) if key == "points_sigma_m" else ()
        if value > 0.0 and (not others or name == others[0]):
            yield Source(f"{name} {key.partition('_')[0]}", said_of(value), having(*others, **{key: 0.5 * value}))
