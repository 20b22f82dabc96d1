"""Logs of spots in CSV or Parquet: one row an epoch, read in chunks, every malformed row named by its line.

Missing data is defined here, not by a library: an empty or NaN cell of a spot column means "not seen"; anywhere else
it is an error. Infinities in spot columns go to the filter, which rejects them as off the detector.
"""

import csv
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.errors import LogError
from relnav.files.log_columns import (
    ACCELERATION,
    DELTA_V,
    LETTERS,
    QUATERNION,
    Columns,
    parse_header,
    sigma_columns,
    spot_columns,
)
from relnav.files.units import to_si

CHUNK_LINES = 65_536


@dataclass(frozen=True)
class Log:
    """A log of spots in SI units.

    Attributes
    ----------
    path : Path
        The file.
    t_s, spots_m : (n,), (n, beacons, 2)
        Times and spots of beacons A, B, C, ...; NaN = not seen.
    spot_sigma_m : (n, beacons, 2) or None
        1-sigma of the spots, where the log has it; NaN = as before.
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
    spot_sigma_m: Stack | None
    acceleration_m_s2: Matrix | None
    delta_v_m_s: Matrix | None
    q_cam_from_lvlh: Matrix | None
    metadata: dict[str, str]
    ignored: tuple[str, ...]


class LogFile:
    """An opened log, to be read in chunks, as often as one likes.

    Attributes
    ----------
    path, metadata, columns
        The file, `key = value` of its head, and where its quantities stand.

    Raises
    ------
    LogError
        For a file that cannot be read, and for a header that is not one of a log.
    """

    def __init__(self, path: Path, parse: Callable[[list[str], str], Columns] = parse_header) -> None:
        """Read the head; `parse` finds the columns in a header, as `parse_header` does."""
        self.path = path
        self._parquet = path.suffix.lower() == ".parquet"
        if self._parquet:
            from relnav.files.parquet import open_parquet

            self._file, self._names, self.metadata = open_parquet(path)
            self.columns = parse(self._names, f"{path}:1")
        else:
            with self._open() as file:
                self.metadata, header, line = _read_head(file, path)
                self.columns = parse(header, f"{path}:{line}")

    def chunks(self) -> Iterator[Log]:
        """The log, piece after piece in SI units; at least one, none of them empty. Errors as for `tables`."""
        for values in self.tables():
            yield self._log(values)

    def tables(self) -> Iterator[Matrix]:
        """The log's numbers, piece after piece in SI units, a column a quantity (`group` finds them).

        Raises
        ------
        LogError
            Naming file, line and column: for a row with a wrong number of cells, text in a number, an empty cell
            outside the spots, a time that repeats or goes back, a quaternion that is not a rotation.
        """
        t_before = -math.inf
        for values, lines in self.rows():
            _check_values(values, lines, self.path, self.columns, t_before)
            t_before = float(values[-1, _order(self.columns)["t"]])
            yield values
        if t_before == -math.inf:
            raise LogError(f"{self.path}: no rows after the header; at least one epoch is expected")

    def rows(self) -> Iterator[tuple[Matrix, Vector]]:
        """Values in SI (m, columns in header order) and the line number of each row, piece after piece, unchecked."""
        for values, lines in self._parquet_rows() if self._parquet else self._csv_rows():
            _to_si(values, self.columns)
            yield values, lines

    def _log(self, values: Matrix) -> Log:
        beacons = self.columns.beacons
        spots, sigma = self.group(values, spot_columns(beacons)), self.group(values, sigma_columns(beacons))
        assert spots is not None
        return Log(
            path=self.path,
            t_s=values[:, _order(self.columns)["t"]].copy(),
            spots_m=spots.reshape(-1, beacons, 2),
            spot_sigma_m=None if sigma is None else sigma.reshape(-1, beacons, 2),
            acceleration_m_s2=self.group(values, ACCELERATION),
            delta_v_m_s=self.group(values, DELTA_V),
            q_cam_from_lvlh=self.group(values, QUATERNION),
            metadata=self.metadata,
            ignored=self.columns.ignored,
        )

    def group(self, values: Matrix, bases: tuple[str, ...]) -> Matrix | None:
        """Quantities that belong together, (n, k), of a table; None if the log does not have them."""
        if not self.columns.has(bases):
            return None
        order = _order(self.columns)
        return np.stack([values[:, order[base]] for base in bases], axis=1)

    @contextmanager
    def _open(self) -> Iterator[TextIO]:
        try:
            with self.path.open(encoding="utf-8-sig", newline="") as file:
                yield file
        except UnicodeDecodeError as error:
            raise LogError(f"{self.path}: not a text file in UTF-8; a CSV log is expected") from error
        except OSError as error:
            raise LogError(f"{self.path}: cannot be read: {error.strerror}") from error

    def _csv_rows(self) -> Iterator[tuple[Matrix, Vector]]:
        """Rows as they stand in the file."""
        with self._open() as file:
            _, _, line = _read_head(file, self.path)
            while chunk := list(islice(file, CHUNK_LINES)):
                kept = [(line + k, text) for k, text in enumerate(chunk, start=1) if text.strip()]
                line += len(chunk)
                if kept:
                    fast = _parse_fast([text for _, text in kept], self.columns)
                    values = fast if fast is not None else _parse_slowly(kept, self.path, self.columns)
                    yield values, np.array([number for number, _ in kept], dtype=np.float64)

    def _parquet_rows(self) -> Iterator[tuple[Matrix, Vector]]:
        from relnav.files.parquet import read_batches

        row = 1
        names = [self._names[i] for i in self.columns.index.values()]
        for values in read_batches(self._file, self.path, names):
            if len(values):
                yield values, np.arange(row, row + len(values), dtype=np.float64)
                row += len(values)


def check_beacons(path: Path, beacons: int, model: str, expected: int) -> None:
    """Refuse a log of other beacons than the model's.

    Raises
    ------
    LogError
        Naming both numbers.
    """
    if beacons != expected:
        raise LogError(
            f"{path}: spots of {beacons} beacons; model {model} has {expected}: "
            f"columns up to spot_{LETTERS[expected - 1]}_y are expected"
        )


def read_log(path: Path) -> Log:
    """Read a log whole: Parquet if the file's name ends so, else CSV. Errors as for `LogFile`."""
    pieces = list(LogFile(path).chunks())
    if len(pieces) == 1:
        return pieces[0]

    def join(name: str) -> Any:
        parts = [getattr(piece, name) for piece in pieces]
        return None if parts[0] is None else np.concatenate(parts)

    arrays = {
        name: join(name)
        for name in ("t_s", "spots_m", "spot_sigma_m", "acceleration_m_s2", "delta_v_m_s", "q_cam_from_lvlh")
    }
    return replace(pieces[0], **arrays)


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
    file = LogFile(path, parse)
    pieces = list(file.rows())
    if not pieces:
        return file.metadata, file.columns, np.empty((0, len(file.columns.index))), np.empty(0)
    values, lines = zip(*pieces, strict=True)
    return file.metadata, file.columns, np.concatenate(values), np.concatenate(lines)


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


def _to_si(values: Matrix, columns: Columns) -> None:
    """Multiply each column by its factor, in place."""
    for position, base in enumerate(columns.index):
        factor = columns.factor[base]
        if factor != 1.0:
            values[:, position] = to_si(values[:, position], factor)


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


def _check_values(values: Matrix, lines: Vector, path: Path, columns: Columns, t_before: float) -> None:
    for position, base in enumerate(columns.index):
        if base.startswith("sigma_"):
            wrong = np.flatnonzero(values[:, position] <= 0.0)
            if wrong.size:
                name = columns.names[columns.index[base]]
                raise LogError(f"{path}:{int(lines[wrong[0]])}: column '{name}': a sigma above 0 is expected")
        if base in columns.layout.may_be_missing:
            continue
        bad = np.flatnonzero(~np.isfinite(values[:, position]))
        if bad.size:
            came = "empty or NaN" if np.isnan(values[bad[0], position]) else "infinite"
            name = columns.names[columns.index[base]]
            raise LogError(f"{path}:{int(lines[bad[0]])}: column '{name}' is {came}; only a spot may be missing")
    t = values[:, _order(columns)["t"]]
    before = np.concatenate([[t_before], t[:-1]])
    late = np.flatnonzero(t <= before)
    if late.size:
        row = int(late[0])
        what = "repeats" if t[row] == before[row] else "goes back from"
        raise LogError(
            f"{path}:{int(lines[row])}: time {t[row]:.15g} s {what} {before[row]:.15g} s of the row before; "
            "sort the log by time and keep one row an epoch"
        )
    quaternion = columns.layout.quaternion
    if columns.has(quaternion):
        q = np.stack([values[:, _order(columns)[base]] for base in quaternion], axis=1)
        wrong = np.flatnonzero(np.abs(np.linalg.norm(q, axis=1) - 1.0) > 9e-4)
        if wrong.size:
            raise LogError(
                f"{path}:{int(lines[wrong[0]])}: {quaternion[0][:-2]} {q[wrong[0]].tolist()} is not a unit quaternion "
                "(x, y, z, w)"
            )
