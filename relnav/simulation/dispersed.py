"""One run of a scenario: what is uncertain is drawn, then the approach is flown and imaged."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.arrays import Stack, Vector
from relnav.mission import Model, VisionMission
from relnav.simulation.as_built import built
from relnav.simulation.detector import SpotDraws, imaged, misplaced, project_beacons, spot_sigmas
from relnav.simulation.dispersions import BEACONS, Scenario
from relnav.simulation.scenario import SimulatedLog
from relnav.simulation.streams import Draws, Stream
from relnav.simulation.trajectory import Approach, Disturbances, fly_disturbed
from relnav.spacecraft import Vehicle

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


@dataclass(frozen=True)
class Flight:
    """A run.

    Attributes
    ----------
    log : SimulatedLog
        With its truth.
    drawn : dict of str to float
        What was drawn once for the run, in units of its 1-sigma: standard normal numbers.
    """

    log: SimulatedLog
    drawn: dict[str, float]


def simulate(model: Any, scenario: Any = None, seed: int = 0, run: int = 0) -> Any:
    """Simulate one approach: a log as the filter gets it, and its truth.

    Parameters
    ----------
    model : Model, VisionMission or Vehicle
        From `relnav.load_model`; a three-beacon or three-marker mission, or a vehicle.
    scenario : Scenario or VehicleScenario, optional
        From `relnav.load_scenario`, or put together; by default 300 s on V-bar from 10 m to 4 m, and of a vehicle the
        approach from its hand-over to 1 m.
    seed, run : int
        Which random numbers: run 5 of seed 7 is that of `relnav.campaign(..., seed=7)`, bit for bit.

    Returns
    -------
    SimulatedLog, MarkerFlight or VehicleRun
        Of beacons `t_s`, `spots_m`, `acceleration_m_s2`, `truth`; and `sigma_m`, if noise is drawn by received power.
        Of markers and vehicles `relnav.simulation.marker_flight.MarkerFlight` and
        `relnav.simulation.vehicle_sensors.VehicleRun`.

    Raises
    ------
    ValueError
        For a model of another kind, or what cannot be flown.

    Examples
    --------
    >>> import relnav
    >>> log = relnav.simulate(relnav.load_model("three_beacon_psd"), seed=7)
    >>> log.spots_m.shape, log.truth.shape
    ((3000, 3, 2), (3000, 6))
    """
    if isinstance(model, VisionMission):
        from relnav.simulation.dispersed_markers import fly_marker_run

        return fly_marker_run(model, scenario or Scenario(), seed, run)[0]
    if isinstance(model, Vehicle):
        from relnav.simulation.dispersed_vehicle import default_scenario, fly_vehicle_run

        return fly_vehicle_run(model, scenario or default_scenario(model), seed, run)[0]
    return fly_run(model, scenario or Scenario(), seed, run).log


def check_flyable(model: Model, scenario: Scenario) -> None:
    """Raise a ValueError where a scenario asks for what a model does not say."""
    if not isinstance(scenario, Scenario):
        raise ValueError(f"a scenario is expected, relnav.load_scenario(...); got a {type(scenario).__name__}")
    if scenario.as_built.by_tolerances and model.tolerances is None:
        raise ValueError(f"model {model.name} has no [tolerances], by which the scenario draws the sensor as built")
    for name in ("target_attitude_sigma_rad", "target_rate_sigma_rad_s"):
        if getattr(scenario.spread, name) is not None:
            raise ValueError(f"spread.{name} is for markers and vehicles: beacons do not see the target turn")


def fly_run(model: Model, scenario: Scenario, seed: int, run: int, given: Mapping[str, float] | None = None) -> Flight:
    """Draw what is uncertain of a run, fly it and image it; given: numbers that replace what is drawn once, by name."""
    if not isinstance(model, Model):
        raise ValueError(
            "scenarios are flown by three_beacon and three_marker missions and by vehicles, relnav.load_model(...); "
            f"got a {type(model).__name__}"
        )
    check_flyable(model, scenario)
    draws = Draws(seed, run)
    drawn: dict[str, float] = {}
    approach, disturbances = disturbed(model, scenario, draws, drawn, given)
    t, truth, command = fly_disturbed(model, approach, disturbances)
    flown = _as_built(model, scenario, draws, drawn, given)
    images = scenario.images
    sigma = spot_sigmas(flown, truth) if images.by_received_power else None
    places = project_beacons(flown, truth)
    if flown.calibration is not None:
        places = misplaced(flown, places, draws.generator(Stream.FIGURE))
    shape = places.shape[:2]
    numbers = SpotDraws(
        draws.normals(Stream.SPOT_NOISE, (*shape, 2)),
        2.0 * draws.uniforms(Stream.GLINT_PLACE, (*shape, 2)) - 1.0 if images.outliers else None,
        draws.uniforms(Stream.GLINT, shape) if images.outliers else None,
        draws.uniforms(Stream.DROPOUT, shape) if images.dropout else None,
    )
    spots = imaged(flown, places, images, numbers, sigma)
    lose(scenario, draws, t, spots)
    return Flight(SimulatedLog(t, spots, command, truth, sigma), drawn)


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


def _as_built(
    model: Model, scenario: Scenario, draws: Draws, drawn: dict[str, float], given: Mapping[str, float] | None
) -> Model:
    """The sensor that flies; the model itself, if nothing about it is uncertain."""
    if not scenario.as_built.any:
        return model
    errors = scenario.as_built
    sigmas = model.tolerances if errors.by_tolerances and model.tolerances is not None else errors
    names = built_names(len(model.sensor.beacons_dock_m))
    numbers = replaced(draws.normals(Stream.BUILT, (len(names),)), names, given)
    drawn |= dict(zip(names, numbers.tolist(), strict=True))
    return built(model, sigmas, numbers)


def lose(scenario: Scenario, draws: Draws, t: Vector, spots: Stack) -> None:
    """Take the lost beacon or marker out of the images; everything else stays as it was."""
    images = scenario.images
    if images.lost_beacon == "none" or draws.uniforms(Stream.LOSS, (1,))[0] >= images.lost_probability:
        return
    gone = (t >= images.lost_from_s) & (t < images.lost_from_s + images.lost_for_s)
    spots[gone, BEACONS.index(images.lost_beacon)] = np.nan
