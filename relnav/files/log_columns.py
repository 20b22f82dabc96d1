"""What the columns of a log mean: names, units, which belong together, which nobody asked for."""

import difflib
from dataclasses import dataclass

from relnav.errors import LogError
from relnav.files.units import UNITS, same_kind, split_unit

AXES = ("x", "y", "z")
SPOTS = tuple(f"spot_{beacon}_{axis}" for beacon in "abc" for axis in "xy")
SPOT_SIGMAS = tuple(f"sigma_{spot}" for spot in SPOTS)
ACCELERATION = tuple(f"accel_{axis}" for axis in AXES)
DELTA_V = tuple(f"delta_v_{axis}" for axis in AXES)
QUATERNION = tuple(f"q_cam_from_lvlh_{axis}" for axis in (*AXES, "w"))
KIND = {"t": "s"} | dict.fromkeys(SPOTS, "m") | dict.fromkeys(ACCELERATION, "m_s2") | dict.fromkeys(DELTA_V, "m_s")
KIND |= dict.fromkeys(QUATERNION, "")


@dataclass(frozen=True)
class Columns:
    """Where each quantity stands in a row, and its factor to SI.

    `names` are the header's own words; `index` and `factor` go by quantity; `ignored` are columns of other matters.
    """

    names: tuple[str, ...]
    index: dict[str, int]
    factor: dict[str, float]
    ignored: tuple[str, ...]

    def has(self, group: tuple[str, ...]) -> bool:
        """Whether the log holds a group of columns."""
        return group[0] in self.index


def _example(base: str) -> str:
    kind = KIND[base]
    return base if not kind else f"{base}_um" if kind == "m" else f"{base}_{kind}"


def parse_header(names: list[str], where: str) -> Columns:
    """Find the log's columns in a header.

    Raises
    ------
    LogError
        For a missing, repeated, misspelt column or a unit that does not fit; `where` ("file:line") leads.
    """
    index: dict[str, int] = {}
    factor: dict[str, float] = {}
    ignored: list[str] = []
    for position, name in enumerate(names):
        base, unit = split_unit(name)
        if name in KIND and KIND[name] == "":
            base, unit = name, ""
        if base not in KIND:
            _refuse_near_miss(name, where)
            ignored.append(name)
            continue
        kind = KIND[base]
        if kind and (not unit or UNITS[unit][0] != kind):
            came = f"unit '{unit}' does not fit" if unit else "the unit is missing"
            choices = ", ".join(f"{base}_{other}" for other in same_kind(kind))
            raise LogError(f"{where}: column '{name}': {came}; write one of {choices}")
        if base in index:
            raise LogError(f"{where}: column '{name}' repeats '{names[index[base]]}'; keep one")
        index[base] = position
        factor[base] = UNITS[unit][1] if unit else 1.0
    for required in ("t", *SPOTS):
        if required not in index:
            raise LogError(f"{where}: column '{_example(required)}' is missing; the columns are {', '.join(names)}")
    for group in (ACCELERATION, DELTA_V, QUATERNION):
        missing = [base for base in group if base not in index]
        if missing and len(missing) < len(group):
            raise LogError(f"{where}: column '{_example(missing[0])}' is missing; the others of its group are there")
    return Columns(tuple(names), index, factor, tuple(ignored))


def _refuse_near_miss(name: str, where: str) -> None:
    """A column that is almost one of ours is a mistake, not another matter."""
    for base in KIND:
        if len(base) > 2 and name.startswith(base + "_") and base not in QUATERNION:
            choices = ", ".join(f"{base}_{other}" for other in same_kind(KIND[base]))
            raise LogError(f"{where}: column '{name}': unknown unit '{name[len(base) + 1 :]}'; write one of {choices}")
    near = difflib.get_close_matches(name, [_example(base) for base in KIND if len(base) > 2], n=1, cutoff=0.85)
    if near:
        raise LogError(f"{where}: unknown column '{name}'; did you mean '{near[0]}'?")
