"""What a command says: after its work is done, in visible characters, and whether or not anybody reads it."""

import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO

import click


class PrintError(Exception):
    """Standard output cannot be written to; whoever merely left off reading is no error."""


def say(lines: Iterable[str], *files: Path | None) -> None:
    """Print lines; on standard error if one of the files just written was standard output.

    Raises
    ------
    PrintError
        For a full disk behind standard output, and the like.
    """
    from relnav.files.atomic import STDOUT

    stream = sys.stderr if STDOUT in files else sys.stdout
    if stream is None:
        return
    try:
        stream.write(visible("\n".join(lines) + "\n", stream))
        stream.flush()
    except BrokenPipeError:
        leave_unprinted(stream)
    except OSError as error:
        leave_unprinted(stream)
        raise PrintError(f"standard output: {error.strerror or error}") from error


def visible(text: str, stream: TextIO) -> str:
    """The text in what the stream can show: other characters, and all that a terminal would obey, as escapes."""
    from relnav.files.wording import printable

    words = "\n".join(map(printable, text.split("\n")))
    encoding = stream.encoding or "utf-8"
    return words.encode(encoding, "backslashreplace").decode(encoding)


def leave_unprinted(stream: TextIO) -> None:
    """Drop what a stream still holds: Python would try again at exit, and complain."""
    try:
        stream.flush()
    except (OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class InputPath(click.Path):
    """A file to read; `-` is standard input. `bags`: or the folder of a ROS bag; `folders`: or any folder."""

    def __init__(self, *, bags: bool = False, folders: bool = False) -> None:
        super().__init__(exists=True, dir_okay=folders, path_type=Path)
        self._bags = bags

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """A path."""
        if self._bags and (Path(value) / "metadata.yaml").is_file():
            return Path(value)
        return super().convert("/dev/stdin" if value == "-" else value, param, ctx)


class OutputPath(click.Path):
    """A file to write; `-` is standard output."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """A path."""
        return super().convert("/dev/stdout" if value == "-" else value, param, ctx)
