"""From a TOML table to a plain dataclass in SI units: units in keys, provenance, and errors that give the fix."""

import dataclasses
import difflib
import math
import re
import tomllib
import typing
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from relnav.errors import ModelError, UsageError
from relnav.files.units import UNITS, same_kind, split_unit, to_si
from relnav.files.wording import printable, shown

SOURCES = ("paper", "assumed", "derived")
MOST_CHARACTERS, DEEPEST, MOST_PROBLEMS = 200_000, 12, 20
"""Of a file; of its nesting; of the lines of a message."""
LONG_CHAIN = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){20}""")
"""A dotted key of twenty parts, over which a TOML reader takes the square of its length."""


class Problems:
    """Collects what is wrong with one file, so that a user sees all of it at once."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.lines: list[str] = []
        self._text = text.splitlines()

    def add(self, key_path: str, message: str) -> None:
        """Note one problem of the value at `section.key`; ModelError with all so far where they become too many."""
        self.lines.append(shown(f"{self.path}:{self._line(key_path)}: {shown(key_path, 80)}: {message}", 1000))
        if len(self.lines) == MOST_PROBLEMS:
            self.lines.append(f"{self.path}: and perhaps more; only the first {MOST_PROBLEMS} are listed")
            self.raise_if_any()

    def raise_if_any(self) -> None:
        """Raise ModelError with every problem, a line each."""
        if self.lines:
            raise ModelError("\n".join(self.lines))

    def _line(self, key_path: str) -> int:
        section, _, key = key_path.rpartition(".")
        current, found = "", 1
        for number, line in enumerate(self._text, start=1):
            stripped = line.strip()
            if stripped.startswith("["):
                current = stripped.strip("[]").split("]")[0].strip()
                if current in (key_path, section):
                    found = number
            elif current == section and stripped.split("=")[0].strip() == key:
                return number
        return found


def read_toml(path: Path) -> tuple[dict[str, Any], Problems]:
    """Parse a TOML file; the Problems that come with it know its lines.

    Raises
    ------
    ModelError
        If the file cannot be read or is not TOML.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            text = file.read(MOST_CHARACTERS + 1)
        if len(text) > MOST_CHARACTERS:
            raise ModelError(f"{path}: longer than {MOST_CHARACTERS} characters; a model or calibration is expected")
        if LONG_CHAIN.search(text):
            raise ModelError(f"{path}: a key of twenty parts or more; keys are written [section] and key")
        table = tomllib.loads(text)
        if _deeper(table, DEEPEST):
            raise ModelError(f"{path}: nested deeper than {DEEPEST} levels; sections of keys and values are expected")
        return table, Problems(path, text)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}: not a text file in UTF-8") from error
    except ModelError:
        raise
    except tomllib.TOMLDecodeError as error:
        raise ModelError(f"{path}: not valid TOML: {shown(error)}") from error
    except RecursionError as error:
        raise ModelError(f"{path}: nested deeper than {DEEPEST} levels; a model is expected") from error
    except ValueError as error:  # a whole number of thousands of digits
        raise ModelError(f"{path}: not valid TOML: a number is too long: {shown(error)}") from error


def _deeper(value: Any, levels: int) -> bool:
    """Whether tables and arrays are nested in more than so many levels."""
    held = list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
    return bool(held) and (levels == 0 or any(_deeper(item, levels - 1) for item in held))


def find_field(key: str, names: list[str]) -> tuple[str, float, str]:
    """The field that a key means ("" if it means none), its factor to SI, and what is wrong with the key, if it is."""
    if key in names:
        return key, 1.0, ""
    base, unit = split_unit(key)
    if unit:
        si, factor = UNITS[unit]
        if f"{base}_{si}" in names:
            return f"{base}_{si}", factor, ""
    for name in names:
        name_base, name_unit = split_unit(name)
        if name_unit and base in (name_base, name):
            given = f"unit '{unit}' does not fit" if unit else "the unit is missing from the key"
            choices = ", ".join(f"{name_base}_{other}" for other in same_kind(name_unit))
            return name, 1.0, f"{given}; write one of {choices}"
    near = difflib.get_close_matches(base, [split_unit(name)[0] for name in names], n=1, cutoff=0.6)
    meant = [name for name in names if near and split_unit(name)[0] == near[0]]
    fits = bool(meant and unit and UNITS[unit][0] == split_unit(meant[0])[1])
    best = f"{near[0]}_{unit}" if fits else meant[0] if meant else ""
    hint = f"did you mean '{best}'?" if best else f"known keys are {', '.join(names)}"
    return meant[0] if meant else "", 1.0, f"unknown key; {hint}"


def _scale(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return tuple(_scale(item, factor) for item in value)
    if factor != 1.0 and isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return to_si(float(value), factor)
        except OverflowError:
            return value  # a whole number beyond all floats: the validation below names it
    return value


def _numbers_finite(value: Any) -> bool:
    if isinstance(value, list):
        return all(_numbers_finite(item) for item in value)
    return not isinstance(value, float) or math.isfinite(value)


def _shown(value: Any) -> str:
    """A value for a message: the beginning, if it is long."""
    try:
        text = repr(value)
        return printable(text if len(text) <= 80 else text[:76] + " ...")
    except ValueError:  # a whole number of thousands of digits, written in another base
        return "a number of thousands of digits"


def _validated(hint: Any, value: Any) -> Any:
    adapter: TypeAdapter[Any] = TypeAdapter(hint, config=ConfigDict(strict=True))
    return adapter.validate_python(value)


def required_of(cls: Any) -> list[str]:
    """Fields of a dataclass that have no default."""
    none = dataclasses.MISSING
    return [one.name for one in dataclasses.fields(cls) if one.default is none and one.default_factory is none]


def build(cls: Any, table: Any, where: str, problems: Problems, provenance: dict[str, str] | None) -> Any:
    """Make one dataclass from one TOML table; None, with the problems noted, if it cannot be made.

    Fields are in SI; keys may use any unit of the same kind. With `provenance`, a value may be an inline table
    {value, source, why}, and where it comes from is written there.
    """
    if not isinstance(table, dict):
        problems.add(where, f"a table is expected, written [{where}]; got {_shown(table)}")
        return None
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = [field.name for field in dataclasses.fields(cls)]
    values: dict[str, Any] = {}
    before = len(problems.lines)
    named: dict[str, str] = {}
    for key, raw in table.items():
        key_path = f"{where}.{key}" if where else key
        name, factor, wrong = find_field(key, fields)
        if wrong:
            problems.add(key_path, wrong)
            named.setdefault(name, key)
            continue
        if name in named:
            problems.add(key_path, f"the same quantity is given as '{named[name]}' too; keep one")
            continue
        named[name] = key
        value, origin = raw, "unstated"
        if provenance is not None and isinstance(raw, dict):
            unknown = set(raw) - {"value", "source", "why"}
            if "value" not in raw or unknown or str(raw.get("source")) not in SOURCES or not raw.get("why"):
                problems.add(
                    key_path,
                    'a value with its source is written { value = ..., source = "paper|assumed|derived", '
                    f'why = "..." }}; got {_shown(raw)}',
                )
                continue
            value, origin = raw["value"], printable(f"{raw['source']}: {raw['why']}")
        if not _numbers_finite(value):
            problems.add(key_path, f"a finite number is expected; got {_shown(value)}")
            continue
        try:
            values[name] = _validated(hints[name], _scale(value, factor))
        except ValidationError as error:
            first = error.errors()[0]
            message = first["msg"][0].lower() + first["msg"][1:]
            if typing.get_origin(hints[name]) is tuple and first["type"] in ("missing", "too_long"):
                message = f"{len(typing.get_args(hints[name]))} values are expected"
            problems.add(key_path, f"{message}; got {_shown(value)}")
            continue
        if provenance is not None:
            provenance[key_path] = origin
    for name in required_of(cls):
        if name not in named:
            problems.add(where or name, f"'{name}' is missing")
    if len(problems.lines) > before:
        return None
    try:
        return cls(**values)
    except ValueError as error:
        problems.add(where, str(error))
        return None


def change_value(table: dict[str, Any], sections: dict[str, Any], key: str, value: Any) -> None:
    """Replace a value of a parsed file by key ("focal_length_mm" or "sensor.focal_length_mm"), whatever its unit was.

    Raises
    ------
    UsageError
        If no section has that key, or more than one.
    """
    section, _, name = key.rpartition(".")
    found = []
    for where, cls in sections.items():
        names = [field.name for field in dataclasses.fields(cls)]
        meant, _, wrong = find_field(name, names)
        if section in ("", where) and not wrong:
            found.append((where, meant, names))
    if len(found) != 1:
        places = (
            f"it stands in {', '.join(f'{where}.{name}' for where, _, _ in found)}" if found else "no section has it"
        )
        raise UsageError(f"'{key}' cannot be set: {places}; write section.key with its unit, as the model's file does")
    where, meant, names = found[0]
    entries = table.setdefault(where, {})
    for other in [entry for entry in entries if find_field(entry, names)[0] == meant]:
        del entries[other]
    entries[name] = {"value": value, "source": "assumed", "why": "set for this run"}
