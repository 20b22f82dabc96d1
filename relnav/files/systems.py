"""The registry: what stands behind a model file's `sensor_type`. A new sensor system is one entry here."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class System:
    """Where the pieces of one sensor system live, each as "module:name"; nothing is imported before it is needed.

    Attributes
    ----------
    mission : str
        Dataclass whose fields are the sections of the model file.
    accuracy : str
        Function (mission, published, *, runs, seed, progress) -> AccuracyReport or ClaimsReport.
    budget : str
        Function (mission) -> report with `lines()` and `to_dict()`, for `relnav budget`; optionally
        `change_lines(before, change)`, what a change of the design bought, `before` being the report before it.
    runs : int
        Runs of the accuracy benchmark unless the user says otherwise.
    progress_steps : int
        How often `progress` is called for a run.
    extras : str
        Function () -> dict of what the mission holds beside the sections of its file.
    parts : str
        Function (values, path, problems) -> dict of what the sections, as they were read, name: other models.
    """

    mission: str
    accuracy: str = ""
    budget: str = ""
    runs: int = 200
    progress_steps: int = 1
    extras: str = ""
    parts: str = ""


SYSTEMS: dict[str, System] = {
    "three_beacon": System(
        mission="relnav.mission:Model",
        accuracy="relnav.accuracy.report:measure",
        budget="relnav.accuracy.budget:budget_of",
        progress_steps=3,
    ),
    "three_marker": System(
        mission="relnav.mission:VisionMission",
        accuracy="relnav.accuracy.three_marker:measure",
        runs=400,
        budget="relnav.accuracy.three_marker_budget:budget",
    ),
    "aps_sun": System(
        mission="relnav.sensors.aps_sun.sensor:ApsSunModel", accuracy="relnav.accuracy.aps_sun:measure", runs=4
    ),
    "birefringent_sun": System(
        mission="relnav.sensors.birefringent_sun.sensor:BirefringentSunModel",
        accuracy="relnav.accuracy.birefringent_sun:measure",
        runs=10_000,
    ),
    "dual_field": System(
        mission="relnav.sensors.dual_field.sensor:StarSensor",
        accuracy="relnav.accuracy.dual_field:measure",
        runs=500,
        extras="relnav.files.star_catalogue:mission_extras",
    ),
    "vehicle": System(
        mission="relnav.spacecraft:Vehicle",
        accuracy="relnav.accuracy.rendezvous:measure",
        budget="relnav.accuracy.vehicle_budget:budget",
        runs=6,
        progress_steps=3,
        parts="relnav.files.vehicle_parts:sensor_models",
    ),
}


def resolve(place: str) -> Any:
    """The object that "module:name" stands for."""
    module, name = place.split(":")
    return getattr(import_module(module), name)


def system_of(mission: Any) -> System:
    """The entry whose mission dataclass this loaded model is.

    Raises
    ------
    ValueError
        If it is none of them.
    """
    for system in SYSTEMS.values():
        module, name = system.mission.split(":")
        if type(mission).__name__ == name and type(mission).__module__ == module:
            return system
    raise ValueError(f"a loaded model is expected, relnav.load_model(...); got {mission!r}")
