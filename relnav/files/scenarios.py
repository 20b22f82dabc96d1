"""Scenario files: an approach and what is uncertain about it, from TOML to values in SI units."""

import dataclasses
import difflib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from relnav.errors import UsageError
from relnav.files.paths import path_of
from relnav.files.toml_values import Problems, build, change_value, find_field, read_toml
from relnav.files.wording import shown
from relnav.simulation.dispersions import AsBuilt, Images, Results, Scenario, Spread, Thrust
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.trajectory import Approach
from relnav.simulation.vehicle_dispersions import (
    Alignment,
    SensorFault,
    VehicleGyro,
    VehicleResults,
    VehicleScenario,
    VehicleSpread,
    VehicleThrust,
)
from relnav.spacecraft import Vehicle

OF_VEHICLES: dict[str, Any] = {
    "approach": Rendezvous,
    "spread": VehicleSpread,
    "thrust": VehicleThrust,
    "gyro": VehicleGyro,
    "fault": SensorFault,
    "as_built": Alignment,
    "results": VehicleResults,
}
"""Sections of a vehicle's scenario."""
SECTIONS: dict[str, Any] = {
    "approach": Approach,
    "spread": Spread,
    "thrust": Thrust,
    "images": Images,
    "as_built": AsBuilt,
    "results": Results,
}


def load_scenario(
    path: str | os.PathLike[str] | None = None, changes: Mapping[str, Any] | None = None, *, model: Any = None
) -> Any:
    """Load a scenario file.

    Parameters
    ----------
    path : str or path, optional
        A TOML file with sections [approach], [spread], [thrust], [images], [as_built] and [results], of a vehicle
        [fault] in place of [images]. Each may be left out; without a file the defaults. Keys carry units, as in a
        model's file.
    changes : mapping, optional
        Values that replace the file's, by key with section: "approach.speed_mm_s".
    model : optional
        A loaded model; a vehicle has a scenario of its own kind.

    Returns
    -------
    Scenario or VehicleScenario
        All values in SI units and radians.

    Raises
    ------
    ModelError
        For every unknown key, unit that does not fit, or impossible value, with its line.
    UsageError
        For a file that does not exist.
    """
    if path is None:
        table: dict[str, Any] = {}
        problems = Problems(Path("--set"), "")
    else:
        file = path_of(path, "a scenario's path")
        if not file.is_file():
            raise UsageError(f"{shown(file)}: no such scenario file; name a TOML file with [approach], [spread], ...")
        table, problems = read_toml(file)
    table.pop("title", None)
    of_vehicle = isinstance(model, Vehicle)
    sections = OF_VEHICLES if of_vehicle else SECTIONS
    for key, value in (changes or {}).items():
        change_value(table, sections, key, value)
    if of_vehicle and not any(key.startswith("start_") for key in table.get("approach", {})):
        table["approach"] = table.get("approach", {}) | {"start_m": model.hand_over.port_distance_m[0]}
    for name in table:
        if name not in sections:
            near = difflib.get_close_matches(name, list(sections), n=1)
            hint = f"did you mean [{near[0]}]?" if near else f"known sections are {', '.join(sections)}"
            problems.add(name, f"unknown section; {hint}")
    provenance: dict[str, str] = {}
    values = {
        name: build(section, table[name], name, problems, provenance)
        for name, section in sections.items()
        if name in table
    }
    problems.raise_if_any()
    return VehicleScenario(**values) if of_vehicle else Scenario(**values)


def is_of_scenario(key: str) -> bool:
    """Whether a key "section.name" of a change belongs to a scenario; a model may have a section of that name too."""
    section, _, name = key.partition(".")
    kinds = [sections[section] for sections in (SECTIONS, OF_VEHICLES) if section in sections]
    return any(not find_field(name, [field.name for field in dataclasses.fields(kind)])[2] for kind in kinds)


def plain(value: Any) -> Any:
    """A dataclass of numbers, words and arrays as what JSON holds."""
    if dataclasses.is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return plain(value.tolist()) if hasattr(value, "tolist") else value
