"""Parquet in and out, through pyarrow (extra `parquet`): batches in bounded memory, units in the column metadata."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.errors import LogError
from relnav.files.optional import require
from relnav.files.text_table import MOST_COLUMNS
from relnav.files.units import split_unit
from relnav.files.wording import printable, shown

Taken = TypeVar("Taken")

BATCH_ROWS = 65_536
BOMB_BYTES, BOMB_RATIO = 100_000_000, 200


def require_pyarrow(need: str = "Parquet files need pyarrow", instead: str = ", or use .csv") -> Any:
    """The pyarrow package; UsageError with the line that installs it, and what else would do."""
    return require("pyarrow", "parquet", need, instead)


def open_parquet(path: Path, words: str | None = None) -> tuple[Any, list[str], dict[str, str]]:
    """Open a file; returns it, its column names and its metadata. words: a column that holds words, not numbers.

    Raises
    ------
    LogError
        If it is not Parquet, or unpacks to more than any log would.
    """
    pyarrow = require_pyarrow()
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path, pre_buffer=False, read_dictionary=None if words is None else [words])
        stored, names = file.schema_arrow.metadata or {}, [printable(name) for name in file.schema_arrow.names]
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: not a readable Parquet file: {shown(error)}") from error
    metadata = {
        shown(key.decode(errors="replace")): shown(value.decode(errors="replace"))
        for key, value in stored.items()
        if key not in (b"ARROW:schema", b"pandas")
    }
    if len(names) > MOST_COLUMNS:
        raise LogError(f"{path}: {len(names)} columns; up to {MOST_COLUMNS} are read: leave out what is not needed")
    _refuse_bombs(file, path)
    return file, names, metadata


def read_batches(file: Any, path: Path, columns: list[int]) -> Iterator[Matrix]:
    """Columns, by number, as float64 (m, len(columns)), batch after batch; null becomes NaN.

    Raises
    ------
    LogError
        For a column that does not hold numbers.
    """
    names = [file.schema_arrow.names[index] for index in columns]
    yield from _read(file, path, names, lambda batch: _numbers(batch, path, names))


def read_named_batches(file: Any, path: Path, words: str, columns: list[str]) -> Iterator[tuple[list[str], Matrix]]:
    """A column of words (m,), "" where there is none, beside columns of numbers as of `read_batches`.

    The file is opened with `words` of `open_parquet`, so that a long word that repeats is there once.

    Raises
    ------
    LogError
        For columns that hold something else.
    """
    names = [words, *columns]
    yield from _read(file, path, names, lambda batch: (_words(batch, path, words), _numbers(batch, path, columns)))


def _read(file: Any, path: Path, names: list[str], take: Callable[[Any], Taken]) -> Iterator[Taken]:
    """What `take` makes of each batch of some columns; what damage raises becomes a LogError."""
    pyarrow = require_pyarrow()
    row = 0
    try:
        for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=names):
            taken = take(batch)
            row += len(batch)
            yield taken
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: damaged after row {row}: {shown(error)}") from error


def _numbers(batch: Any, path: Path, names: list[str]) -> Matrix:
    pyarrow = require_pyarrow()
    out = np.empty((len(names), len(batch)))
    for position, name in enumerate(names):
        column = batch.column(name)
        if not (pyarrow.types.is_floating(column.type) or pyarrow.types.is_integer(column.type)):
            raise LogError(f"{path}: column '{shown(name)}' holds {column.type}; numbers are expected")
        out[position] = column.cast(pyarrow.float64()).to_numpy(zero_copy_only=False)
    return out.T


def _words(batch: Any, path: Path, name: str) -> list[str]:
    types, column = require_pyarrow().types, batch.column(name)
    coded = types.is_dictionary(column.type)
    kind = column.type.value_type if coded else column.type
    if not (types.is_string(kind) or types.is_large_string(kind)):
        raise LogError(f"{path}: column '{shown(name)}' holds {column.type}; words are expected")
    column = column if coded else column.dictionary_encode()
    known = [word or "" for word in column.dictionary.to_pylist()]
    return ["" if code is None else known[code] for code in column.indices.to_pylist()]


def _refuse_bombs(file: Any, path: Path) -> None:
    """A few kilobytes that unpack to gigabytes: pages are unpacked whole, so they are not tried.

    The file's size is compared, not each column's: pyarrow ends the process where it is asked for a column whose
    description is damaged.
    """
    size = path.stat().st_size
    for group in range(file.metadata.num_row_groups):
        unpacked = file.metadata.row_group(group).total_byte_size
        if unpacked > BOMB_BYTES and unpacked > BOMB_RATIO * size:
            raise LogError(
                f"{path}: row group {group + 1} unpacks to {unpacked} bytes, from a file of {size}; no measured log "
                "does"
            )


def write_parquet(
    path: Path,
    columns: tuple[str, ...],
    parts: Iterator[list[Vector] | Matrix],
    metadata: dict[str, str],
    integers: tuple[int, ...],
) -> None:
    """Write tables, columns of equal length, one after the other; NaN becomes null; units go into their metadata."""
    pyarrow = require_pyarrow()
    from pyarrow import parquet

    fields = [
        pyarrow.field(
            name,
            pyarrow.int8() if index in integers else pyarrow.float64(),
            metadata={"unit": split_unit(name)[1] or "1"},
        )
        for index, name in enumerate(columns)
    ]
    schema = pyarrow.schema(fields, metadata=metadata)
    with parquet.ParquetWriter(path, schema, compression="snappy", use_dictionary=False) as writer:
        for part in parts:
            arrays = [
                pyarrow.array(column.astype(np.int8))
                if index in integers
                else pyarrow.array(np.ascontiguousarray(column), from_pandas=bool(np.isnan(column).any()))
                for index, column in enumerate(part)
            ]
            writer.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))
