"""Bytes that are still coming: a file that another program writes, a pipe, standard input; a signal is their end.

A file of a disk has no end until a signal comes; what was appended is looked for every 0.2 ms. A pipe ends
when its last writer has closed it.
"""

import os
import signal
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, BinaryIO

from relnav.errors import LogError
from relnav.files.atomic import ENDING, is_stream

POLL_S = 0.0002
LOOK_AGAIN_S = 1.0
"""So often: whether the name still leads to the file that is open."""
BYTES_AT_ONCE = 1_000_000


class _EndedError(Exception):
    """A signal came while there was nothing to do but wait."""


class Arriving:
    """Reads a path as it grows; called with the path, as `TextTable` wants it.

    A `with` block in the main thread: within it SIGINT and SIGTERM end the input, so that what came before is worked
    through and written whole. A second signal ends the program at once, as without.

    Attributes
    ----------
    ended_by : int
        The signal that was the end; 0 if none was.
    """

    def __init__(self) -> None:
        self.ended_by = 0
        self._waiting = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Arriving":
        if threading.current_thread() is threading.main_thread():
            for number in ENDING:
                if signal.getsignal(number) not in (signal.SIG_IGN, None):
                    self._before[number] = signal.signal(number, self._end)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _end(self, number: int, frame: FrameType | None) -> None:
        if self.ended_by and callable(self._before[number]):
            self._before[number](number, frame)
        self.ended_by = number
        if self._waiting:
            raise _EndedError

    def __call__(self, path: Path) -> Iterator[bytes]:
        """The bytes, as they come.

        Raises
        ------
        OSError
            If they cannot be read.
        LogError
            If the file was cut or another one took its name.
        """
        with path.open("rb", buffering=0) as file:
            into = memoryview(bytearray(BYTES_AT_ONCE))
            grows = stat.S_ISREG(os.fstat(file.fileno()).st_mode) and not is_stream(path)
            while came := self._next(path, file, grows, into):
                yield came

    def _next(self, path: Path, file: Any, grows: bool, into: memoryview) -> bytes:
        """What came next; empty at the end. `into`: room for it, made once."""
        look = time.monotonic() + LOOK_AGAIN_S
        try:
            try:
                self._waiting = True
                while not self.ended_by:
                    count: int | None = file.readinto(into)  # None: a pipe that does not wait
                    if count or (count == 0 and not grows):
                        return bytes(into[:count])
                    time.sleep(POLL_S)
                    if grows and time.monotonic() > look:
                        look = time.monotonic() + LOOK_AGAIN_S
                        _check_same(path, file)
            finally:
                self._waiting = False
        except _EndedError:
            pass
        return b""


def _check_same(path: Path, file: BinaryIO) -> None:
    held = os.fstat(file.fileno())
    if held.st_size < file.tell():
        raise LogError(f"{path}: was cut while it was followed; rows that were used cannot be taken back: start anew")
    try:
        named = path.stat()
    except FileNotFoundError:
        return  # moved away; whoever writes it may still hold it
    if (named.st_dev, named.st_ino) != (held.st_dev, held.st_ino):
        raise LogError(f"{path}: another file took its name while it was followed; start anew on that")
