"""Logs of spots in CSV or Parquet: one row an epoch, read in chunks, every malformed row named by its line.

Missing data is defined here, not by a library: an empty or NaN cell of a spot column means "not seen"; anywhere else
it is an error. Infinities in spot columns go to the filter, which rejects them as off the detector.
"""

import csv
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.errors import LogError
from relnav.files.log_columns import ACCELERATION, DELTA_V, QUATERNION, SPOTS, Columns, parse_header
from relnav.files.units import to_si

CHUNK_LINES = 20_000


@dataclass(frozen=True)
class Log:
    """A log of spots in SI units.

    Attributes
    ----------
    path : Path
        The file.
    t_s, spots_m : (n,), (n, 3, 2)
        Times and spots of beacons A, B, C; NaN = not seen.
    acceleration_m_s2, delta_v_m_s, q_cam_from_lvlh : (n, 3), (n, 3), (n, 4) or None
        Control and camera attitude, where the log has them.
    metadata : dict
        `key = value` of the leading lines that begin with #.
    ignored : tuple of str
        Columns of other matters.
    """

    path: Path
    t_s: Vector
    spots_m: Stack
    acceleration_m_s2: Matrix | None
    delta_v_m_s: Matrix | None
    q_cam_from_lvlh: Matrix | None
    metadata: dict[str, str]
    ignored: tuple[str, ...]


def read_log(path: Path) -> Log:
    """Read a log: Parquet if the file's name ends so, else CSV.

    Raises
    ------
    LogError
        Naming file, line and column: for a row with a wrong number of cells, text in a number, an empty cell outside
        the spots, a time that repeats or goes back, a quaternion that is not a rotation, a missing column.
    """
    if path.suffix.lower() == ".parquet":
        metadata, columns, values = _read_parquet(path)
        lines = np.arange(1, len(values) + 1, dtype=np.float64)
    else:
        metadata, columns, values, lines = read_csv(path)
    if len(values) == 0:
        raise LogError(f"{path}: no rows after the header; at least one epoch is expected")
    _check_values(values, lines, path, columns)

    def group(bases: tuple[str, ...]) -> Matrix | None:
        if not columns.has(bases):
            return None
        return np.stack([values[:, _order(columns)[base]] for base in bases], axis=1)

    spots = group(SPOTS)
    assert spots is not None
    return Log(
        path=path,
        t_s=values[:, _order(columns)["t"]].copy(),
        spots_m=spots.reshape(-1, 3, 2),
        acceleration_m_s2=group(ACCELERATION),
        delta_v_m_s=group(DELTA_V),
        q_cam_from_lvlh=group(QUATERNION),
        metadata=metadata,
        ignored=columns.ignored,
    )


def read_csv(
    path: Path, parse: Callable[[list[str], str], Columns] = parse_header
) -> tuple[dict[str, str], Columns, Matrix, Vector]:
    """Metadata, columns, values in SI (n, columns in header order) and line numbers (n,) of a CSV table.

    `parse` finds the columns in a header, as `parse_header` does.

    Raises
    ------
    LogError
        Naming file, line and column.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            metadata, header, line = _read_head(file, path)
            columns = parse(header, f"{path}:{line}")
            values, lines = _read_rows(file, path, columns, line)
    except UnicodeDecodeError as error:
        raise LogError(f"{path}: not a text file in UTF-8; a CSV log is expected") from error
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    return metadata, columns, values, lines


def _read_parquet(path: Path) -> tuple[dict[str, str], Columns, Matrix]:
    from relnav.files.parquet import open_parquet, read_columns

    file, names, metadata = open_parquet(path)
    columns = parse_header(names, f"{path}:1")
    return metadata, columns, _to_si(read_columns(file, path, [names[i] for i in columns.index.values()]), columns)


def _order(columns: Columns) -> dict[str, int]:
    """Column of `values` that holds each quantity: in the order in which the header names them."""
    return {base: position for position, base in enumerate(columns.index)}


def _read_head(file: TextIO, path: Path) -> tuple[dict[str, str], list[str], int]:
    metadata: dict[str, str] = {}
    for number, line in enumerate(file, start=1):
        text = line.strip()
        if text.startswith("#"):
            key, equals, value = text.lstrip("# ").partition("=")
            if equals:
                metadata[key.strip()] = value.strip()
        elif text:
            if "," not in text:
                seen = "';'" if ";" in text else "tabs" if "\t" in text else "no comma"
                raise LogError(f"{path}:{number}: cells separated by commas are expected in the header; got {seen}")
            try:
                return metadata, [name.strip() for name in next(csv.reader([text]))], number
            except csv.Error as error:
                raise LogError(f"{path}:{number}: not a header of cells: {error}") from None
    raise LogError(f"{path}: the file is empty; a header line and one row an epoch are expected")


def _read_rows(file: TextIO, path: Path, columns: Columns, head_lines: int) -> tuple[Matrix, Vector]:
    """All rows in SI units, columns in header order, and the line number of each row."""
    parts, numbers = [], []
    line = head_lines
    for chunk in _chunks(file):
        kept = [(line + k, text) for k, text in enumerate(chunk, start=1) if text.strip()]
        line += len(chunk)
        if kept:
            texts = [text for _, text in kept]
            fast = _parse_fast(texts, columns)
            parts.append(fast if fast is not None else _parse_slowly(kept, path, columns))
            numbers.append(np.array([number for number, _ in kept]))
    if not parts:
        return np.empty((0, len(columns.index))), np.empty(0)
    return _to_si(np.concatenate(parts), columns), np.concatenate(numbers)


def _to_si(values: Matrix, columns: Columns) -> Matrix:
    """The values with each column times its factor, in place."""
    for position, base in enumerate(columns.index):
        factor = columns.factor[base]
        if factor != 1.0:
            values[:, position] = to_si(values[:, position], factor)
    return values


def _chunks(file: TextIO) -> Iterator[list[str]]:
    while chunk := list(islice(file, CHUNK_LINES)):
        yield chunk


def _parse_fast(texts: list[str], columns: Columns) -> Matrix | None:
    """Numpy's reader over a chunk; None if anything is unusual."""
    commas = len(columns.names) - 1
    if any(text.count(",") != commas for text in texts):
        return None
    body = "\n" + "".join(texts).replace("\r\n", "\n")
    if not body.endswith("\n"):
        body += "\n"
    for pattern, filled in ((",,", ",nan,"), (",,", ",nan,"), (",\n", ",nan\n"), ("\n,", "\nnan,")):
        body = body.replace(pattern, filled)
    try:
        return np.loadtxt(
            body.splitlines()[1:], delimiter=",", usecols=list(columns.index.values()), ndmin=2, comments=None
        )
    except ValueError:
        return None


def _parse_slowly(kept: list[tuple[int, str]], path: Path, columns: Columns) -> Matrix:
    """Cell by cell: reads what the fast way could not, or names the cell that cannot be read."""
    out = np.empty((len(kept), len(columns.index)))
    for row, (number, text) in enumerate(kept):
        try:
            cells = next(csv.reader([text]))
        except csv.Error as error:
            raise LogError(f"{path}:{number}: not a row of cells: {error}") from None
        if len(cells) != len(columns.names):
            raise LogError(
                f"{path}:{number}: {len(columns.names)} cells are expected as in the header; got {len(cells)}"
            )
        for position, (base, index) in enumerate(columns.index.items()):
            cell = cells[index].strip()
            try:
                if not cell.isascii() or "_" in cell:  # float() would take 1_5 for 15
                    raise ValueError
                out[row, position] = float(cell) if cell else math.nan
            except ValueError:
                name = columns.names[columns.index[base]]
                raise LogError(f"{path}:{number}: column '{name}': {cell!r} is not a number") from None
    return out


def _check_values(values: Matrix, lines: Vector, path: Path, columns: Columns) -> None:
    for position, base in enumerate(columns.index):
        if base in SPOTS:
            continue
        bad = np.flatnonzero(~np.isfinite(values[:, position]))
        if bad.size:
            came = "empty or NaN" if np.isnan(values[bad[0], position]) else "infinite"
            name = columns.names[columns.index[base]]
            raise LogError(f"{path}:{int(lines[bad[0]])}: column '{name}' is {came}; only a spot may be missing")
    t = values[:, _order(columns)["t"]]
    late = np.flatnonzero(np.diff(t) <= 0.0)
    if late.size:
        row = int(late[0]) + 1
        what = "repeats" if t[row] == t[row - 1] else "goes back from"
        raise LogError(
            f"{path}:{int(lines[row])}: time {t[row]:.15g} s {what} {t[row - 1]:.15g} s of the row before; "
            "sort the log by time and keep one row an epoch"
        )
    if columns.has(QUATERNION):
        q = np.stack([values[:, _order(columns)[base]] for base in QUATERNION], axis=1)
        wrong = np.flatnonzero(np.abs(np.linalg.norm(q, axis=1) - 1.0) > 9e-4)
        if wrong.size:
            raise LogError(
                f"{path}:{int(lines[wrong[0]])}: q_cam_from_lvlh {q[wrong[0]].tolist()} is not a unit quaternion "
                "(x, y, z, w)"
            )
