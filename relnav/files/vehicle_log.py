"""A vehicle's log, one row an observation, and the estimates that its filter makes of it.

Columns of a log (.csv): t_s, sensor, v0, v1, ... A row has as many values as its sensor gives, in SI or px as
`VehicleNavigator.observe` takes them, and leaves the others empty; of lights an empty pair is a spot not seen. A sun
direction is followed by xx, xy, xz, yy, yz, zz of its covariance. Rows may stand in any order.
"""

import csv
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from relnav.arrays import Vector
from relnav.errors import LogError, UsageError
from relnav.files.atomic import is_stream, replacing
from relnav.files.attitude_reading import reading_that_looks
from relnav.files.tables import relnav_version
from relnav.files.text_table import MOST_ROWS, TextTable, table_of
from relnav.files.wording import printable, shown
from relnav.geometry.linear_algebra import lengths
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.sun_direction import SunDirection, direction_with_covariance
from relnav.simulation.vehicle_sensors import Value, VehicleRun
from relnav.spacecraft import POINTS, RESERVED, STAR, Vehicle
from relnav.vehicle.navigator import LONGEST_PREDICTION_S, VehicleEstimate, VehicleNavigator
from relnav.vehicle.orbit_frame import OrbitFrame

FAR_FROM_HELD_DEG = 30.0
"""No chaser on its way to a port turns so far away from the attitude of its file."""
_UPPER_3 = np.triu_indices(3)

Row = tuple[str, float, Value]
"""Sensor, time, value."""


def widths(vehicle: Vehicle) -> dict[str, int]:
    """How many values a row of each sensor has."""
    count = dict.fromkeys(RESERVED, 3)
    for name in vehicle.sensor:
        kind = vehicle.kind(name)
        count[name] = 2 * len(vehicle.points_m(name)) if kind == POINTS else 4 if kind == STAR else 9
    return count


def check_log_format(path: Path) -> None:
    """Refuse a log of another kind than .csv: a vehicle's log names its sensors in words.

    Raises
    ------
    UsageError
        Naming the ending that can be written.
    """
    if path.suffix.lower() != ".csv" and not (path.suffix == "" and is_stream(path)):
        raise UsageError(f"{path}: a vehicle's log ends in .csv; got '{path.suffix}'")


def write_vehicle_log(run: VehicleRun, path: Path, metadata: dict[str, str]) -> None:
    """Write the observations of a simulated run (.csv), in the order in which they arrive."""
    check_log_format(path)
    width = max(widths(run.truth.vehicle).values())
    with replacing(path, ".csv") as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        head = {"relnav": relnav_version()} | metadata
        file.writelines(f"# {printable(key)} = {printable(value)}\n" for key, value in head.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("t_s", "sensor", *(f"v{k}" for k in range(width))))
        for seen in run.observations:
            numbers = _numbers(seen.value)
            cells = ["" if math.isnan(value) else repr(value) for value in numbers]
            writer.writerow((repr(seen.t_s), seen.sensor, *cells, *[""] * (width - len(cells))))


def _numbers(value: Value) -> list[float]:
    if isinstance(value, SunDirection):
        return [*value.direction.tolist(), *value.covariance[_UPPER_3].tolist()]
    flat: list[float] = value.ravel().tolist()
    return flat


def read_vehicle_log(path: Path | TextTable, vehicle: Vehicle) -> list[Row]:
    """The observations of a log (.csv), by time.

    Raises
    ------
    LogError
        For what is no such log; the message names the line.
    """
    table = opened_vehicle_log(table_of(path))
    rows: list[Row] = []
    counts = widths(vehicle)
    for line, text in table.rows():
        rows.append(row_of(table, line, text, vehicle, counts))
        if len(rows) > MOST_ROWS:
            raise LogError(f"{table.path}: more than {MOST_ROWS} rows; split the log in time")
    if not rows:
        raise LogError(f"{table.path}: no row after the header; one an observation is expected")
    return sorted(rows, key=lambda row: row[1])


def opened_vehicle_log(table: TextTable) -> TextTable:
    """The table, if its header is that of a vehicle's log.

    Raises
    ------
    LogError
        If it is not.
    """
    if table.names[:2] != ["t_s", "sensor"] or table.names[2:] != [f"v{k}" for k in range(len(table.names) - 2)]:
        raise LogError(
            f"{table.path}:{table.line}: a vehicle's log has columns t_s, sensor, v0, v1, ...; got "
            f"{shown(', '.join(table.names), 120)}"
        )
    return table


def row_of(table: TextTable, line: int, text: str, vehicle: Vehicle, counts: dict[str, int]) -> Row:
    """The observation in a line; counts: the vehicle's `widths`.

    Raises
    ------
    LogError
        For a line that is none.
    """
    path, cells = table.path, table.cells(line, text)
    name, t_s = cells[1].strip(), table.number(cells[0], line, "t_s")
    if name not in counts:
        known = ", ".join(counts)
        raise LogError(f"{path}:{line}: no sensor '{shown(name, 80)}' in model {vehicle.name}; there are {known}")
    if not math.isfinite(t_s):
        raise LogError(f"{path}:{line}: column 't_s': a time is expected; got {shown(repr(cells[0]), 80)}")
    values = [table.number(cell, line, f"v{k}") for k, cell in enumerate(cells[2:])]
    count = counts[name]
    if len(values) < count or not all(math.isnan(value) for value in values[count:]):
        raise LogError(f"{path}:{line}: {name} has {count} values, v0 to v{count - 1}; the other cells stay empty")
    return name, t_s, _value(np.array(values[:count]), name, vehicle, f"{path}:{line}")


def _value(values: Vector, name: str, vehicle: Vehicle, where: str) -> Value:
    kind = None if name in RESERVED else vehicle.kind(name)
    if kind == POINTS:
        return values.reshape(-1, 2)
    if not np.isfinite(values).all():
        raise LogError(f"{where}: {name} has {len(values)} values; one is empty: leave the row out if nothing was seen")
    if kind is None or kind == STAR:
        return values
    covariance = np.empty((3, 3))
    covariance[_UPPER_3] = covariance.T[_UPPER_3] = values[3:]
    if abs(lengths(values[:3]) - 1.0) > 1e-6:
        raise LogError(f"{where}: {name}: v0 to v2 are a unit vector; got {values[:3].tolist()}")
    return direction_with_covariance(values[:3].copy(), covariance)


def attitude_note(row: Row, vehicle: Vehicle) -> str:
    """A sentence on a star sensor's quaternion that fits read another way (scalar first, inverse); else empty."""
    name, t_s, value = row
    if name in RESERVED or vehicle.kind(name) != STAR or isinstance(value, SunDirection):
        return ""
    size = float(lengths(value))
    if not 0.5 < size < 2.0:
        return ""
    inertial = OrbitFrame(vehicle.orbit).dcm_lvlh_from_inertial(t_s)
    held = vehicle.sensor[name].dcm_sensor_from_chaser @ vehicle.chaser.dcm_chaser_from_lvlh @ inertial
    said, called = dcm_from_quaternion(value / size), (f"{name}'s quaternion", ("sensor", "inertial"))
    return reading_that_looks(said, held, *called, "the attitude that is held", FAR_FROM_HELD_DEG)


def filter_rows(
    rows: Iterable[Row],
    vehicle: Vehicle,
    every_s: float = 1.0,
    refuse: Callable[[ValueError], None] | None = None,
) -> Iterator[VehicleEstimate]:
    """The estimate every so many seconds, and at the end, from observations in the order of time.

    `refuse` takes what the filter says of an observation that it cannot take; without it that ends the run.

    Raises
    ------
    LogError
        For an observation that the filter cannot take.
    """
    nav: VehicleNavigator | None = None
    due = 0.0
    for name, t_s, value in rows:
        if nav is None:
            nav, due = VehicleNavigator(vehicle, t_s=t_s), t_s + every_s
        while due <= t_s:
            if due <= nav.newest_s + LONGEST_PREDICTION_S:
                yield nav.state(due)
            due += every_s
        try:
            nav.observe(name, t_s, value)
        except ValueError as error:
            told = LogError(f"at {t_s!r} s: {error}")
            if refuse is None:
                raise told from error
            refuse(told)
    if nav is not None:
        yield nav.state()
