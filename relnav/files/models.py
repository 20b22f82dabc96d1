"""From `model.toml` and `published.toml` to values in SI units."""

import dataclasses
import difflib
import os
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from relnav.accuracy.published import Claim, ClaimException, Published
from relnav.errors import ModelError
from relnav.files.model_defaults import add_defaults
from relnav.files.model_folders import find_model, list_models
from relnav.files.orbit_altitude import mean_motion_of_altitude
from relnav.files.paths import path_of
from relnav.files.plausibility import implausible
from relnav.files.psd_calibration import named_calibration
from relnav.files.systems import SYSTEMS, resolve
from relnav.files.toml_values import Problems, build, change_value, read_toml, required_of
from relnav.files.wording import shown
from relnav.mission import Model, VisionMission
from relnav.sensors.three_beacon.calibration import Calibration

if TYPE_CHECKING:  # at run time a model's class is imported when it is loaded
    from relnav.sensors.aps_sun.sensor import ApsSunModel
    from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel
    from relnav.sensors.dual_field.sensor import StarSensor
    from relnav.spacecraft import Vehicle

Changes = Mapping[str, Any] | None
BeaconName = Literal["three_beacon_psd", "three_beacon_psd_rbar"]
MarkerName = Literal["three_marker_vision", "three_marker_vision_flat"]
StarName = Literal["dual_field_star", "ground_camera"]


@overload
def load_model(name_or_path: BeaconName, changes: Changes = None) -> Model: ...


@overload
def load_model(name_or_path: MarkerName, changes: Changes = None) -> VisionMission: ...


@overload
def load_model(name_or_path: StarName, changes: Changes = None) -> "StarSensor": ...


@overload
def load_model(name_or_path: Literal["aps_sun"], changes: Changes = None) -> "ApsSunModel": ...


@overload
def load_model(name_or_path: Literal["birefringent_sun"], changes: Changes = None) -> "BirefringentSunModel": ...


@overload
def load_model(name_or_path: Literal["rendezvous_demo"], changes: Changes = None) -> "Vehicle": ...


@overload  # only the file tells
def load_model(name_or_path: str | os.PathLike[str], changes: Changes = None) -> Any: ...


def load_model(name_or_path: str | os.PathLike[str], changes: Changes = None) -> Any:
    """Load a mission model.

    Parameters
    ----------
    name_or_path : str or path
        A shipped name (`list_models`), a folder that holds a `model.toml`, or such a file.
    changes : mapping, optional
        Values that replace the file's, by key as a file writes it ("focal_length_mm" or "sensor.focal_length_mm").

    Returns
    -------
    Model
        All values in SI units and radians, with their provenance; the class is that of the file's `sensor_type`
        (`Model` for three_beacon). A type checker knows it for a shipped name; for a file of yours say it:
        `model: relnav.Model = relnav.load_model("my_model.toml")`.

    Raises
    ------
    ModelError
        If there is no such model, or for every unknown key, unit that does not fit, missing or impossible value.
    """
    path = find_model(name_or_path)
    table, problems = read_toml(path)
    kind, title = table.pop("sensor_type", None), table.pop("title", _label(path))
    if not isinstance(kind, str) or kind not in SYSTEMS:
        problems.add("sensor_type", f"one of {', '.join(SYSTEMS)} is expected; got {shown(repr(kind), 80)}")
        problems.raise_if_any()
    system = SYSTEMS[str(kind)]
    cls = resolve(system.mission)
    extras = resolve(system.extras)() if system.extras else {}
    sections, optional = sections_of(cls)
    named = _named_sections(cls, table, problems)
    sections = {name: section for name, section in sections.items() if name not in extras} | named
    for key, value in (changes or {}).items():
        change_value(table, sections, key, value)
    mean_motion_of_altitude(table, problems)
    add_defaults(table, sections)
    provenance: dict[str, str] = {}
    values: dict[str, Any] = {}
    for name in table:
        if name not in sections:
            near = difflib.get_close_matches(name, list(sections), n=1)
            hint = f"did you mean [{near[0]}]?" if near else f"known sections are {', '.join(sections)}"
            problems.add(name, f"unknown section; {hint}")
    for name, section in sections.items():
        if name in optional and name not in table:
            continue
        if section is Calibration:
            values[name] = named_calibration(table[name], path, problems, provenance)
            continue
        if name not in table and len(needed := required_of(section)) > 1:
            problems.add(name, f"the section is missing; write [{name}] with {', '.join(needed)}")
            continue
        values[name] = build(section, table.get(name, {}), name, problems, provenance)
    problems.raise_if_any()
    values |= {group: {} for group in _groups(cls)}
    for place in named:
        group, _, name = place.partition(".")
        values[group][name] = values.pop(place)
    if system.parts:
        extras |= resolve(system.parts)(values, path, problems)
        problems.raise_if_any()
    try:
        mission = cls(name=_label(path), title=shown(title), provenance=provenance, path=str(path), **values, **extras)
        wrong = implausible(mission)
    except (ValueError, OverflowError, ZeroDivisionError) as error:
        raise ModelError(f"{path}: {shown(error)}") from error
    for key, reason in wrong:
        problems.add(key, reason)
    problems.raise_if_any()
    return mission


def _label(path: Path) -> str:
    """What a model is called: its folder if its file is `model.toml`, in the current folder too; else its file."""
    return path.absolute().parent.name if path.name == "model.toml" else path.stem


def sections_of(cls: Any) -> tuple[dict[str, Any], set[str]]:
    """Dataclasses that are sections of a mission's file, by name, and which of them may be left out (`X | None`)."""
    sections, optional = {}, set()
    for name, hint in typing.get_type_hints(cls).items():
        choices = [choice for choice in typing.get_args(hint) or (hint,) if choice is not type(None)]
        if len(choices) == 1 and dataclasses.is_dataclass(choices[0]):
            sections[name] = choices[0]
            if choices[0] is not hint:
                optional.add(name)
    return sections, optional


def _named_sections(cls: Any, table: dict[str, Any], problems: Problems) -> dict[str, Any]:
    """Sections that a file may have many of, [sensor.camera], [sensor.psd]: of a field that maps names to a dataclass.

    They are taken out of their common table, so that each stands under its whole name.
    """
    sections: dict[str, Any] = {}
    for group, kind in _groups(cls).items():
        entries = table.pop(group, {})
        if not isinstance(entries, dict) or not all(isinstance(entry, dict) for entry in entries.values()):
            problems.add(group, f"sections with a name each are expected, written [{group}.NAME]")
            continue
        for name, entry in entries.items():
            table[f"{group}.{name}"] = entry
            sections[f"{group}.{name}"] = kind
    return sections


def _groups(cls: Any) -> dict[str, Any]:
    """Fields of a mission that map names to a dataclass, and which."""
    hints = {name: hint for name, hint in typing.get_type_hints(cls).items() if typing.get_origin(hint) is Mapping}
    kinds = {name: typing.get_args(hint)[-1] for name, hint in hints.items()}
    return {name: kind for name, kind in kinds.items() if dataclasses.is_dataclass(kind)}


def load_mission(name_or_path: str | os.PathLike[str]) -> Model:
    """Load a model that a relative navigation filter can fly.

    Raises
    ------
    ModelError
        As `load_model`, and for a model of another kind.
    """
    model = load_model(name_or_path)
    if not isinstance(model, Model):
        raise ModelError(
            f"{model.path}: a relative navigation mission is expected (sensor_type three_beacon); this model describes "
            f"a {type(model).__name__}"
        )
    return model


def flown(model: Any) -> Model | VisionMission:
    """A loaded model, if a filter flies it.

    Raises
    ------
    ModelError
        For a model of another kind.
    """
    if not isinstance(model, Model | VisionMission):
        raise ModelError(
            f"{model.path}: a relative navigation mission is expected (sensor_type three_beacon or three_marker); this "
            f"model describes a {type(model).__name__}"
        )
    return model


def load_published(model: Any) -> Published:
    """Claims in the `published.toml` of a model, with our findings; empty if there is no such file.

    Parameters
    ----------
    model
        A loaded model, or what `load_model` takes.

    Raises
    ------
    ModelError
        If a claim is incomplete.
    """
    if isinstance(model, str | os.PathLike):
        file = find_model(model)
    else:
        file = path_of(getattr(model, "path", model), "a loaded model, or the name or path of one,")
    path = file.parent / "published.toml"
    if not path.is_file():
        return Published((), ())
    table, problems = read_toml(path)
    for name in set(table) - {"claim", "exception"}:
        problems.add(name, "unknown section; known sections are [[claim]], [[exception]]")
    found: dict[str, list[Any]] = {}
    for name, kind in (("claim", Claim), ("exception", ClaimException)):
        entries = table.get(name, [])
        if not isinstance(entries, list):
            problems.add(name, f"[[{name}]] is expected, one for each; got {shown(entries)}")
            entries = []
        found[name] = [build(kind, entry, name, problems, None) for entry in entries]
    problems.raise_if_any()
    return Published(tuple(found["claim"]), tuple(found["exception"]))


def mission_of(solution: Any) -> Any:
    """What a solution was made with: its own mission, or the shipped model of its name; None if there is none."""
    if hasattr(solution, "mission"):
        return solution.mission
    return load_model(solution.model) if solution.model in list_models() else None


def model_values(model: Any) -> dict[str, dict[str, Any]]:
    """What a loaded model's file says: key path -> its value as written, and where that comes from."""
    table, _ = read_toml(Path(model.path))
    add_defaults(table, sections_of(type(model))[0])
    values: dict[str, Any] = {}
    for section, entries in table.items():
        for key, raw in entries.items() if isinstance(entries, dict) else ():
            named = isinstance(raw, dict) and "value" not in raw  # [sensor.camera]
            for inner, value in raw.items() if named else ((None, raw),):
                path = f"{section}.{key}" if inner is None else f"{section}.{key}.{inner}"
                values[path] = value["value"] if isinstance(value, dict) else value
    return {key: {"value": value, "source": model.provenance.get(key, "unstated")} for key, value in values.items()}
