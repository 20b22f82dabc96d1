"""Model folders: which there are, and from `model.toml` and `published.toml` to values in SI units."""

import dataclasses
import difflib
import os
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from relnav.accuracy.published import Claim, ClaimException, Published
from relnav.errors import ModelError, UnknownModelError
from relnav.files.orbit_altitude import mean_motion_of_altitude
from relnav.files.plausibility import implausible
from relnav.files.psd_calibration import named_calibration
from relnav.files.systems import SYSTEMS, resolve
from relnav.files.toml_values import build, change_value, read_toml
from relnav.files.wording import shown
from relnav.mission import Model, VisionMission
from relnav.sensors.three_beacon.calibration import Calibration

if TYPE_CHECKING:  # at run time a model's class is imported when it is loaded
    from relnav.sensors.aps_sun.sensor import ApsSunModel
    from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel
    from relnav.sensors.dual_field.sensor import StarSensor

Changes = Mapping[str, Any] | None
BeaconName = Literal["three_beacon_psd", "three_beacon_psd_rbar"]
MarkerName = Literal["three_marker_vision", "three_marker_vision_flat"]
StarName = Literal["dual_field_star", "ground_camera"]


def models_root() -> Path:
    """Folder of the shipped models: inside the package when installed, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "models"
    return inside if inside.is_dir() else package.parent / "models"


def list_models() -> list[str]:
    """Names of the shipped models, sorted."""
    return sorted(folder.parent.name for folder in models_root().glob("*/model.toml"))


def find_model(name_or_path: str | os.PathLike[str]) -> Path:
    """The `model.toml` that a shipped name, a folder or a file stands for.

    Raises
    ------
    UnknownModelError
        If there is none; a close match is suggested.
    """
    name = os.fspath(name_or_path)
    shipped = models_root() / name / "model.toml"
    if name in list_models():
        return shipped
    path = Path(name)
    if path.is_dir() and (path / "model.toml").is_file():
        return path / "model.toml"
    if path.is_file():
        return path
    near = difflib.get_close_matches(name, list_models(), n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"shipped models are {', '.join(list_models())}"
    raise UnknownModelError(f"no model '{name}', neither shipped nor a folder or file; {hint}")


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
    kind, title = table.pop("sensor_type", None), table.pop("title", path.parent.name)
    if not isinstance(kind, str) or kind not in SYSTEMS:
        problems.add("sensor_type", f"one of {', '.join(SYSTEMS)} is expected; got {shown(repr(kind), 80)}")
        problems.raise_if_any()
    system = SYSTEMS[str(kind)]
    cls = resolve(system.mission)
    extras = resolve(system.extras)() if system.extras else {}
    sections, optional = _sections(cls)
    sections = {name: section for name, section in sections.items() if name not in extras}
    for key, value in (changes or {}).items():
        change_value(table, sections, key, value)
    mean_motion_of_altitude(table, problems)
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
        values[name] = build(section, table.get(name, {}), name, problems, provenance)
    problems.raise_if_any()
    label = path.parent.name if path.name == "model.toml" else path.stem
    try:
        mission = cls(name=label, title=shown(title), provenance=provenance, path=str(path), **values, **extras)
        wrong = implausible(mission)
    except (ValueError, OverflowError, ZeroDivisionError) as error:
        raise ModelError(f"{path}: {shown(error)}") from error
    for key, reason in wrong:
        problems.add(key, reason)
    problems.raise_if_any()
    return mission


def _sections(cls: Any) -> tuple[dict[str, Any], set[str]]:
    """Dataclasses that are sections of a mission's file, by name, and which of them may be left out (`X | None`)."""
    sections, optional = {}, set()
    for name, hint in typing.get_type_hints(cls).items():
        choices = [choice for choice in typing.get_args(hint) or (hint,) if choice is not type(None)]
        if len(choices) == 1 and dataclasses.is_dataclass(choices[0]):
            sections[name] = choices[0]
            if choices[0] is not hint:
                optional.add(name)
    return sections, optional


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
    """Claims in the `published.toml` beside a model, and what we find of them; empty if there is no such file.

    Parameters
    ----------
    model
        A loaded model, or what `load_model` takes.

    Raises
    ------
    ModelError
        If a claim is incomplete.
    """
    path = find_model(model) if isinstance(model, str | os.PathLike) else Path(model.path)
    path = path.with_name("published.toml")
    if not path.is_file():
        return Published((), ())
    table, problems = read_toml(path)
    for name in set(table) - {"claim", "exception"}:
        problems.add(name, "unknown section; known sections are [[claim]], [[exception]]")
    claims = [build(Claim, claim, "claim", problems, None) for claim in table.get("claim", [])]
    exceptions = [build(ClaimException, entry, "exception", problems, None) for entry in table.get("exception", [])]
    problems.raise_if_any()
    return Published(tuple(claims), tuple(exceptions))


def mission_of(solution: Any) -> Any:
    """What a solution was made with: its own mission, or the shipped model of its name; None if there is none."""
    if hasattr(solution, "mission"):
        return solution.mission
    return load_model(solution.model) if solution.model in list_models() else None


def model_values(model: Any) -> dict[str, dict[str, Any]]:
    """What a loaded model's file says: key path -> its value as written, and where that comes from."""
    table, _ = read_toml(Path(model.path))
    values = {
        f"{section}.{key}": raw["value"] if isinstance(raw, dict) else raw
        for section, entries in table.items()
        if isinstance(entries, dict)
        for key, raw in entries.items()
    }
    return {key: {"value": value, "source": model.provenance.get(key, "unstated")} for key, value in values.items()}
