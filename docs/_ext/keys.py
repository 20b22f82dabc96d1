"""Every key that a model file may have, from the dataclasses that the loader fills: units, limits, defaults."""

import dataclasses
import re
import typing
from collections.abc import Mapping

import relnav
from relnav.files.model_folders import list_models
from relnav.files.models import model_values
from relnav.files.systems import SYSTEMS, resolve
from relnav.files.units import same_kind, split_unit

NOT_IN_FILES = ("name", "title", "provenance", "path")
LIMITS = {"gt": "> {}", "ge": ">= {}", "lt": "< {}", "le": "<= {}"}


def _meanings(cls: type) -> dict[str, str]:
    """What the numpydoc section `Attributes` of a dataclass, or of what it derives from, says of each field."""
    said: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        text = base.__dict__.get("__doc__") or ""
        _, _, section = text.partition("Attributes\n")
        entry: list[str] = []
        for line in section.splitlines()[1:]:
            named = re.match(r" {4}([a-z_0-9]+(?:, [a-z_0-9]+)*)(?: : .*)?$", line)
            if named:
                entry = named[1].split(", ")
                said |= dict.fromkeys(entry, "")
            elif line.strip():
                for name in entry:
                    said[name] = f"{said[name]} {line.strip()}".strip()
            else:
                entry = []
    return said


def _kind(hint: typing.Any) -> str:
    """A type in words, with its limits."""
    if typing.get_origin(hint) is typing.Annotated:
        base, *rules = typing.get_args(hint)
        limits = [
            form.format(f"{getattr(rule, name):g}")
            for rule in rules
            for name, form in LIMITS.items()
            if isinstance(getattr(rule, name, None), int | float)
        ]
        return " ".join([_kind(base), ", ".join(limits)]).strip()
    if typing.get_origin(hint) is typing.Literal:
        return " or ".join(f'`"{value}"`' for value in typing.get_args(hint))
    if typing.get_origin(hint) is tuple:
        inner = typing.get_args(hint)
        if inner[-1] is Ellipsis:
            return f"list of ({_kind(inner[0])})"
        return f"{len(inner)} x ({_kind(inner[0])})"
    choices = [choice for choice in typing.get_args(hint) if choice is not type(None)]
    if choices:
        return " or ".join(_kind(choice) for choice in choices)
    return {float: "number", int: "whole number", bool: "true or false", str: "text"}.get(hint, str(hint))


def _default(field: dataclasses.Field) -> str:
    if field.default is not dataclasses.MISSING:
        value = field.default
        if isinstance(value, bool):
            return "false" if not value else "true"
        return (
            "none"
            if value is None or value == ()
            else f"{value:.6g}"
            if isinstance(value, float)
            else str(value).replace("'", "")
        )
    return "**needed**" if field.default_factory is dataclasses.MISSING else "as its own section says"


def _table(cls: type) -> list[str]:
    hints, said = typing.get_type_hints(cls, include_extras=True), _meanings(cls)
    lines = ["| key | other units | value | if left out | meaning |", "| --- | --- | --- | --- | --- |"]
    for field in dataclasses.fields(cls):
        _, unit = split_unit(field.name)
        others = ", ".join(other for other in same_kind(unit) if other != unit) if unit else ""
        row = (f"`{field.name}`", others, _kind(hints[field.name]), _default(field), said.get(field.name, ""))
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
    return [*lines, ""]


def _sections(mission: type) -> list[tuple[str, type, str]]:
    """Sections of a mission's file: heading, dataclass, and a word on how often it may stand."""
    found = []
    for name, hint in typing.get_type_hints(mission).items():
        if name in NOT_IN_FILES:
            continue
        choices = [choice for choice in typing.get_args(hint) or (hint,) if choice is not type(None)]
        if typing.get_origin(hint) is Mapping and dataclasses.is_dataclass(choices[-1]):
            found.append((f"[{name}.NAME]", choices[-1], "one for each, under a name of yours"))
        elif len(choices) == 1 and dataclasses.is_dataclass(choices[0]):
            found.append((f"[{name}]", choices[0], "" if choices[0] is hint else "may be left out"))
    return found


def keys() -> str:
    """For every sensor type its sections, and for every section its keys."""
    lines: list[str] = []
    for kind, system in SYSTEMS.items():
        mission = resolve(system.mission)
        extras = resolve(system.extras)() if system.extras else {}
        lines += [f'## sensor_type = "{kind}"', ""]
        for heading, cls, often in _sections(mission):
            if heading.strip("[]") in extras:
                continue
            lines += [f"### {heading} of {kind}", "", *([f"{often[0].upper()}{often[1:]}.", ""] if often else [])]
            if heading == "[calibration]":
                lines += ["`file`: a calibration that `relnav calibrate psd` wrote, in the model's folder.", ""]
                continue
            lines += _table(cls)
    return "\n".join(lines)


def shipped() -> str:
    """Values of every shipped model, each with where it comes from."""
    lines: list[str] = []
    for name in list_models():
        model = relnav.load_model(name)
        lines += [f"## {name}", "", f"{model.title}.", "", "| key | value | source |", "| --- | --- | --- |"]
        for key, entry in model_values(model).items():
            cells = (f"`{key}`", f"`{entry['value']}`", entry["source"])
            lines.append("| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |")
        lines.append("")
    return "\n".join(lines)
