"""Whole files or none: write in a hidden folder beside the target, then rename; all files of a command together.

The hidden folder is `.NAME.relnav-part` after the first target in a folder. Whoever writes in it holds a lock on it,
which the system lets go if the program is killed: the next run that writes that target finds the folder without an
owner and takes it over. A pipe or a device is given the whole file at the end.
"""

import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any

from relnav.errors import UsageError

try:
    import fcntl
except ImportError:  # Windows: no lock, and what a killed program leaves stays
    fcntl = None  # type: ignore[assignment]  # a module where there is one

STDIN, STDOUT = Path("/dev/stdin"), Path("/dev/stdout")
PART = "relnav-part"
IN_PLACE: ContextVar[list[str] | None] = ContextVar("IN_PLACE", default=None)
"""Where a list is set, the name of every file that was put in place is added to it."""
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM") if hasattr(signal, name))


def is_stream(path: Path) -> bool:
    """Whether the path is no file of a disk: a pipe, a device, one of the program's own descriptors."""
    return str(path.parent) in ("/dev", "/dev/fd", "/proc/self/fd") or (path.exists() and not path.is_file())


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
    _resolved(path)


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except RuntimeError:  # what Python 3.11 and 3.12 raise for links that lead in a circle
        raise UsageError(f"{path}: a link that leads back to itself; name a file") from None


def check_distinct(*paths: Path | None) -> None:
    """Refuse a call that names one file twice: its input as its output, or two outputs.

    Raises
    ------
    UsageError
        Naming the file.
    """
    seen: set[Path] = set()
    for path in paths:
        if path is None or str(path) == os.devnull:
            continue
        place = path if is_stream(path) else _resolved(path)
        if place in seen:
            raise UsageError(f"{path}: is named twice; every input and output needs a file of its own")
        seen.add(place)


class Outputs:
    """Files that appear together at the end of a `with` block, or none of them if it ends in an error.

    An OSError that leaves the block names the target it concerns, if that can be told.
    """

    def __init__(self) -> None:
        self._folders: dict[Path, _HiddenFolder] = {}
        self._files: list[tuple[Path, Path]] = []  # written so far, target

    def __enter__(self) -> "Outputs":
        return self

    def path(self, target: Path, ending: str = "") -> Path:
        """Where to write what shall become `target`. A link stays a link: the file it names is replaced.

        `ending`: of what is written if the target has none ("-", a pipe).

        Raises
        ------
        UsageError
            If the folder does not exist.
        """
        check_folder(target)
        stream = is_stream(target)
        place = target if stream else _resolved(target)
        beside = Path(tempfile.gettempdir()) if stream else place.parent
        if beside not in self._folders:
            with _undisturbed():
                folder = _HiddenFolder(beside, place.name)
                folder.make()
                self._folders[beside] = folder
        written = self._folders[beside].path / f"{len(self._files)}{place.suffix or ending}"
        self._files.append((written, place))
        return written

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        with _undisturbed():
            try:
                if error is None:
                    self._commit()
                elif isinstance(error, OSError):
                    self._name(error)
            finally:
                for folder in self._folders.values():
                    folder.remove()

    def _commit(self) -> None:
        umask = os.umask(0)
        os.umask(umask)
        for written, target in self._files:
            try:
                if is_stream(target):
                    _pour(written, target)
                else:
                    written.chmod((0o777 if written.is_dir() else 0o666) & ~umask)
                    written.replace(target)
            except OSError as error:
                error.filename, error.filename2 = str(target), None
                raise
            within = f".{PART}" in target.parent.name  # one file of several is not in its place yet
            if (in_place := IN_PLACE.get()) is not None and not within:
                in_place.append(str(target))

    def _name(self, error: OSError) -> None:
        """Put the target's name for the hidden file's; for a write that failed (a full disk) the system names none."""
        names = {str(written): str(target) for written, target in self._files}
        if error.filename is None and len(names) == 1:
            error.filename = next(iter(names.values()))
        error.filename = names.get(error.filename, error.filename)


@contextmanager
def replacing(path: Path, ending: str = "") -> Iterator[Path]:
    """Where to write what shall become the one file `path` when the block ends well; see `Outputs`."""
    with Outputs() as outputs:
        yield outputs.path(path, ending)


class _HiddenFolder:
    """A folder of this program alone, with a lock as long as it is in use."""

    def __init__(self, beside: Path, name: str) -> None:
        self._beside, self._name, self._lock = beside, name[:60], -1
        self.path = beside

    def make(self) -> None:
        """Make the first free one of .NAME.relnav-part, .NAME.relnav-part1, ..., or take one over that lost its owner.

        Raises
        ------
        OSError
            If there is no room or no right to write beside the target.
        """
        for number in count():
            self.path = self._beside / f".{self._name}.{PART}{number or ''}"
            made = True
            try:
                self.path.mkdir(mode=0o700)
            except FileExistsError:
                made = False
            if self._locked(made):
                return

    def _locked(self, made: bool) -> bool:
        if fcntl is None:
            return made
        try:
            self._lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:
            return False
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            held, named = os.fstat(self._lock), os.stat(self.path, follow_symlinks=False)
            if held.st_ino == named.st_ino and held.st_uid == os.getuid():
                for left in self.path.iterdir():
                    shutil.rmtree(left) if left.is_dir() and not left.is_symlink() else left.unlink()
                return True
        except BlockingIOError:
            pass  # another program writes here
        except OSError:
            if made:  # a file system without locks
                return True
        os.close(self._lock)
        self._lock = -1
        return False

    def remove(self) -> None:
        """Remove it with whatever is in it."""
        if self._lock >= 0 or fcntl is None:
            shutil.rmtree(self.path, ignore_errors=True)
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1


def _pour(written: Path, target: Path) -> None:
    """Hand a finished file to a pipe or device. A reader who has left does not want it: no error."""
    with written.open("rb") as source, suppress(BrokenPipeError):
        if target != STDOUT:
            with target.open("wb") as file:
                shutil.copyfileobj(source, file)
        elif sys.stdout is not None:
            sys.stdout.flush()
            shutil.copyfileobj(source, sys.stdout.buffer)
            sys.stdout.buffer.flush()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """What would end the program waits until the block is over."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before: dict[int, Any] = {}
    try:
        for number in ENDING:
            if (handler := signal.getsignal(number)) is not None:
                before[number] = handler
                signal.signal(number, lambda sent, _: came.append(sent))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for number in came:
        signal.raise_signal(number)
