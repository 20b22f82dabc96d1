"""A log that is a data frame already (pandas, polars): the same columns and checks as a file, without the file."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector, numbers
from relnav.errors import LogError
from relnav.files.log_columns import Columns, parse_header
from relnav.files.logs import LogFile
from relnav.files.paths import path_of
from relnav.files.ros_bag import is_bag, read_bag


def is_frame(source: Any) -> bool:
    """Whether this is a table in memory: it has columns, and gives each by its name."""
    return hasattr(source, "columns") and hasattr(source, "__getitem__")


def log_in_memory(source: Any, parse: Callable[[list[str], str], Columns] = parse_header) -> "FrameLog | None":
    """The log, if it is a frame or the messages of a ROS bag; None for a file of rows."""
    if is_frame(source):
        return FrameLog(source, parse)
    path = path_of(source, "a log's path, or a table in memory,")
    return FrameLog(read_bag(path), parse) if is_bag(path) else None


class FrameLog(LogFile):
    """A frame's rows as those of a log; errors name the row, counted from 0, and the column.

    Raises
    ------
    LogError
        For a header that is not one of a log.
    """

    def __init__(self, frame: Any, parse: Callable[[list[str], str], Columns] = parse_header) -> None:
        """Look at the columns; times may be the index, if it is called `t_s`."""
        if str(getattr(getattr(frame, "index", None), "name", "")).startswith("t_"):
            frame = frame.reset_index()
        self._frame, self._parquet, self.metadata = frame, False, {}
        self.path = getattr(frame, "source", Path("DataFrame"))
        self.columns = parse([str(name) for name in frame.columns], str(self.path))

    def _csv_rows(self) -> Iterator[tuple[Matrix, Vector]]:
        """All rows at once, as they stand in the frame."""
        names = list(self._frame.columns)
        values = np.empty((len(self._frame), len(self.columns.index)))
        for position, index in enumerate(self.columns.index.values()):
            try:
                values[:, position] = numbers(f"column '{names[index]}'", self._frame[names[index]])
            except ValueError as error:
                raise LogError(f"{self.path}: {error}") from error
        if len(values):
            yield values, np.arange(len(values), dtype=np.float64)
