"""A log whose rows are still coming: read and checked as any log, but a row that is none is told and left out."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from relnav.arrays import Matrix
from relnav.errors import LogError, UsageError
from relnav.files.arriving import Arriving
from relnav.files.compiled_text import BlockReader
from relnav.files.log_columns import Columns, parse_header
from relnav.files.logs import LogFile, to_si_units
from relnav.files.raw_logs import is_raw_log
from relnav.files.text_table import TextTable

MOST_REFUSED = 100
"""Rows refused one after another that end the input: it is no longer the log of the header."""


class Refusals:
    """Tells of each row that was left out, and ends the input when none is a row any more.

    Attributes
    ----------
    count : int
        How many were left out.
    """

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        self.count, self._path, self._tell, self._in_succession = 0, path, tell, 0

    def row(self) -> None:
        """A row was taken."""
        self._in_succession = 0

    def refuse(self, error: ValueError) -> None:
        """A row was not.

        Raises
        ------
        LogError
            At the last of `MOST_REFUSED` in succession.
        """
        self.count, self._in_succession = self.count + 1, self._in_succession + 1
        self._tell(f"{error}; row left out")
        if self._in_succession >= MOST_REFUSED:
            raise LogError(f"{self._path}: {MOST_REFUSED} rows left out one after another: not the log it began as")


class LiveLog(LogFile):
    """A log that is followed; `reads` gives its bytes, `tell` takes a sentence on each row that is left out.

    Attributes
    ----------
    refusals : Refusals
        What was left out.

    Raises
    ------
    LogError
        For a header that is not one of a log.
    UsageError
        For a log that cannot be followed: raw slots, which are filtered whole, and Parquet.
    """

    def __init__(
        self,
        path: Path,
        reads: Arriving,
        tell: Callable[[str], None],
        parse: Callable[[list[str], str], Columns] = parse_header,
    ) -> None:
        """Wait for the header; `parse` as for `LogFile`."""
        refuse_parquet(path)
        table = TextTable(path, reads)
        if is_raw_log(table):
            raise UsageError(f"{path}: a raw log of slots is filtered whole; --follow takes a log of spots")
        super().__init__(table, parse)
        self.refusals = Refusals(path, tell)

    def tables(self) -> Iterator[Matrix]:
        """As of any log, as many rows at once as have come.

        Raises
        ------
        LogError
            For what is no text table at all, and for too many rows left out one after another.
        """
        reader, self._t_before = self.block_reader(), -np.inf
        for begin, block in self._table.blocks():
            yield from self._usable(reader, begin, block)
        if self._t_before == -np.inf:
            raise LogError(f"{self.path}: no rows after the header; at least one epoch is expected")

    def _usable(self, reader: BlockReader, begin: int, block: bytes) -> Iterator[Matrix]:
        """The rows of a block that are rows: where it is refused, those of its halves."""
        self._table.last_row = begin - 1
        try:
            t_before, found = self._t_before, []
            for values, lines in self.rows_of(reader, begin, block):
                t_before = self.check(to_si_units(values, self.columns), lines, t_before)
                found.append(values)
        except LogError as error:
            lines_of = block.split(b"\n")[:-1]
            if len(lines_of) == 1:
                self.refusals.refuse(error)
                return
            half = len(lines_of) // 2
            yield from self._usable(reader, begin, b"\n".join(lines_of[:half]) + b"\n")
            yield from self._usable(reader, begin + half, b"\n".join(lines_of[half:]) + b"\n")
            return
        self._t_before = t_before
        if found:
            self.refusals.row()
            yield from found


def refuse_parquet(path: Path) -> None:
    """Refuse a log that cannot be followed.

    Raises
    ------
    UsageError
        Saying why.
    """
    if path.suffix.lower() == ".parquet":
        raise UsageError(f"{path}: --follow reads CSV, row by row; Parquet is written at its end")
