"""One run of a scenario: what is uncertain is drawn, then the approach is flown and imaged."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Stack, Vector
from relnav.mission import Model
from relnav.simulation.as_built import built
from relnav.simulation.detector import SpotDraws, imaged, misplaced, project_beacons, spot_sigmas
from relnav.simulation.dispersions import BEACONS, Scenario
from relnav.simulation.scenario import SimulatedLog
from relnav.simulation.streams import Draws, Stream
from relnav.simulation.trajectory import Approach, Disturbances, fly_disturbed

BUILT = ("focal_length", "camera_x", "camera_y", "camera_z", "beacons_x", "beacons_y", "beacons_z")
"""Of the errors that a sensor is built with, those that are told of a run; the places of its beacons follow."""


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


def simulate(model: Model, scenario: Scenario | None = None, seed: int = 0, run: int = 0) -> SimulatedLog:
    """Simulate one approach: a log as the filter gets it, and its truth.

    Parameters
    ----------
    model : Model
        From `relnav.load_model`; a three-beacon mission.
    scenario : Scenario, optional
        From `relnav.load_scenario`, or put together; by default 300 s on V-bar from 10 m to 4 m.
    seed, run : int
        Which random numbers: run 5 of seed 7 is that of `relnav.campaign(..., seed=7)`, bit for bit.

    Returns
    -------
    SimulatedLog
        `t_s`, `spots_m`, `acceleration_m_s2`, `truth`; and `sigma_m`, if noise is drawn by received power.

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
    return fly_run(model, scenario or Scenario(), seed, run).log


def check_flyable(model: Model, scenario: Scenario) -> None:
    """Raise a ValueError where a scenario asks for what a model does not say."""
    if scenario.as_built.by_tolerances and model.tolerances is None:
        raise ValueError(f"model {model.name} has no [tolerances], by which the scenario draws the sensor as built")


def fly_run(model: Model, scenario: Scenario, seed: int, run: int) -> Flight:
    """Draw what is uncertain of a run, fly it and image it."""
    if not isinstance(model, Model):
        raise ValueError(f"scenarios are flown by three-beacon missions, relnav.load_model(...); got {model!r}")
    check_flyable(model, scenario)
    draws = Draws(seed, run)
    drawn: dict[str, float] = {}
    approach, disturbances = _disturbed(model, scenario, draws, drawn)
    t, truth, command = fly_disturbed(model, approach, disturbances)
    flown = _as_built(model, scenario, draws, drawn)
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
    _lose(scenario, draws, t, spots)
    return Flight(SimulatedLog(t, spots, command, truth, sigma), drawn)


def _disturbed(
    model: Model, scenario: Scenario, draws: Draws, drawn: dict[str, float]
) -> tuple[Approach, Disturbances]:
    """The approach of this run, and what disturbs it."""
    approach, spread, thrust = scenario.approach, scenario.spread, scenario.thrust
    z, u = draws.normals(Stream.START, (9,)), draws.normals(Stream.THRUST, (6,))
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


def _as_built(model: Model, scenario: Scenario, draws: Draws, drawn: dict[str, float]) -> Model:
    """The sensor that flies; the model itself, if nothing about it is uncertain."""
    if not scenario.as_built.any:
        return model
    errors = scenario.as_built
    sigmas = model.tolerances if errors.by_tolerances and model.tolerances is not None else errors
    numbers: Vector = draws.normals(Stream.BUILT, (7 + model.sensor.beacons_dock_m.size,))
    drawn |= dict(zip(BUILT, numbers[:7].tolist(), strict=True))
    for k, number in enumerate(numbers[7:].tolist()):
        drawn[f"beacon_{k // 3 + 1}_{'xyz'[k % 3]}"] = number
    return built(model, sigmas, numbers)


def _lose(scenario: Scenario, draws: Draws, t: Vector, spots: Stack) -> None:
    """Take the lost beacon out of the images; everything else stays as it was."""
    images = scenario.images
    if images.lost_beacon == "none" or draws.uniforms(Stream.LOSS, (1,))[0] >= images.lost_probability:
        return
    gone = (t >= images.lost_from_s) & (t < images.lost_from_s + images.lost_for_s)
    spots[gone, BEACONS.index(images.lost_beacon)] = np.nan
