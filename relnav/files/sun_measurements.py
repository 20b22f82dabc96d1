"""Tables of turntable angles and the sun spots they made, checked for what usually goes wrong."""

import difflib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Vector
from relnav.errors import InputError, LogError
from relnav.files.log_columns import Columns
from relnav.files.logs import read_csv
from relnav.files.units import UNITS, same_kind, split_unit
from relnav.files.wording import columns_are
from relnav.geometry.projection_angles import direction_from_angles, direction_from_gimbal, tangents_from_direction
from relnav.sensors.aps_sun.sensor import ApsSunModel

PROJECTION, GIMBAL = ("alpha", "beta"), ("outer", "inner")
SPOT = ("spot_x_px", "spot_y_px")
STEEPEST = np.radians(89.0)
SAME_RAD = 1e-7
MOST_NAMED = 5


@dataclass(frozen=True)
class SunMeasurements:
    """Spots and the directions that made them, in SI.

    Attributes
    ----------
    spots_px, angles_rad, directions : (N, 2), (N, 2), (N, 3)
        Spot, projection angles (alpha, beta) and unit vector toward the sun, points with a spot only.
    lines : (N,)
        Line of each in the file.
    not_seen : int
        Rows without a spot.
    gimbal : bool
        Whether the file's angles are those of a turntable's gimbals.
    """

    path: Path
    spots_px: Matrix
    angles_rad: Matrix
    directions: Matrix
    lines: Vector
    not_seen: int
    gimbal: bool


def read_sun_measurements(
    path: Path, model: ApsSunModel, *, outer_axis: str = "x", incomplete: bool = False
) -> SunMeasurements:
    """Read a CSV table with columns alpha, beta (or outer, inner: gimbal angles) with their unit, spot_x_px, spot_y_px.

    Parameters
    ----------
    path : Path
        Columns of other matters are ignored; an empty spot means that none was seen.
    model : ApsSunModel
        Design values, to know what is plausible.
    outer_axis : {"x", "y"}
        Sensor axis along which the turntable's outer axis stands, for gimbal angles.
    incomplete : bool
        Take a grid that lacks nodes.

    Raises
    ------
    InputError
        Naming file, line and fix: for cells that are no numbers, repeated or missing nodes, degrees under the name of
        radians and the reverse, exchanged or mirrored axes, spots off the detector.
    """
    _, columns, values, lines = read_csv(path, turntable_columns)
    if len(values) == 0:
        raise LogError(f"{path}: no rows after the header; at least one point is expected")
    place = {base: k for k, base in enumerate(columns.index)}
    gimbal = GIMBAL[0] in place
    pair = GIMBAL if gimbal else PROJECTION
    given = values[:, [place[base] for base in pair]]
    spots = values[:, [place[base] for base in SPOT]]
    names = [columns.names[columns.index[base]] for base in pair]
    check_angles(given, lines, path, names)
    check_repeats(given, lines, path, names)
    if not incomplete:
        _check_grid(given, path, names)
    seen = np.isfinite(spots).all(axis=1)
    if seen.sum() < 6:
        raise InputError(f"{path}: {int(seen.sum())} points with a spot; a calibration needs six or more")
    check_on_detector(spots, lines, path, model.sensor.detector_size_px)
    if gimbal:
        directions = direction_from_gimbal(given[:, 0], given[:, 1], outer_axis)
    else:
        directions = direction_from_angles(given[:, 0], given[:, 1])
    tangents = tangents_from_direction(directions)
    expected = model.sensor.paraxial_height_m / model.sensor.pixel_pitch_m
    check_slopes(spots[seen], tangents[seen], path, names, expected)
    return SunMeasurements(
        path=path,
        spots_px=spots[seen],
        angles_rad=np.arctan(tangents[seen]),
        directions=directions[seen],
        lines=lines[seen],
        not_seen=int((~seen).sum()),
        gimbal=gimbal,
    )


def has_angles(names: list[str]) -> bool:
    """Whether a header has a turntable's angles."""
    return any(split_unit(name)[0] in PROJECTION + GIMBAL for name in names)


def turntable_columns(
    names: list[str], where: str, spots: tuple[str, ...] = SPOT, also: tuple[str, ...] = ()
) -> Columns:
    """Find the columns in a header: angles, those of the spots, and of the angles `also` what is there.

    Raises
    ------
    LogError
        Naming what is missing, repeated or misspelt.
    """
    index: dict[str, int] = {}
    factor: dict[str, float] = {}
    ignored: list[str] = []
    angles = PROJECTION + GIMBAL + also
    wanted = [f"{base}_deg" for base in angles] + list(spots)
    for position, name in enumerate(names):
        base, unit = split_unit(name)
        if name in spots:
            base, unit = name, ""
        elif base not in angles:
            near = difflib.get_close_matches(name, wanted, n=1, cutoff=0.8)
            if near:
                raise LogError(f"{where}: unknown column '{name}'; did you mean '{near[0]}'?")
            ignored.append(name)
            continue
        elif not unit or UNITS[unit][0] != "rad":
            came = f"unit '{unit}' does not fit" if unit else "the unit is missing"
            choices = ", ".join(f"{base}_{other}" for other in same_kind("rad"))
            raise LogError(f"{where}: column '{name}': {came}; write one of {choices}")
        if base in index:
            raise LogError(f"{where}: column '{name}' repeats '{names[index[base]]}'; keep one")
        index[base] = position
        factor[base] = UNITS[unit][1] if unit else 1.0
    pairs = [pair for pair in (PROJECTION, GIMBAL) if any(base in index for base in pair)]
    if len(pairs) == 2:
        raise LogError(f"{where}: both alpha, beta (projection angles) and outer, inner (gimbal angles); keep one pair")
    for base in (*(pairs[0] if pairs else PROJECTION), *spots):
        if base not in index:
            example = base if base in spots else f"{base}_deg"
            raise LogError(f"{where}: column '{example}' is missing; {columns_are(names)}")
    return Columns(tuple(names), index, factor, tuple(ignored))


def check_angles(given: Matrix, lines: Vector, path: Path, names: list[str]) -> None:
    """InputError for an angle that is empty, or of a sun above the detector."""
    for k, name in enumerate(names):
        column = given[:, k]
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise InputError(f"{path}:{int(lines[bad[0]])}: column '{name}' is empty or no finite number")
        steep = np.flatnonzero(np.abs(column) >= STEEPEST)
        if steep.size:
            base, unit = split_unit(name)
            came = column[steep[0]] / UNITS[unit][1]
            hint = f"; degrees? then name it {base}_deg" if unit != "deg" else "; the sun lies above the detector"
            raise InputError(f"{path}:{int(lines[steep[0]])}: column '{name}' is {came:.6g}, beyond 89 deg{hint}")


def check_repeats(given: Matrix, lines: Vector, path: Path, names: list[str]) -> None:
    """InputError for a position that was measured twice."""
    first: dict[tuple[int, ...], int] = {}
    for row, node in enumerate(map(tuple, np.rint(given / SAME_RAD).astype(np.int64).tolist())):
        if node in first:
            raise InputError(
                f"{path}:{int(lines[row])}: the node {_node(given[row], names)} was measured in line "
                f"{int(lines[first[node]])} already; average them or keep one"
            )
        first[node] = row


def _check_grid(given: Matrix, path: Path, names: list[str]) -> None:
    """Points that stand on most nodes of a grid should stand on all."""
    whole = np.rint(given / SAME_RAD).astype(np.int64)
    (first, i), (second, j) = (np.unique(whole[:, k], return_inverse=True) for k in range(2))
    nodes = len(first) * len(second)
    if min(len(first), len(second)) < 3 or len(given) <= nodes // 2 or len(given) == nodes:
        return
    there: Flags = np.zeros((len(first), len(second)), dtype=bool)
    there[i, j] = True
    missing: Codes = np.argwhere(~there)
    named = ", ".join(_node(SAME_RAD * np.array([first[a], second[b]]), names) for a, b in missing[:MOST_NAMED])
    more = ", ..." if len(missing) > MOST_NAMED else ""
    raise InputError(
        f"{path}: the grid of {len(first)} x {len(second)} nodes lacks {len(missing)}: {named}{more}; measure them, or "
        "say --incomplete if they were left out on purpose"
    )


def check_on_detector(spots: Matrix, lines: Vector, path: Path, size: tuple[int, int]) -> None:
    """InputError for a spot (N, 2) px that lies off the detector."""
    off = np.flatnonzero(np.any((spots < -0.5) | (spots > np.array(size) - 0.5), axis=1))
    if off.size:
        x, y = spots[off[0]].tolist()
        raise InputError(
            f"{path}:{int(lines[off[0]])}: the spot ({x:.6g}, {y:.6g}) px lies off the detector of {size[0]} x "
            f"{size[1]} px; spots are in whole-detector pixels, not millimetres and not of the window"
        )


def check_slopes(
    spots: Matrix, tangents: Matrix, path: Path, names: list[str], expected: float, named: tuple[str, ...] = SPOT
) -> None:
    """Spots must follow the tangents by about `expected` px, as the model says: else units or axes are wrong."""
    design = np.column_stack([tangents, np.ones(len(tangents))])
    if np.linalg.matrix_rank(design) < 3:
        raise InputError(f"{path}: all points lie on one line of the field; measure over the whole field")
    slopes = np.linalg.lstsq(design, spots, rcond=None)[0][:2].T  # d(x, y)/d(tan alpha, tan beta)
    own, cross = np.diag(slopes), np.array([slopes[0, 1], slopes[1, 0]])
    if np.abs(cross).min() > np.abs(own).max():
        raise InputError(
            f"{path}: {named[0]} follows '{names[1]}' and {named[1]} '{names[0]}': the axes are exchanged; exchange "
            "the names of the two angle columns, or of the two spot columns"
        )
    if np.any(own < 0.0):
        spot, angle = (named[0], names[0]) if own[0] < 0.0 else (named[1], names[1])
        raise InputError(f"{path}: {spot} falls where '{angle}' grows: turn the sign of one of them")
    ratio = float(np.mean(own)) / expected
    if 20.0 < ratio < 150.0:
        raise InputError(
            f"{path}: spots move {ratio:.0f} times as far as the model expects: these angles are radians under the "
            f"name of degrees; name the columns {split_unit(names[0])[0]}_rad, {split_unit(names[1])[0]}_rad"
        )
    if not 0.5 < ratio < 2.0:
        raise InputError(
            f"{path}: spots move {ratio:.3g} times as far as the model's hole height and pixel pitch say; check them "
            "in the model, and the units of the angles"
        )


def _node(angles: Vector, names: list[str]) -> str:
    values = [angles[k] / UNITS[split_unit(names[k])[1]][1] for k in range(len(names))]
    return f"({', '.join(format(value, '.6g') for value in values)})"
