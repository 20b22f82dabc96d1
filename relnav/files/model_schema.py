"""What a model file may hold, as a JSON schema: editors then complete its keys, in every unit, and mark mistakes.

Made from the same dataclasses that a file is read into. Taplo, and the editors that use it, find the schema by a line
`#:schema model.schema.json` at the top of the model file.
"""

import dataclasses
import re
import typing
from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter
from pydantic.errors import PydanticSchemaGenerationError

from relnav.files.models import sections_of
from relnav.files.systems import SYSTEMS, System, resolve
from relnav.files.toml_values import SOURCES
from relnav.files.units import UNITS, same_kind, split_unit
from relnav.sensors.three_beacon.calibration import Calibration

BOUNDS = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")


def model_schema(mission: Any) -> dict[str, Any]:
    """The schema of the files of a loaded model's kind."""
    kind, system = _system(mission)
    cls = type(mission)
    sections, optional = sections_of(cls)
    extras = set(resolve(system.extras)()) if system.extras else set()
    properties: dict[str, Any] = {"title": {"type": "string"}, "sensor_type": {"const": kind}}
    required = ["sensor_type"]
    for name, section in sections.items():
        if name in extras:
            continue
        properties[name] = _section(section, orbit=name == "orbit")
        if name not in optional and properties[name]["required"]:
            required.append(name)
    for name, hint in typing.get_type_hints(cls).items():
        entry = typing.get_args(hint)[-1] if typing.get_origin(hint) is Mapping else None
        if dataclasses.is_dataclass(entry):
            properties[name] = {"type": "object", "additionalProperties": _section(entry)}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": f"relnav model of sensor_type {kind}",
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def _system(mission: Any) -> tuple[str, System]:
    return next((kind, system) for kind, system in SYSTEMS.items() if resolve(system.mission) is type(mission))


def _section(cls: Any, *, orbit: bool = False) -> dict[str, Any]:
    """A section: its keys in every unit that fits. What must be there is not told, as any of its units may."""
    if cls is Calibration:
        text = _sourced({"type": "string"})
        return {"type": "object", "properties": {"file": text}, "required": ["file"], "additionalProperties": False}
    words, hints = _described(cls), typing.get_type_hints(cls, include_extras=True)
    properties, needed = {}, []
    for field in dataclasses.fields(cls):
        base, unit = split_unit(field.name)
        for other in same_kind(unit) if unit else [""]:
            name = f"{base}_{other}" if other else field.name
            plain = _value(hints[field.name], scaled=bool(unit) and UNITS[other][1] != 1.0)
            properties[name] = _sourced(plain) | ({"description": words[field.name]} if field.name in words else {})
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING and not unit:
            needed.append(field.name)
    if orbit:
        properties |= {f"altitude_{unit}": _sourced({"type": "number"}) for unit in ("km", "m")}
    return {"type": "object", "properties": properties, "required": needed, "additionalProperties": False}


def _value(hint: Any, *, scaled: bool) -> dict[str, Any]:
    """A value as it stands; in another unit a limit other than zero would be another number, and is left out."""
    try:
        schema = TypeAdapter(hint).json_schema()
    except PydanticSchemaGenerationError:
        return {}
    return {key: entry for key, entry in schema.items() if not (scaled and key in BOUNDS and entry)}


def _sourced(plain: dict[str, Any]) -> dict[str, Any]:
    """A value alone, or with where it comes from."""
    table = {"value": plain, "source": {"enum": list(SOURCES)}, "why": {"type": "string"}}
    whole = {"type": "object", "properties": table, "required": list(table), "additionalProperties": False}
    return {"anyOf": [plain, whole]}


def _described(cls: Any) -> dict[str, str]:
    """What the docstrings of a dataclass and of those it extends say of each attribute."""
    said: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        section = (base.__doc__ or "").partition("Attributes\n")[2]
        for names, text in re.findall(r"^ {4}(\w[\w, ]*?) :[^\n]*\n((?: {8}[^\n]*\n?)+)", section, re.M):
            said |= dict.fromkeys((name.strip() for name in names.split(",")), " ".join(text.split()))
    return said
