"""What is drawn once for a run of a scenario, of beacons as of markers: its start, its thrusters, what is lost."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from relnav.arrays import Stack, Vector
from relnav.mission import Model, VisionMission
from relnav.simulation.dispersions import BEACONS, Scenario
from relnav.simulation.streams import Draws, Stream
from relnav.simulation.trajectory import Approach, Disturbances

BUILT = ("focal_length", "camera_x", "camera_y", "camera_z", "beacons_x", "beacons_y", "beacons_z")
"""Of the errors that a sensor is built with, those that are told of a run; the places of its beacons follow."""
OF_START = tuple(f"{what}_{axis}" for what in ("start", "velocity", "assumed_velocity") for axis in "xyz")
OF_THRUST = ("thrust_scale", "thrust_turn_x", "thrust_turn_y", "thrust_turn_z", "speed", "final_range")


def built_names(points: int) -> tuple[str, ...]:
    """Names of what a sensor of so many beacons or markers is built with."""
    return (*BUILT, *(f"beacon_{1 + k}_{axis}" for k in range(points) for axis in "xyz"))


def replaced(numbers: Vector, names: tuple[str, ...], given: Mapping[str, float] | None) -> Vector:
    """Numbers (n,), those of the given names replaced."""
    if given:
        for k, name in enumerate(names):
            numbers[k] = given.get(name, numbers[k])
    return numbers


def disturbed(
    model: Model | VisionMission,
    scenario: Scenario,
    draws: Draws,
    drawn: dict[str, float],
    given: Mapping[str, float] | None = None,
) -> tuple[Approach, Disturbances]:
    """The approach of this run, and what disturbs it."""
    approach, spread, thrust = scenario.approach, scenario.spread, scenario.thrust
    z = replaced(draws.normals(Stream.START, (9,)), OF_START, given)
    u = replaced(draws.normals(Stream.THRUST, (6,)), OF_THRUST, given)
    for k, axis in enumerate("xyz"):
        drawn[f"start_{axis}"], drawn[f"velocity_{axis}"] = float(z[k]), float(z[3 + k])
        drawn[f"thrust_turn_{axis}"] = float(u[1 + k])
    drawn["thrust_scale"], drawn["speed"], drawn["final_range"] = (float(number) for number in (u[0], u[4], u[5]))
    start = np.array(approach.start_m) + z[:3] * spread.start_sigma_m
    changed = dataclasses.replace(
        approach,
        start_m=tuple(start.tolist()),
        speed_m_s=float(approach.speed_m_s * (1.0 + spread.speed_relative_sigma * u[4])),
        final_range_m=float(approach.final_range_m + spread.final_range_sigma_m * u[5]),
        thrust_scale_error=float(approach.thrust_scale_error + thrust.scale_sigma * u[0]),
    )
    velocity = model.dcm_dock_from_lvlh.T @ (z[3:6] * spread.velocity_sigma_m_s)
    if approach.assumed_start:
        velocity = velocity + z[6:] * model.filter.initial_velocity_sigma_m_s
    count = round(approach.duration_s * approach.rate_hz) if approach.assumed_noise else 0
    return changed, Disturbances(
        velocity, draws.normals(Stream.MOTION, (count, 7)), u[1:4] * thrust.direction_sigma_rad
    )


def lose(scenario: Scenario, draws: Draws, t: Vector, spots: Stack) -> None:
    """Take the lost beacon or marker out of the images; everything else stays as it was."""
    images = scenario.images
    if images.lost_beacon == "none" or draws.uniforms(Stream.LOSS, (1,))[0] >= images.lost_probability:
        return
    gone = (t >= images.lost_from_s) & (t < images.lost_from_s + images.lost_for_s)
    spots[gone, BEACONS.index(images.lost_beacon)] = np.nan
