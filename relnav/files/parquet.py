"""Parquet in and out, through pyarrow (extra `parquet`): batches in bounded memory, units in the column metadata."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.errors import LogError
from relnav.files.optional import require
from relnav.files.text_table import MOST_COLUMNS
from relnav.files.units import split_unit
from relnav.files.wording import printable, shown

BATCH_ROWS = 65_536
BOMB_BYTES, BOMB_RATIO = 100_000_000, 200


def require_pyarrow() -> Any:
    """The pyarrow package; UsageError with the line that installs it."""
    return require("pyarrow", "parquet", "Parquet files need pyarrow", ", or use .csv")


def open_parquet(path: Path) -> tuple[Any, list[str], dict[str, str]]:
    """Open a file; returns it, its column names and its metadata.

    Raises
    ------
    LogError
        If it is not Parquet, or unpacks to more than any log would.
    """
    pyarrow = require_pyarrow()
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path, pre_buffer=False)
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
    pyarrow = require_pyarrow()
    schema = file.schema_arrow
    names = [schema.names[index] for index in columns]
    row = 0
    try:
        for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=names):
            out = np.empty((len(names), len(batch)))
            for position, name in enumerate(names):
                column = batch.column(name)
                if not (pyarrow.types.is_floating(column.type) or pyarrow.types.is_integer(column.type)):
                    raise LogError(f"{path}: column '{shown(name)}' holds {column.type}; numbers are expected")
                out[position] = column.cast(pyarrow.float64()).to_numpy(zero_copy_only=False)
            row += len(batch)
            yield out.T
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: damaged after row {row}: {shown(error)}") from error


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
    parts: Iterator[list[Vector]],
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
