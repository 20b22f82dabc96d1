"""A track that is written while it is made: each line as soon as its row is filtered, into the file itself."""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

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

    Attributes
    ----------
    rows : int
        How many are written.
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
        try:
            with suppress(BrokenPipeError), _opened(path) as file:
                self._put(file, [head_text(self._ending, columns, stated).encode()])
                prepare()
                for part in parts:
                    self._put(file, rows_text(self._ending, columns, part, integers))
                    self.rows += len(part[0])
        except OSError as error:
            error.filename = error.filename or str(path)
            raise
        finally:
            if (in_place := IN_PLACE.get()) is not None:
                in_place.append(f"{self.rows} rows of {path}")

    @staticmethod
    def _put(file: BinaryIO, lines: "Iterator[bytes | memoryview] | list[bytes]") -> None:
        for text in lines:
            file.write(text)
        file.flush()


def _opened(path: Path) -> BinaryIO:
    if path != STDOUT:
        return path.open("wb")
    sys.stdout.flush()
    return os.fdopen(os.dup(sys.stdout.fileno()), "wb")
