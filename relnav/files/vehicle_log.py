"""A vehicle's log, one row an observation, and the estimates that its filter makes of it.

Columns of a log (.csv or .parquet): t_s, sensor, v0, v1, ... A row has as many values as its sensor gives, in SI or px
as `VehicleNavigator.observe` takes them, and leaves the others empty; of lights an empty pair is a spot not seen. A sun
direction is followed by xx, xy, xz, yy, yz, zz of its covariance. Rows may stand in any order.
"""

import csv
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from relnav.arrays import Vector
from relnav.errors import LogError, UsageError
from relnav.files.atomic import replacing
from relnav.files.tables import check_format, head_text, relnav_version
from relnav.files.text_table import MOST_ROWS, TextTable, table_of
from relnav.files.vehicle_parquet import check_columns
from relnav.files.wording import shown
from relnav.geometry.linear_algebra import lengths
from relnav.sensors.sun_direction import SunDirection, direction_with_covariance
from relnav.simulation.vehicle_sensors import Value, VehicleRun
from relnav.spacecraft import GYRO, POINTS, RESERVED, STAR, THRUST, Vehicle
from relnav.vehicle.estimate import VehicleEstimate
from relnav.vehicle.hand_over import Told
from relnav.vehicle.navigator import LONGEST_PREDICTION_S, VehicleNavigator
from relnav.vehicle.replay import TOO_OLD, check_gap
from relnav.vehicle.smoothing import VehicleSmoother

_UPPER_3 = np.triu_indices(3)

ROWS_TRIED = 1000
"""Whose times are looked at for their unit."""

Row = tuple[str, float, Value]
"""Sensor, time, value."""


def widths(vehicle: Vehicle) -> dict[str, int]:
    """How many values a row of each sensor has."""
    count = dict.fromkeys(RESERVED, 3)
    for name in vehicle.sensor:
        kind = vehicle.kind(name)
        count[name] = 2 * len(vehicle.points_m(name)) if kind == POINTS else 4 if kind == STAR else 9
    return count


def write_vehicle_log(run: VehicleRun, path: Path, metadata: dict[str, str]) -> None:
    """Write the observations of a simulated run (.csv or .parquet), in the order in which they arrive."""
    check_format(path)
    width, stated = max(widths(run.truth.vehicle).values()), {"relnav": relnav_version()} | metadata
    rows = ((seen.sensor, seen.t_s, _numbers(seen.value)) for seen in run.observations)
    with replacing(path, ".csv") as temporary:
        if path.suffix.lower() == ".parquet":
            from relnav.files.vehicle_parquet import write_named_rows

            return write_named_rows(temporary, width, rows, stated)
        with temporary.open("w", newline="", encoding="utf-8") as file:
            file.write(head_text(".csv", ("t_s", "sensor", *(f"v{k}" for k in range(width))), stated))
            writer = csv.writer(file, lineterminator="\n")
            for name, t_s, numbers in rows:
                cells = ["" if math.isnan(value) else repr(value) for value in numbers]
                writer.writerow((repr(t_s), name, *cells, *[""] * (width - len(cells))))


def _numbers(value: Value) -> list[float]:
    if isinstance(value, SunDirection):
        return [*value.direction.tolist(), *value.covariance[_UPPER_3].tolist()]
    flat: list[float] = value.ravel().tolist()
    return flat


def read_vehicle_log(path: Path | TextTable, vehicle: Vehicle, tell: Callable[[str], None] | None = None) -> list[Row]:
    """The observations of a log (.csv or .parquet), by time; `tell` takes a sentence if they stand far from it.

    Raises
    ------
    LogError
        For what is no such log, or one in milliseconds; the message names the line.
    """
    rows: list[Row] = []
    name = path if isinstance(path, Path) else path.path
    for row in _parquet_rows(path, vehicle) if is_parquet(path) else _text_rows(table_of(path), vehicle):
        rows.append(row)
        if len(rows) > MOST_ROWS:
            raise LogError(f"{name}: more than {MOST_ROWS} rows; split the log in time")
    if not rows:
        raise LogError(f"{name}: no row after the header; one an observation is expected")
    back_s, sensor = _steps_back(rows)
    if tell is not None and back_s > vehicle.filter.replay_window_s:
        tell(
            f"rows of {sensor} go back in time by {back_s:g} s, and all were sorted by time: if its clock was set back "
            "there, split the log there"
        )
    rows.sort(key=lambda row: row[1])
    _check_unit(rows, vehicle, str(name))
    return rows


def _steps_back(rows: list[Row]) -> tuple[float, str]:
    """By how much the times of one sensor's rows go back at the most from row to row, s, and of which."""
    before: dict[str, float] = {}
    most = 0.0, ""
    for sensor, t_s, _ in rows:
        most = max(most, (before.get(sensor, t_s) - t_s, sensor))
        before[sensor] = t_s
    return most


def _check_unit(rows: list[Row], vehicle: Vehicle, name: str) -> None:
    """Refuse times, in order, that are milliseconds: the gyro's are a thousand times as far apart as its rate says."""
    period_s = 1.0 / vehicle.gyro.rate_hz
    times = np.array([t_s for sensor, t_s, _ in rows[:ROWS_TRIED] if sensor == GYRO])
    apart_s = float(np.median(np.diff(times))) if len(times) > 2 else 0.0
    if abs(apart_s - 1e3 * period_s) < 0.1 * 1e3 * period_s:
        raise LogError(
            f"{name}: rows of {GYRO} are {apart_s:g} s apart, and {period_s:g} s by its rate_hz: the times are "
            "milliseconds; divide them by 1000"
        )


def is_parquet(path: Path | TextTable) -> TypeGuard[Path]:
    """Whether a log is Parquet, by its ending."""
    return isinstance(path, Path) and path.suffix.lower() == ".parquet"


def _text_rows(table: TextTable, vehicle: Vehicle) -> Iterator[Row]:
    opened_vehicle_log(table)
    counts = widths(vehicle)
    for line, text in table.rows():
        yield row_of(table, line, text, vehicle, counts)


def _parquet_rows(path: Path, vehicle: Vehicle) -> Iterator[Row]:
    from relnav.files.vehicle_parquet import named_rows

    counts = widths(vehicle)
    for number, name, t_s, values in named_rows(path):
        came = "" if math.isnan(t_s) else repr(t_s)
        yield _row(name, t_s, came, values, vehicle, counts, f"{path}:{number}")


def opened_vehicle_log(table: TextTable) -> TextTable:
    """The table, if its header is that of a vehicle's log.

    Raises
    ------
    LogError
        If it is not.
    """
    check_columns(table.names, f"{table.path}:{table.line}")
    return table


def row_of(table: TextTable, line: int, text: str, vehicle: Vehicle, counts: dict[str, int]) -> Row:
    """The observation in a line; counts: the vehicle's `widths`.

    Raises
    ------
    LogError
        For a line that is none.
    """
    cells = table.cells(line, text)
    name, t_s = cells[1].strip(), table.number(cells[0], line, "t_s")
    where = f"{table.path}:{line}"
    values = [table.number(cell, line, f"v{k}") for k, cell in enumerate(cells[2:])]
    return _row(name, t_s, cells[0], np.array(values), vehicle, counts, where)


def _row(name: str, t_s: float, came: str, values: Vector, vehicle: Vehicle, counts: dict[str, int], where: str) -> Row:
    """The observation of a row with these values (width,), NaN = empty; came: its time as it stood there."""
    if name not in counts:
        known = ", ".join(counts)
        raise LogError(f"{where}: no sensor '{shown(name, 80)}' in model {vehicle.name}; there are {known}")
    if not math.isfinite(t_s):
        raise LogError(f"{where}: column 't_s': a time is expected; got {shown(repr(came), 80)}")
    count = counts[name]
    if len(values) < count or not np.isnan(values[count:]).all():
        raise LogError(f"{where}: {name} has {count} values, v0 to v{count - 1}; the other cells stay empty")
    return name, t_s, _value(values[:count].copy(), name, vehicle, where)


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


def too_late(vehicle: Vehicle) -> str:
    """What is said of an observation from before the replay window."""
    return f"came too late for the window (replay_window_s = {vehicle.filter.replay_window_s:g})"


def filter_rows(
    rows: Iterable[Row],
    vehicle: Vehicle,
    every_s: float = 1.0,
    refuse: Callable[[ValueError], None] | None = None,
    late: Counter[str] | None = None,
    start: Mapping[str, Any] | None = None,
) -> Iterator[VehicleEstimate]:
    """The estimate every so many seconds, and at the end, from observations in the order of time.

    `refuse` takes what the filter says of an observation that it cannot take, or that comes too late for its window;
    without it that ends the run. `late` counts the latter by sensor. `start`: as of `filter_vehicle_log`.

    Raises
    ------
    LogError
        For an observation that the filter cannot take.
    """
    nav: VehicleNavigator | None = None
    due, known = 0.0, {} if start is None else start
    for name, t_s, value in _begun(rows, known):
        try:
            if nav is None:
                nav = VehicleNavigator(vehicle, **{"t_s": t_s, **known})
                due = nav.newest_s + every_s
            check_gap(name, t_s, nav.newest_s)
            while due <= t_s:
                if due <= nav.newest_s + LONGEST_PREDICTION_S:
                    yield nav.state(due)
                due += every_s
            if nav.observe(name, t_s, value) is TOO_OLD:
                if late is not None:
                    late[name] += 1
                raise ValueError(f"{name} {too_late(vehicle)}")
        except ValueError as error:
            told = LogError(f"at {t_s!r} s: {error}")
            if refuse is None:
                raise told from error
            refuse(told)
    if nav is not None:
        yield nav.state()


def _begun(rows: Iterable[Row], start: Mapping[str, Any]) -> Iterator[Row]:
    """The rows from the start on, and first of all the command to the thrusters that holds then."""
    command: Row | None = None
    start_s = start.get("t_s", -math.inf)
    for row in rows:
        name, t_s, value = row
        if t_s < start_s:
            command = (name, start_s, value) if name == THRUST else command
            continue
        if command is not None:
            yield command
            command = None
        yield row


def smoothed_rows(
    rows: Iterable[Row], vehicle: Vehicle, every_s: float = 1.0, start: Mapping[str, Any] | None = None
) -> list[VehicleEstimate]:
    """The smoothed estimate every so many seconds, and at the end, from observations in the order of time.

    Memory as of `VehicleSmoother`: 50 kB an estimate, 1 kB an observation. `start`: as of `filter_vehicle_log`.

    Raises
    ------
    LogError
        For an observation that the filter cannot take, or a target whose attitude stays ambiguous.
    """
    smoother: VehicleSmoother | None = None
    start_s, end_s, known = 0.0, 0.0, {} if start is None else start
    for name, t_s, value in _begun(rows, known):
        try:
            if smoother is None:
                start_s = known.get("t_s", t_s)
                smoother = VehicleSmoother(vehicle, **{**known, "t_s": start_s})
            end_s = t_s
            smoother.observe(name, t_s, value)
        except ValueError as error:
            raise LogError(f"at {t_s!r} s: {error}") from error
    if smoother is None:
        return []
    times = start_s + every_s * np.arange(1, math.floor((end_s - start_s) / every_s) + 1)
    try:
        return smoother.estimates([*times.tolist(), end_s])
    except ValueError as error:
        raise LogError(str(error)) from error


def filter_vehicle_log(
    path: Path | str,
    vehicle: Vehicle,
    *,
    every_s: float = 1.0,
    smooth: bool = False,
    start: Mapping[str, Any] | None = None,
) -> list[VehicleEstimate]:
    """The estimates that a vehicle's filter makes of a log, every so many seconds and at the end.

    Parameters
    ----------
    path : Path or str
        The log (.csv or .parquet), one row an observation: t_s, sensor, v0, v1, ...
    vehicle : Vehicle
        `relnav.load_model("rendezvous_demo")`, or your own file.
    every_s : float
        Seconds between two of them, above 0; each holds 50 kB.
    smooth : bool
        Whether each rests on all of the log, not on what came before it alone (`relnav.vehicle.smoothing`).
    start : mapping, optional
        What is known at the start, by the names of `VehicleNavigator`'s arguments, "position_m" to
        "dcm_inertial_from_chaser", and "t_s", when: that of the first row if left out. Of earlier rows only the last
        command to the thrusters is used.

    Raises
    ------
    LogError
        If the log cannot be read; names file, line and column. Or for a start that cannot be.
    UsageError
        For another every_s, and for another name in start.
    """
    names = "t_s", *Told.__annotations__
    for name in {} if start is None else start:
        if name not in names:
            raise UsageError(f"start: there is no {name!r}; what may be known at the start is {', '.join(names)}")
    if not 0.0 < every_s < math.inf:
        raise UsageError(f"every_s is a time above 0 s; got {every_s!r}")
    rows = read_vehicle_log(Path(path), vehicle)
    if smooth:
        return smoothed_rows(rows, vehicle, every_s, start)
    return list(filter_rows(rows, vehicle, every_s, start=start))
