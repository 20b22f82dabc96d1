"""Logs of spots in CSV or Parquet: one row an epoch, read in chunks, every malformed row named by its line.

Missing data is defined here, not by a library: an empty or NaN cell of a spot column means "not seen"; anywhere else
it is an error. Infinities in spot columns go to the filter, which rejects them as off the detector.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import LARGEST, Matrix, Stack, Vector
from relnav.errors import LogError
from relnav.files.compiled_text import BlockReader
from relnav.files.log_columns import (
    ACCELERATION,
    DELTA_V,
    IMAGE_TIME,
    LETTERS,
    QUATERNION,
    Columns,
    check_quaternions,
    parse_header,
    sigma_columns,
    spot_columns,
)
from relnav.files.text_table import MOST_ROWS, READ_WHOLE, TextTable, table_of
from relnav.files.units import split_unit, to_si

CHUNK_LINES = 65_536
CHUNK_CHARACTERS = 16_000_000
MOST = {"t": 1e11} | dict.fromkeys(ACCELERATION, 1e4) | dict.fromkeys(DELTA_V, 1e5)
"""Sizes beyond which a number is a mistake: 3,000 years; a thousand g; a third of a thousandth of light's speed."""


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
    image_t_s : (n,) or None
        When each row's image was exposed, where the log says it.
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
    image_t_s: Vector | None = None


class LogFile:
    """An opened log, to be read in chunks, as often as one likes; from a pipe once.

    Attributes
    ----------
    path, metadata, columns
        The file, `key = value` of its head, and where its quantities stand.

    Raises
    ------
    LogError
        For a file that cannot be read, and for a header that is not one of a log.
    """

    def __init__(self, path: Path | TextTable, parse: Callable[[list[str], str], Columns] = parse_header) -> None:
        """Read the head; `parse` finds the columns in a header, as `parse_header` does."""
        self.path = path if isinstance(path, Path) else path.path
        self._parquet = self.path.suffix.lower() == ".parquet"
        if self._parquet:
            from relnav.files.parquet import open_parquet

            self._file, self._names, self.metadata = open_parquet(self.path)
            self.columns = parse(self._names, f"{self.path}:1")
        else:
            self._table = table_of(path)
            self.metadata = self._table.metadata
            self.columns = parse(self._table.names, f"{self.path}:{self._table.line}")

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
            t_before = self.check(values, lines, t_before)
            yield values
        if t_before == -math.inf:
            raise LogError(f"{self.path}: no rows after the header; at least one epoch is expected")

    def check(self, values: Matrix, lines: Vector, t_before: float) -> float:
        """Refuse rows that are none of a log, as `tables` says. `t_before`: time before them; returns their last."""
        _check_values(values, lines, self.path, self.columns, self._order, self._limits, t_before)
        return float(values[-1, self._order["t"]])

    @cached_property
    def _order(self) -> dict[str, int]:
        """Column of `values` that holds each quantity: in the order in which the header names them."""
        return {base: position for position, base in enumerate(self.columns.index)}

    @cached_property
    def _limits(self) -> tuple[list[int], Vector, list[int]]:
        return _limits(self.columns)

    def rows(self) -> Iterator[tuple[Matrix, Vector]]:
        """Values in SI (m, columns in header order) and the line number of each row, piece after piece, unchecked."""
        for values, lines in self._parquet_rows() if self._parquet else self._csv_rows():
            yield to_si_units(values, self.columns), lines

    def _log(self, values: Matrix) -> Log:
        beacons = self.columns.beacons
        spots, sigma = self.group(values, spot_columns(beacons)), self.group(values, sigma_columns(beacons))
        exposed = self.group(values, IMAGE_TIME)
        assert spots is not None
        return Log(
            path=self.path,
            t_s=values[:, self._order["t"]].copy(),
            spots_m=spots.reshape(-1, beacons, 2),
            spot_sigma_m=None if sigma is None else sigma.reshape(-1, beacons, 2),
            acceleration_m_s2=self.group(values, ACCELERATION),
            delta_v_m_s=self.group(values, DELTA_V),
            q_cam_from_lvlh=self.group(values, QUATERNION),
            metadata=self.metadata,
            ignored=self.columns.ignored,
            image_t_s=None if exposed is None else exposed[:, 0],
        )

    def group(self, values: Matrix, bases: tuple[str, ...]) -> Matrix | None:
        """Quantities that belong together, (n, k), of a table; None if the log does not have them."""
        if not self.columns.has(bases):
            return None
        return np.take(values, [self._order[base] for base in bases], axis=1)

    def _csv_rows(self) -> Iterator[tuple[Matrix, Vector]]:
        """Rows as they stand in the file."""
        reader = self.block_reader()
        for begin, block in self._table.blocks():
            yield from self.rows_of(reader, begin, block)

    def block_reader(self) -> BlockReader:
        """What reads the blocks of this table."""
        return BlockReader(self._table, list(self.columns.index.values()))

    def rows_of(self, reader: BlockReader, begin: int, block: bytes) -> Iterator[tuple[Matrix, Vector]]:
        """Values as they stand in a block of lines from number `begin` on, and the line number of each row."""
        place, line = 0, begin
        while read := reader.read(block, place, line, CHUNK_LINES):
            values, lines, place, line = read
            if len(values):
                yield values, lines
            if place == len(block):
                break
        else:  # not compiled, or not as simple as that
            for kept in pieces(self._table.rows_of(line, block[place:])):
                fast = _parse_fast([text for _, text in kept], self.columns)
                values = fast if fast is not None else _parse_slowly(kept, self._table, self.columns)
                yield values, np.array([number for number, _ in kept], dtype=np.float64)

    def _parquet_rows(self) -> Iterator[tuple[Matrix, Vector]]:
        from relnav.files.parquet import read_batches

        row = 1
        for values in read_batches(self._file, self.path, list(self.columns.index.values())):
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


def opened(path: Path) -> Path | TextTable:
    """A log's table, its head read, to be handed on: a pipe can be opened once. Parquet stays a path."""
    return path if path.suffix.lower() == ".parquet" else TextTable(path)


def read_log(path: Path | TextTable | LogFile) -> Log:
    """Read a log whole: Parquet if the file's name ends so, else CSV. Errors as for `LogFile`."""
    pieces = list((path if isinstance(path, LogFile) else LogFile(path)).chunks())
    if len(pieces) == 1:
        return pieces[0]

    def join(name: str) -> Any:
        parts = [getattr(piece, name) for piece in pieces]
        return None if parts[0] is None else np.concatenate(parts)

    told = ("spot_sigma_m", "acceleration_m_s2", "delta_v_m_s", "q_cam_from_lvlh", "image_t_s")
    return replace(pieces[0], **{name: join(name) for name in ("t_s", "spots_m", *told)})


def read_csv(
    path: Path,
    parse: Callable[[list[str], str], Columns] = parse_header,
    *,
    most: tuple[int, str] = (MOST_ROWS, READ_WHOLE),
) -> tuple[dict[str, str], Columns, Matrix, Vector]:
    """Metadata, columns, values in SI (n, columns in header order) and line numbers (n,) of a CSV table.

    `parse` finds the columns in a header, as `parse_header` does; most: rows, and what to do about more.

    Raises
    ------
    LogError
        Naming file, line and column.
    """
    file = LogFile(path, parse)
    pieces, count = [], 0
    for piece in file.rows():
        pieces.append(piece)
        count += len(piece[0])
        if count > most[0]:
            raise LogError(f"{path}: more than {most[0]} rows; {most[1]}")
    if not pieces:
        return file.metadata, file.columns, np.empty((0, len(file.columns.index))), np.empty(0)
    values, lines = zip(*pieces, strict=True)
    return file.metadata, file.columns, np.concatenate(values), np.concatenate(lines)


def _limits(columns: Columns) -> tuple[list[int], Vector, list[int]]:
    """Columns of `values` that hold a number in every row, how large it may be, and columns of sigmas."""
    bases = list(columns.index)
    required = [k for k, base in enumerate(bases) if base not in columns.layout.may_be_missing]
    most = np.array([MOST.get(bases[k], np.finfo(np.float64).max) for k in required])
    return required, most, [k for k, base in enumerate(bases) if base.startswith("sigma_")]


def pieces(rows: Iterator[tuple[int, str]]) -> Iterator[list[tuple[int, str]]]:
    """Numbered lines in lists of bounded size."""
    piece: list[tuple[int, str]] = []
    characters = 0
    for number, text in rows:
        piece.append((number, text))
        characters += len(text)
        if len(piece) >= CHUNK_LINES or characters >= CHUNK_CHARACTERS:
            yield piece
            piece, characters = [], 0
    if piece:
        yield piece


def to_si_units(values: Matrix, columns: Columns) -> Matrix:
    """The values, each column multiplied by its factor in place."""
    for where, factor in columns.scaled:
        values[:, where] = to_si(values[:, where], factor)
    return values


def _parse_fast(texts: list[str], columns: Columns) -> Matrix | None:
    """Numpy's reader over a chunk; None if anything is unusual."""
    commas = len(columns.names) - 1
    if any(text.count(",") != commas for text in texts):
        return None
    body = "\n" + "\n".join(texts) + "\n"
    for pattern, filled in ((",,", ",nan,"), (",,", ",nan,"), (",\n", ",nan\n"), ("\n,", "\nnan,")):
        body = body.replace(pattern, filled)
    try:
        return np.loadtxt(
            body.split("\n")[1:-1], delimiter=",", usecols=list(columns.index.values()), ndmin=2, comments=None
        )
    except ValueError:
        return None


def _parse_slowly(kept: list[tuple[int, str]], table: TextTable, columns: Columns) -> Matrix:
    """Cell by cell: reads what the fast way could not, or names the cell that cannot be read."""
    out = np.empty((len(kept), len(columns.index)))
    for row, (number, text) in enumerate(kept):
        found = table.cells(number, text)
        for position, index in enumerate(columns.index.values()):
            out[row, position] = table.number(found[index], number, columns.names[index])
    return out


def _check_cells(values: Matrix, lines: Vector, path: Path, columns: Columns) -> None:
    """Column by column: name the first cell that cannot be."""
    for position, base in enumerate(columns.index):
        if base.startswith("sigma_"):
            wrong = np.flatnonzero((values[:, position] <= 0.0) | (values[:, position] > LARGEST))
            if wrong.size:
                name = columns.names[columns.index[base]]
                raise LogError(
                    f"{path}:{int(lines[wrong[0]])}: column '{name}': a sigma above 0, up to {LARGEST:g}, is expected"
                )
        if base in columns.layout.may_be_missing:
            continue
        bad = np.flatnonzero(~np.isfinite(values[:, position]))
        if bad.size:
            came = "empty or NaN" if np.isnan(values[bad[0], position]) else "infinite"
            name = columns.names[columns.index[base]]
            raise LogError(f"{path}:{int(lines[bad[0]])}: column '{name}' is {came}; only a spot may be missing")
        if base in MOST:
            check_size(values[:, position], MOST[base], lines, path, columns.names[columns.index[base]])


def _check_values(
    values: Matrix,
    lines: Vector,
    path: Path,
    columns: Columns,
    order: dict[str, int],
    limits: tuple[list[int], Vector, list[int]],
    t_before: float,
) -> None:
    required, most, sigmas = limits
    told = values[:, sigmas] if sigmas else None
    wrong = told is not None and ((told <= 0.0) | (told > LARGEST)).any()
    if wrong or not (np.abs(values[:, required]) <= most).all():
        _check_cells(values, lines, path, columns)
    t = values[:, order["t"]]
    if t[0] <= t_before or (t[1:] <= t[:-1]).any():
        before = np.concatenate([[t_before], t[:-1]])
        row = int(np.flatnonzero(t <= before)[0])
        what = "repeats" if t[row] == before[row] else "goes back from"
        raise LogError(
            f"{path}:{int(lines[row])}: time {t[row]:.15g} s {what} {before[row]:.15g} s of the row before; "
            "sort the log by time and keep one row an epoch"
        )
    if "image_t" in columns.index:
        _check_exposures(values[:, order["image_t"]], t, lines, path)
    quaternion = columns.layout.quaternion
    if columns.has(quaternion):
        q = np.take(values, [order[base] for base in quaternion], axis=1)
        check_quaternions(quaternion[0][:-2], q, lines, path)


def _check_exposures(image_t: Vector, t: Vector, lines: Vector, path: Path) -> None:
    """Refuse an image that was exposed after its row was written."""
    late = np.flatnonzero(image_t > t)
    if late.size:
        row = int(late[0])
        raise LogError(
            f"{path}:{int(lines[row])}: image_t_s {image_t[row]:.15g} s lies after its row's t_s {t[row]:.15g} s; "
            "a row is written when its image has arrived"
        )


def check_size(values: Vector, most: float, lines: Vector, path: Path, name: str) -> None:
    """Refuse values (SI) larger than `most`.

    Raises
    ------
    LogError
        Naming file, line and column.
    """
    beyond = np.flatnonzero(np.abs(values) > most)
    if beyond.size:
        hint = "; milliseconds or nanoseconds? then name it t_ms, or divide" if split_unit(name)[0] == "t" else ""
        raise LogError(
            f"{path}:{int(lines[beyond[0]])}: column '{name}' is {values[beyond[0]]:.6g} in SI units; up to {most:g} "
            f"is credible{hint}"
        )
