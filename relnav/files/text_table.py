"""Text tables: the one way in which a log, a grid, a frame of stars or an orbit is read from a text file or a pipe.

UTF-8, with or without a byte order mark; lines end as they like. Lines that begin with # are comments, and before the
header `# key = value` is metadata. The first other line is the header. What no table is (a line without an end, a
million columns) is refused as soon as it is seen, so that an endless input costs neither time nor memory.
"""

import csv
import math
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

from relnav.errors import LogError
from relnav.files.wording import printable, shown

LONGEST_LINE = 1_000_000
MOST_COLUMNS = 2_000
GZIP = b"\x1f\x8b"
"""What a file compressed with gzip begins with (RFC 1952)."""
MOST_HEAD_LINES = 10_000
MOST_EMPTY_LINES = 100_000
MOST_ROWS = 1_000_000
"""Of a table that is read whole, not streamed."""
READ_WHOLE = "a table of this kind is read whole: cut it in parts"
HEAD_BYTES, BLOCK_BYTES = 65_536, 2_000_000
"""What is read at once: of a pipe's head what there is, then whole blocks."""
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


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
    last_row : int
        Number of the last row that was read, or of the header.

    Raises
    ------
    LogError
        For what cannot be read, is no text, or has no header of cells.
    """

    def __init__(self, path: Path, reads: "Callable[[Path], Iterator[bytes]] | None" = None) -> None:
        """Read the head; `reads` gives the bytes of a path, as they come, in pieces that are not empty."""
        self.path, self._reads = path, reads or _reads
        self.metadata: dict[str, str] = {}
        self.head: list[str] = []
        self.last_row = 0
        blocks = _blocks(path, self._reads)
        for _, block in blocks:
            place = 0
            while place < len(block):
                end = block.index(b"\n", place)
                self.line = len(self.head) + 1
                text = _decoded(block[place:end], path, self.line)
                place = end + 1
                if self._is_header(text):
                    rest = (self.line + 1, block[place:])
                    self._unread: Iterator[tuple[int, bytes]] | None = chain([rest], blocks)
                    return
        raise LogError(
            f"{path}: the file is empty; a header line and one row an epoch, slot, point or spot are expected"
        )

    def _is_header(self, text: str) -> bool:
        """Take in a line of the head; whether it was the last one."""
        self.head.append(text)
        if text.lstrip().startswith("#"):
            key, equals, value = text.strip().lstrip("# ").partition("=")
            if equals:
                self.metadata[shown(key.strip())] = shown(value.strip())
        elif text.strip():
            self.names = self._header(text.strip())
            return True
        if self.line > MOST_HEAD_LINES:
            raise LogError(f"{self.path}: {MOST_HEAD_LINES} lines and no header yet; a table of cells is expected")
        return False

    def _header(self, text: str) -> list[str]:
        if "\0" in text:
            raise LogError(f"{self.path}:{self.line}: not a text file in UTF-8: zero bytes; UTF-16? save it as UTF-8")
        if "," not in text:
            seen = "';'" if ";" in text else "tabs" if "\t" in text else "no comma"
            raise LogError(
                f"{self.path}:{self.line}: cells separated by commas are expected in the header; got {seen}: save it "
                "with commas between cells, and points in numbers"
            )
        names = [printable(name.strip()) for name in cells(text, f"{self.path}:{self.line}")]
        if len(names) > MOST_COLUMNS:
            raise LogError(
                f"{self.path}:{self.line}: {len(names)} columns; up to {MOST_COLUMNS} are read: leave out what is not "
                "needed"
            )
        return names

    def blocks(self) -> Iterator[tuple[int, bytes]]:
        """What is behind the header as blocks of whole lines, each with its first line's number; of a pipe only once.

        Every line ends in a line feed.

        Raises
        ------
        LogError
            For what cannot be read or has no end.
        """
        blocks, self._unread, self.last_row = self._unread, None, self.line
        if blocks is not None:
            yield from blocks
            return
        for begin, block in _blocks(self.path, self._reads):
            skip = self.line + 1 - begin
            if skip <= 0:
                yield begin, block
            elif block.count(b"\n") > skip:
                yield self.line + 1, block.split(b"\n", skip)[skip]

    def rows(self) -> Iterator[tuple[int, str]]:
        """Number and text of each line after the header that is neither empty nor a comment; of a pipe only once.

        Raises
        ------
        LogError
            For what cannot be read, is no text, or has no end.
        """
        for begin, block in self.blocks():
            yield from self.rows_of(begin, block)

    def rows_of(self, begin: int, block: bytes) -> Iterator[tuple[int, str]]:
        """The rows of one of the `blocks`, as of `rows`."""
        for number, text in _lines(begin, block, self.path):
            first = text.lstrip()
            if first and first[0] != "#":
                self.last_row = number
                yield number, text
            elif number - self.last_row > MOST_EMPTY_LINES:
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


def _lines(begin: int, block: bytes, path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of each line of a block, without its end; what is no text is told after the lines before it."""
    good, wrong = block, b""
    try:
        text = block.decode()
    except UnicodeDecodeError as error:
        cut = block.rfind(b"\n", 0, error.start) + 1
        good, wrong = block[:cut], block[cut : block.index(b"\n", cut)]
        text = good.decode()
    number = begin - 1
    for number, line in enumerate(text.split("\n")[:-1], begin):
        if len(line) >= LONGEST_LINE:
            raise LogError(_no_end(path, number))
        yield number, line
    if wrong:
        _decoded(wrong, path, number + 1)


def _decoded(line: bytes, path: Path, number: int) -> str:
    """The text of a line, that of this number."""
    if len(line) >= LONGEST_LINE:
        raise LogError(_no_end(path, number))
    try:
        return line.decode()
    except UnicodeDecodeError as error:
        if number == 1 and line.startswith(GZIP):
            raise LogError(f"{path}: compressed with gzip; a CSV is expected: unpack it first (gunzip)") from error
        encoding = "UTF-16? save it as UTF-8" if line[:2] in (b"\xff\xfe", b"\xfe\xff") else "a CSV is expected"
        raise LogError(f"{path}: not a text file in UTF-8 (after line {number - 1}); {encoding}") from error


def _no_end(path: Path, number: int) -> str:
    return f"{path}:{number}: a line of {LONGEST_LINE} characters or more; a row of cells is expected"


def _reads(path: Path) -> Iterator[bytes]:
    """The bytes of a file or pipe until its end."""
    with path.open("rb") as file:
        came = file.read1(HEAD_BYTES)
        while came:
            yield came
            came = file.read(BLOCK_BYTES)


def _blocks(path: Path, reads: "Callable[[Path], Iterator[bytes]]") -> Iterator[tuple[int, bytes]]:
    """Whole lines, however they end in the file, as blocks in which each ends in a line feed; number of their first."""
    number, kept = 1, b""
    pieces = reads(path)
    while came := _next(pieces, path):
        whole = kept + came
        held = b"\r" if whole.endswith(b"\r") else b""  # its line feed may be still to come
        whole = _line_feeds(whole.removesuffix(b"\r"))
        cut = whole.rfind(b"\n") + 1
        kept = whole[cut:] + held
        if cut:
            yield number, _unmarked(whole[:cut], number)
            number += whole.count(b"\n", 0, cut)
        if len(kept) >= 4 * LONGEST_LINE:
            raise LogError(_no_end(path, number))
    if kept:
        yield number, _line_feeds(_unmarked(kept, number)).removesuffix(b"\n") + b"\n"


def _next(pieces: Iterator[bytes], path: Path) -> bytes:
    try:
        return next(pieces, b"")
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error


def _unmarked(lines: bytes, number: int) -> bytes:
    return lines.removeprefix(_BYTE_ORDER_MARK) if number == 1 else lines


def _line_feeds(text: bytes) -> bytes:
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text
