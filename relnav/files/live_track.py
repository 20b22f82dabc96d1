"""A track that is written while it is made: each line as soon as its row is filtered, into the file itself."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from relnav.errors import UsageError
from relnav.files.atomic import IN_PLACE, STDOUT, is_stream
from relnav.files.compiled_text import prepare
from relnav.files.tables import Table, head_text, rows_text

ENDINGS = (".csv", ".jsonl")


def ending_of(path: Path, asked: str | None) -> str:
    """Ending of what is written: the file's own, or what was asked for where it has none.

    Raises
    ------
    UsageError
        For a file of another kind, or of another kind than asked for.
    """
    own = path.suffix.lower()
    if own in ENDINGS and asked in (None, own):
        return own
    if own == "" and is_stream(path):
        return asked or ".csv"
    if own in ENDINGS:
        raise UsageError(f"{path}: ends in {own}, but {asked} is asked for; name it {path.stem}{asked}")
    raise UsageError(f"{path}: a track that is written row by row ends in .csv or .jsonl; got '{path.suffix}'")


class LineByLine:
    """Writes a table as `write_table` does, but part after part to its place; a reader who leaves ends it.

    Of a regular file on a disk that becomes full what is left of the last row is cut off.

    Attributes
    ----------
    rows : int
        How many are written, each to its end.
    """

    def __init__(self, ending: str) -> None:
        self.rows, self._ending = 0, ending

    def __call__(
        self,
        path: Path,
        columns: tuple[str, ...],
        parts: Iterator[Table],
        stated: dict[str, str],
        integers: tuple[int, ...],
    ) -> None:
        """Write the head, then what comes."""
        head, raw = head_text(self._ending, columns, stated).encode(), None
        try:
            raw = _opened(path)
            with suppress(BrokenPipeError), io.BufferedWriter(raw) as file:
                self._put(file, [head])
                prepare()
                for part in parts:
                    self._put(file, rows_text(self._ending, columns, part, integers))
        except OSError as error:
            error.filename = error.filename or str(path)
            raise
        finally:
            said = "" if raw is None else raw.settled(path)
            self.rows = 0 if raw is None else max(0, raw.lines - head.count(b"\n"))
            if (in_place := IN_PLACE.get()) is not None:
                in_place.append(f"{self.rows} rows of {path}{said}")

    @staticmethod
    def _put(file: BinaryIO, lines: "Iterator[bytes | memoryview] | list[bytes]") -> None:
        for text in lines:
            file.write(text)
        file.flush()


class _Counted(io.FileIO):
    """A file that knows what has really been written: a disk may take a part of what it is given."""

    def __init__(self, file: str | int) -> None:
        super().__init__(file, "wb")
        self.lines = self._bytes = self._whole = 0

    def write(self, text: Any, /) -> int:
        """Write what there is room for; returns how many bytes."""
        done = super().write(text)
        if done:
            taken = bytes(memoryview(text)[:done])
            self.lines += taken.count(b"\n")
            if end := taken.rfind(b"\n") + 1:
                self._whole = self._bytes + end
            self._bytes += done
        return done

    def settled(self, path: Path) -> str:
        """Cut a line that has no end off, of a regular file, once it is closed; what to add where it stays."""
        if self._bytes == self._whole:
            return ""
        if path == STDOUT or not path.is_file():
            return " and a part of one more"
        os.truncate(path, self._whole)
        return ""


def _opened(path: Path) -> _Counted:
    if path != STDOUT:
        return _Counted(str(path))
    sys.stdout.flush()
    return _Counted(os.dup(sys.stdout.fileno()))
