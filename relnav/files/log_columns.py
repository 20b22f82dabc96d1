"""What the columns of a log mean: names, units, which belong together, which nobody asked for."""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.errors import LogError
from relnav.files.units import UNITS, same_kind, split_unit
from relnav.files.wording import columns_are, listed
from relnav.geometry.linear_algebra import lengths

AXES = ("x", "y", "z")
LETTERS = "abcdefghijklmnopqrstuvwxyz"
"""A log names its beacons by letters: three or more, in order."""


def spot_columns(beacons: int) -> tuple[str, ...]:
    """Quantities of the spots of the first so many beacons."""
    return tuple(f"spot_{beacon}_{axis}" for beacon in LETTERS[:beacons] for axis in "xy")


def sigma_columns(beacons: int) -> tuple[str, ...]:
    """Quantities of their 1-sigma."""
    return tuple(f"sigma_{spot}" for spot in spot_columns(beacons))


MAY_BE_MISSING = (*spot_columns(len(LETTERS)), *sigma_columns(len(LETTERS)))
"""Quantities of which a cell may be empty: not seen; as uncertain as before."""
ACCELERATION = tuple(f"accel_{axis}" for axis in AXES)
DELTA_V = tuple(f"delta_v_{axis}" for axis in AXES)
QUATERNION = tuple(f"q_cam_from_lvlh_{axis}" for axis in (*AXES, "w"))
IMAGE_TIME = ("image_t",)
"""Middle of the exposure, where it is not the row's time."""
KIND = {"t": "s", "image_t": "s"} | dict.fromkeys(MAY_BE_MISSING, "m") | dict.fromkeys(ACCELERATION, "m_s2")
KIND |= dict.fromkeys(DELTA_V, "m_s") | dict.fromkeys(QUATERNION, "")


@dataclass(frozen=True)
class Layout:
    """Which quantities a kind of log has: those of the spots, those of the attitude, and the SI unit of each.

    `sigmas`: of the spots' noise, all or none; `may_be_missing`: those of which a cell may be empty.
    """

    spots: tuple[str, ...]
    sigmas: tuple[str, ...]
    quaternion: tuple[str, ...]
    kind: dict[str, str]
    may_be_missing: tuple[str, ...]


BEACONS = Layout(spot_columns(3), sigma_columns(3), QUATERNION, KIND, MAY_BE_MISSING)
"""A log of three or more beacons on a PSD."""


def markers(count: int) -> Layout:
    """A log of so many markers on a camera: spot_a_x_px, ..., sigma_spot_a_x_px, ..., and the chaser's attitude."""
    spots = tuple(f"{spot}_px" for spot in spot_columns(count))
    sigmas = tuple(f"{sigma}_px" for sigma in sigma_columns(count))
    quaternion = tuple(f"q_chaser_from_lvlh_{axis}" for axis in (*AXES, "w"))
    kind = (
        {"t": "s"}
        | dict.fromkeys(ACCELERATION, "m_s2")
        | dict.fromkeys(DELTA_V, "m_s")
        | dict.fromkeys(IMAGE_TIME, "s")
    )
    kind |= dict.fromkeys((*spots, *sigmas, *quaternion), "")
    return Layout(spots, sigmas, quaternion, kind, (*spots, *sigmas))


@dataclass(frozen=True)
class Columns:
    """Where each quantity stands in a row, and its factor to SI.

    `names` are the header's own words; `index` and `factor` go by quantity; `ignored` are columns of other matters.
    """

    names: tuple[str, ...]
    index: dict[str, int]
    factor: dict[str, float]
    ignored: tuple[str, ...]
    layout: Layout = BEACONS

    @cached_property
    def beacons(self) -> int:
        """Number of beacons that the log knows."""
        return sum(f"spot_{letter}_x" in self.index for letter in LETTERS)

    @cached_property
    def scaled(self) -> tuple[tuple[slice | list[int], float], ...]:
        """Which columns of a table that holds the quantities in this order are not in SI, with their factor."""
        found: dict[float, list[int]] = {}
        for position, base in enumerate(self.index):
            if self.factor[base] != 1.0:
                found.setdefault(self.factor[base], []).append(position)
        return tuple((_as_slice(positions), factor) for factor, positions in found.items())

    def has(self, group: tuple[str, ...]) -> bool:
        """Whether the log holds a group of columns."""
        return group[0] in self.index


def _as_slice(positions: list[int]) -> slice | list[int]:
    first, last = positions[0], positions[-1]
    return slice(first, last + 1) if last - first == len(positions) - 1 else positions


def _example(base: str, layout: Layout) -> str:
    kind = layout.kind[base]
    return base if not kind else f"{base}_um" if kind == "m" else f"{base}_{kind}"


def parse_header(names: list[str], where: str, layout: Layout = BEACONS) -> Columns:
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
        if layout.kind.get(name) == "":
            base, unit = name, ""
        if base not in layout.kind:
            _refuse_near_miss(name, where, layout)
            ignored.append(name)
            continue
        kind = layout.kind[base]
        if kind and (not unit or UNITS[unit][0] != kind):
            came = f"unit '{unit}' does not fit" if unit else "the unit is missing"
            choices = ", ".join(f"{base}_{other}" for other in same_kind(kind))
            raise LogError(f"{where}: column '{name}': {came}; write one of {choices}")
        if base in index:
            raise LogError(f"{where}: column '{name}' repeats '{names[index[base]]}'; keep one")
        index[base] = position
        factor[base] = UNITS[unit][1] if unit else 1.0
    spots, sigmas = layout.spots, layout.sigmas
    if layout is BEACONS:  # three, or as many as the last letter says; sigmas of all, or of none
        letters = [LETTERS.index(base.split("_")[1]) for base in index if base.startswith("spot_")]
        beacons = max(3, 1 + max(letters, default=0))
        spots, sigmas = spot_columns(beacons), sigma_columns(beacons)
    for required in ("t", *spots):
        if required not in index:
            beacons = layout is not BEACONS and any(split_unit(name)[0] in BEACONS.spots for name in names)
            raise LogError(
                f"{where}: column '{_example(required, layout)}' is missing; {columns_are(names)}"
                + ("; a log of beacons? --model three_beacon_psd, or a beacon model of yours" if beacons else "")
            )
    for group in (ACCELERATION, DELTA_V, layout.quaternion, sigmas):
        missing = [base for base in group if base not in index]
        if missing and len(missing) < len(group):
            raise LogError(
                f"{where}: column '{_example(missing[0], layout)}' is missing; the others of its group are there"
            )
    return Columns(tuple(names), index, factor, tuple(ignored), layout)


_ALONG = {"radial out is -z": "r radial", "along-track is x": "s t i along tangential transverse intrack"}
_ALONG |= {"+h is -y": "w n c normal cross crosstrack"}
RSW = {axis: lies for lies, axes in _ALONG.items() for axis in axes.split()}
"""Axes of another frame (RSW, RTN, RIC) that a log of controls may be in, as they lie in `lvlh_ccsds`."""


def _refuse_others(name: str, where: str, layout: Layout) -> None:
    """A column of another frame, or of another kind of log."""
    base, unit = split_unit(name.lower())
    quantity, _, axis = base.rpartition("_")
    if quantity in ("accel", "delta_v") and axis in RSW:
        raise LogError(
            f"{where}: column '{name}': controls are in lvlh_ccsds, with axes x, y, z, and {RSW[axis]} there: turn all "
            f"three, {quantity}_x_{unit or KIND[ACCELERATION[0]]}, ..."
        )
    if layout is BEACONS and name.startswith("spot_") and name.endswith(("_x_px", "_y_px")):
        raise LogError(
            f"{where}: column '{name}': pixels are of a camera that sees markers, this model's detector sees beacons; "
            "--model three_marker_vision, or a marker model of yours"
        )


def _refuse_near_miss(name: str, where: str, layout: Layout) -> None:
    """A column that is almost one of ours is a mistake, not another matter."""
    _refuse_others(name, where, layout)
    for base, kind in layout.kind.items():
        if len(base) > 2 and name.startswith(base + "_") and kind:
            choices = ", ".join(f"{base}_{other}" for other in same_kind(kind))
            raise LogError(f"{where}: column '{name}': unknown unit '{name[len(base) + 1 :]}'; write one of {choices}")
    near = difflib.get_close_matches(
        name, [_example(base, layout) for base in layout.kind if len(base) > 2], n=1, cutoff=0.85
    )
    if near:
        raise LogError(f"{where}: unknown column '{name}'; did you mean '{near[0]}'?")


def log_metadata(path: Path, metadata: dict[str, str], ignored: tuple[str, ...]) -> dict[str, str]:
    """What a track says of the log it came from."""
    said = {"log": path.name} | {f"log.{key}": value for key, value in metadata.items()}
    return said | ({"ignored columns": listed(ignored)} if ignored else {})


def check_quaternions(name: str, q: Matrix, lines: Sequence[int] | Vector, path: Path) -> None:
    """Refuse rows (n, 4) that are no unit quaternions.

    Raises
    ------
    LogError
        Naming the first one's line.
    """
    wrong = np.flatnonzero(np.abs(lengths(q) - 1.0) > 9e-4)
    if wrong.size:
        row = int(wrong[0])
        raise LogError(f"{path}:{int(lines[row])}: {name} {q[row].tolist()} is not a unit quaternion (x, y, z, w)")
