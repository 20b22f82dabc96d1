"""Text tables: the one way in which a log, a grid, a frame of stars or an orbit is read from a text file or a pipe.

UTF-8, with or without a byte order mark; lines end as they like. Lines that begin with # are comments, and before the
header `# key = value` is metadata. The first other line is the header. What no table is (a line without an end, a
million columns) is refused as soon as it is seen, so that an endless input costs neither time nor memory.
"""

import csv
import math
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

from relnav.errors import LogError
from relnav.files.wording import printable, shown

LONGEST_LINE = 1_000_000
MOST_COLUMNS = 2_000
MOST_HEAD_LINES = 10_000
MOST_EMPTY_LINES = 100_000
MOST_ROWS = 1_000_000
"""Of a table that is read whole, not streamed."""


class TextTable:
    """An opened table: its head is read at once, its rows when they are asked for.

    Attributes
    ----------
    path : Path
        The file or pipe.
    metadata : dict
        `key = value` of the comments before the header, in visible characters.
    names : list of str
        Cells of the header, in visible characters.
    line : int
        The header's number.
    head : list of str
        All lines up to the header, as they stand.

    Raises
    ------
    LogError
        For what cannot be read, is no text, or has no header of cells.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, str] = {}
        self.head: list[str] = []
        self._unread: Iterator[tuple[int, str]] | None = _lines(path)
        for number, text in self._unread:
            self.line = number
            self.head.append(text)
            if text.lstrip().startswith("#"):
                key, equals, value = text.strip().lstrip("# ").partition("=")
                if equals:
                    self.metadata[shown(key.strip())] = shown(value.strip())
            elif text.strip():
                self.names = self._header(text.strip())
                return
            if self.line > MOST_HEAD_LINES:
                raise LogError(f"{path}: {MOST_HEAD_LINES} lines and no header yet; a table of cells is expected")
        raise LogError(
            f"{path}: the file is empty; a header line and one row an epoch, slot, point or spot are expected"
        )

    def _header(self, text: str) -> list[str]:
        if "," not in text:
            seen = "';'" if ";" in text else "tabs" if "\t" in text else "no comma"
            raise LogError(f"{self.path}:{self.line}: cells separated by commas are expected in the header; got {seen}")
        names = [printable(name.strip()) for name in cells(text, f"{self.path}:{self.line}")]
        if len(names) > MOST_COLUMNS:
            raise LogError(
                f"{self.path}:{self.line}: {len(names)} columns; up to {MOST_COLUMNS} are read: leave out what is not "
                "needed"
            )
        return names

    def rows(self) -> Iterator[tuple[int, str]]:
        """Number and text of each line after the header that is neither empty nor a comment; of a pipe only once.

        Raises
        ------
        LogError
            For what cannot be read, is no text, or has no end.
        """
        lines, self._unread = self._unread, None
        last = self.line
        for number, text in lines or islice(_lines(self.path), self.line, None):
            begin = text.lstrip()
            if begin and begin[0] != "#":
                last = number
                yield number, text
            elif number - last > MOST_EMPTY_LINES:
                raise LogError(f"{self.path}:{number}: {MOST_EMPTY_LINES} lines without a row; a table has rows")

    def cells(self, number: int, text: str) -> list[str]:
        """The cells of a row.

        Raises
        ------
        LogError
            If they are not as many as the header's.
        """
        found = cells(text, f"{self.path}:{number}")
        if len(found) != len(self.names):
            raise LogError(
                f"{self.path}:{number}: {len(self.names)} cells are expected as in the header; got {len(found)}"
            )
        return found

    def number(self, cell: str, number: int, name: str) -> float:
        """A cell as a number; NaN if it is empty.

        Raises
        ------
        LogError
            For anything else, naming line and column.
        """
        cell = cell.strip()
        try:
            if not cell.isascii() or "_" in cell:  # float() would take 1_5 for 15
                raise ValueError
            return float(cell) if cell else math.nan
        except ValueError:
            raise LogError(
                f"{self.path}:{number}: column '{shown(name, 80)}': {shown(repr(cell), 80)} is not a number"
            ) from None


def table_of(source: "Path | TextTable") -> TextTable:
    """An opened table, if it is not one already."""
    return source if isinstance(source, TextTable) else TextTable(source)


def cells(text: str, where: str) -> list[str]:
    """The cells of one line.

    Raises
    ------
    LogError
        For a line that is no row of cells; `where` leads.
    """
    if '"' not in text:
        return text.split(",")
    try:
        return next(csv.reader([text]))
    except csv.Error as error:
        raise LogError(f"{where}: not a row of cells: {error}") from None


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of each line, without its end."""
    number = 0
    try:
        with path.open(encoding="utf-8-sig") as file:
            while text := _line(file, path, number + 1):
                number += 1
                yield number, text.removesuffix("\n")
    except UnicodeDecodeError as error:
        encoding = "UTF-16? save it as UTF-8" if error.object[:2] in (b"\xff\xfe", b"\xfe\xff") else "a CSV is expected"
        raise LogError(f"{path}: not a text file in UTF-8 (after line {number}); {encoding}") from error
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error


def _line(file: TextIO, path: Path, number: int) -> str:
    text = file.readline(LONGEST_LINE)
    if len(text) == LONGEST_LINE and not text.endswith("\n"):
        raise LogError(f"{path}:{number}: a line of {LONGEST_LINE} characters or more; a row of cells is expected")
    return text
