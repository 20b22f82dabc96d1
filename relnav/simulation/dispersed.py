"""One run of a scenario: what is uncertain is drawn, then the approach is flown and imaged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.together import new_lanes
from relnav.mission import Model, VisionMission
from relnav.simulation.as_built import built
from relnav.simulation.detector import (
    Happens,
    detected,
    detected_together,
    happen,
    misplaced,
    project_beacons,
    spot_sigmas,
)
from relnav.simulation.dispersed_markers import fly_marker_run
from relnav.simulation.dispersed_vehicle import default_scenario, fly_vehicle_run
from relnav.simulation.dispersions import Scenario
from relnav.simulation.marker_flight import MarkerFlight
from relnav.simulation.run_draws import built_names, disturbed, lose, replaced
from relnav.simulation.scenario import SimulatedLog
from relnav.simulation.streams import Draws, Stream
from relnav.simulation.trajectory import fly_disturbed, fly_together
from relnav.simulation.vehicle_dispersions import VehicleScenario
from relnav.simulation.vehicle_sensors import VehicleRun
from relnav.spacecraft import Vehicle


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


@dataclass(frozen=True)
class Flights:
    """RUNS runs of a scenario, side by side.

    Attributes
    ----------
    t_s, spots_m, acceleration_m_s2, truth, sigma_m : (n,), (n, 3, 2, RUNS), (n, 3, RUNS), (n, 6, RUNS), as spots_m
        As `SimulatedLog`.
    drawn : list of dict
        Of each, as `Flight`.
    """

    t_s: Vector
    spots_m: Stack
    acceleration_m_s2: Stack
    truth: Stack
    sigma_m: Stack | None
    drawn: list[dict[str, float]]


@overload
def simulate(model: Model, scenario: Scenario | None = None, seed: int = 0, run: int = 0) -> SimulatedLog: ...


@overload
def simulate(model: VisionMission, scenario: Scenario | None = None, seed: int = 0, run: int = 0) -> MarkerFlight: ...


@overload
def simulate(model: Vehicle, scenario: VehicleScenario | None = None, seed: int = 0, run: int = 0) -> VehicleRun: ...


@overload
def simulate(model: Any, scenario: Any = None, seed: int = 0, run: int = 0) -> Any: ...


def simulate(
    model: Any, scenario: Any = None, seed: int = 0, run: int = 0
) -> "SimulatedLog | MarkerFlight | VehicleRun":
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
        return fly_marker_run(model, scenario or Scenario(), seed, run)[0]
    if isinstance(model, Vehicle):
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
    check_model(model, scenario)
    draws, drawn = Draws(seed, run), dict[str, float]()
    t, truth, command = fly_disturbed(model, *disturbed(model, scenario, draws, drawn, given))
    spots, sigma = _images(model, scenario, draws, drawn, given, truth)
    _let_happen(model, scenario, draws, t, spots)
    return Flight(SimulatedLog(t, spots, command, truth, sigma), drawn)


def fly_runs(
    model: Model, scenario: Scenario, seed: int, runs: Sequence[int], given: Sequence[Mapping[str, float] | None]
) -> Flights:
    """`fly_run` of RUNS runs at once, to the bit."""
    check_model(model, scenario)
    draws, drawn, sigma = [Draws(seed, run) for run in runs], [dict[str, float]() for _ in runs], None
    t, truth, command = fly_together(
        model, [disturbed(model, scenario, *one) for one in zip(draws, drawn, given, strict=True)]
    )
    shape = len(t), len(model.beacons_lvlh_m), 2
    if scenario.as_built.any or model.calibration is not None or scenario.images.by_received_power:
        spots = new_lanes(*shape)
        for lane, one in enumerate(zip(draws, drawn, given, strict=True)):
            spots[..., lane], own = _images(model, scenario, *one, np.ascontiguousarray(truth[..., lane]))
            if own is not None:
                sigma = new_lanes(*shape) if sigma is None else sigma
                sigma[..., lane] = own
    else:
        noise = new_lanes(*shape, make=np.empty)
        for lane, own_draws in enumerate(draws):
            noise[..., lane] = own_draws.normals(Stream.SPOT_NOISE, shape)
        spots = detected_together(model, truth, noise)
    for lane, own_draws in enumerate(draws):
        _let_happen(model, scenario, own_draws, t, spots[..., lane])
    return Flights(t, spots, command, truth, sigma, drawn)


def check_model(model: Model, scenario: Scenario) -> None:
    """Raise a ValueError for a model that is not flown here, or does not say what the scenario asks for."""
    if not isinstance(model, Model):
        raise ValueError(
            "scenarios are flown by three_beacon and three_marker missions and by vehicles, relnav.load_model(...); "
            f"got a {type(model).__name__}"
        )
    check_flyable(model, scenario)


def _images(
    model: Model,
    scenario: Scenario,
    draws: Draws,
    drawn: dict[str, float],
    given: Mapping[str, float] | None,
    truth: Matrix,
) -> tuple[Stack, Stack | None]:
    """Spots of a run that was flown, and their sigma where it is by received power."""
    flown = _as_built(model, scenario, draws, drawn, given)
    sigma = spot_sigmas(flown, truth) if scenario.images.by_received_power else None
    places = project_beacons(flown, truth)
    if flown.calibration is not None:
        places = misplaced(flown, places, draws.generator(Stream.FIGURE))
    return detected(flown, places, draws.normals(Stream.SPOT_NOISE, places.shape), sigma), sigma


def _let_happen(model: Model, scenario: Scenario, draws: Draws, t: Vector, spots: Stack) -> None:
    """What goes wrong with the spots (n, beacons, 2) of a run, in place."""
    images, size = scenario.images, spots.shape[0] * spots.shape[1]
    glints = draws.below(Stream.GLINT, size if images.outliers else 0, images.outliers)
    both = (2 * glints[:, None] + (0, 1)).ravel()
    places = 2.0 * draws.uniforms_at(Stream.GLINT_PLACE, both).reshape(-1, 2) - 1.0
    unseen = draws.below(Stream.DROPOUT, size if images.dropout else 0, images.dropout)
    happen(model, spots, Happens(glints, places, unseen))
    lose(scenario, draws, t, spots)


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
