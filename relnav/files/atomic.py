"""Whole files or none: write beside the target under a temporary name, then rename."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from relnav.errors import UsageError


def check_folder(path: Path) -> None:
    """Refuse, before any work is done, a target whose folder does not exist.

    Raises
    ------
    UsageError
        Naming the folder.
    """
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist; make it, or write elsewhere")
    if path.is_dir():
        raise UsageError(f"{path}: is a folder; name a file in it")


def check_png(path: Path) -> None:
    """Refuse a picture of another kind.

    Raises
    ------
    UsageError
        Naming the ending.
    """
    if path.suffix.lower() != ".png":
        raise UsageError(f"{path}: a picture ends in .png; got '{path.suffix}'")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, with its ending; renamed to it if the block ends well, removed if not.

    A link stays a link: the file it names is replaced. A pipe or a device is written to directly.

    Raises
    ------
    UsageError
        If the folder does not exist.
    """
    check_folder(path)
    target = path.resolve()
    if target.exists() and not target.is_file():
        yield target
        return
    handle, name = tempfile.mkstemp(prefix=f".{target.stem}.", suffix=target.suffix, dir=target.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def check_distinct(*paths: Path | None) -> None:
    """Refuse a call that names one file twice: its input as its output, or two outputs.

    Raises
    ------
    UsageError
        Naming the file.
    """
    seen: set[Path] = set()
    for path in paths:
        if path is not None and path.resolve() in seen and not path.is_char_device():
            raise UsageError(f"{path}: is named twice; every input and output needs a file of its own")
        if path is not None:
            seen.add(path.resolve())
