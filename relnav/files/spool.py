"""Arrays in a temporary file, to be read back in any order: what a long log leaves behind on its way."""

import tempfile
from types import TracebackType
from typing import Any

import numpy as np


class Spool:
    """Groups of arrays on disk, gone when it is closed."""

    def __init__(self) -> None:
        self._file: Any = tempfile.TemporaryFile(prefix="relnav-")  # noqa: SIM115  (closed by __exit__)
        self._entries: list[tuple[int, list[tuple[tuple[int, ...], np.dtype[Any]]]]] = []

    def __enter__(self) -> "Spool":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._file.close()

    def __len__(self) -> int:
        """How many groups."""
        return len(self._entries)

    def append(self, *arrays: Any) -> None:
        """Keep one more group."""
        self._file.seek(0, 2)
        self._entries.append((self._file.tell(), [(array.shape, array.dtype) for array in arrays]))
        self._write(arrays)

    def replace(self, k: int, *arrays: Any) -> None:
        """Write other arrays of the same sizes over the first ones of a group."""
        self._file.seek(self._entries[k][0])
        self._write(arrays)

    def _write(self, arrays: tuple[Any, ...]) -> None:
        try:
            for array in arrays:
                self._file.write(np.ascontiguousarray(array).view(np.uint8).data if array.size else b"")
            self._file.flush()
        except OSError as error:
            where = f"a temporary file in {tempfile.gettempdir()} (TMPDIR names another folder)"
            raise OSError(error.errno, error.strerror, where) from error

    def __getitem__(self, k: int) -> list[Any]:
        start, entries = self._entries[k]
        self._file.seek(start)
        arrays = [np.empty(shape, dtype=kind) for shape, kind in entries]
        for array in arrays:
            if array.size:
                self._file.readinto(array.view(np.uint8).data)
        return arrays
