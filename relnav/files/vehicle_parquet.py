"""A vehicle's log as Parquet: the columns of the CSV, t_s, sensor, v0, v1, ..., null where a cell is empty there."""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from relnav.arrays import Vector
from relnav.errors import LogError
from relnav.files.parquet import open_parquet, read_named_batches, require_pyarrow
from relnav.files.wording import shown

ROWS_AT_ONCE = 16_384


def named_rows(path: Path) -> Iterator[tuple[int, str, float, Vector]]:
    """Number from 1, sensor, time (NaN if there is none) and values (width,) of each row.

    Raises
    ------
    LogError
        For what is no such table.
    """
    file, names, _ = open_parquet(path, "sensor")
    check_columns(names, f"{path}:1")
    number = 0
    for sensors, values in read_named_batches(file, path, "sensor", ["t_s", *names[2:]]):
        for sensor, row in zip(sensors, values, strict=True):
            number += 1
            yield number, sensor.strip(), float(row[0]), row[1:]


def check_columns(names: list[str], where: str) -> None:
    """Refuse a header that is not that of a vehicle's log.

    Raises
    ------
    LogError
        Saying what came.
    """
    if names[:2] != ["t_s", "sensor"] or names[2:] != [f"v{k}" for k in range(len(names) - 2)]:
        raise LogError(
            f"{where}: a vehicle's log has columns t_s, sensor, v0, v1, ...; got {shown(', '.join(names), 120)}"
        )


def write_named_rows(
    path: Path, width: int, rows: Iterable[tuple[str, float, list[float]]], stated: dict[str, str]
) -> None:
    """Write sensor, time and up to `width` values of each row."""
    pyarrow = require_pyarrow()
    from pyarrow import parquet

    numbers = [pyarrow.field(f"v{k}", pyarrow.float64()) for k in range(width)]
    time = pyarrow.field("t_s", pyarrow.float64(), metadata={"unit": "s"})
    schema = pyarrow.schema([time, pyarrow.field("sensor", pyarrow.string()), *numbers], metadata=stated)
    left = iter(rows)
    with parquet.ParquetWriter(path, schema, compression="snappy", use_dictionary=["sensor"]) as writer:
        while part := list(islice(left, ROWS_AT_ONCE)):
            values = np.full((len(part), width), np.nan)
            for row, (_, _, given) in zip(values, part, strict=True):
                row[: len(given)] = given
            columns = [pyarrow.array([t for _, t, _ in part]), pyarrow.array([name for name, _, _ in part])]
            columns += [pyarrow.array(np.ascontiguousarray(column), from_pandas=True) for column in values.T]
            writer.write_table(pyarrow.Table.from_arrays(columns, schema=schema))
