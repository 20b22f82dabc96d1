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


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`; renamed to it if the block ends well, removed if not.

    Raises
    ------
    UsageError
        If the folder does not exist.
    """
    check_folder(path)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
