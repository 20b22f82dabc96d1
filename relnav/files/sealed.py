"""Parquet files that state the SHA-256 of their own bytes, so that not a single bit of one can change unnoticed.

Parquet's own checksums are of pages alone: a damaged name, size or type in the file's footer still reads as a table. A
digest in another file could be lost or left behind, and many processes write parts of one campaign at a time.
"""

import hashlib
from pathlib import Path
from typing import Any

NAME = "sha256"
"""Of the entry in the file's metadata."""
STATED = b"of this file, with 64 zeros in place of the digits: "
DIGITS = 64
"""Hexadecimal, of a SHA-256."""


class UnsealedError(ValueError):
    """A file whose bytes are not those that were written, or that never stated them."""


def write_sealed(table: Any, path: Path) -> None:
    """Write a pyarrow table with its digest; the same table gives the same bytes."""
    import pyarrow
    from pyarrow import parquet

    sink = pyarrow.BufferOutputStream()
    with parquet.ParquetWriter(
        sink, table.schema, compression="none", use_dictionary=False, write_statistics=False
    ) as file:
        file.write_table(table)
        file.add_key_value_metadata({NAME: (STATED + b"0" * DIGITS).decode()})
    raw = sink.getvalue().to_pybytes()
    place = _place(raw)
    digest = hashlib.sha256(raw).hexdigest().encode()
    path.write_bytes(raw[:place] + digest + raw[place + DIGITS :])


def check_sealed(path: Path) -> None:
    """See that a file is what was written.

    Raises
    ------
    UnsealedError
        If it is not, or states no digest.
    OSError
        If it cannot be read.
    """
    raw = path.read_bytes()
    place = _place(raw)
    digest = hashlib.sha256(raw[:place] + b"0" * DIGITS + raw[place + DIGITS :]).hexdigest()
    if raw[place : place + DIGITS] != digest.encode():
        raise UnsealedError("its bytes are not those of the SHA-256 that it states")


def _place(raw: bytes) -> int:
    """Where the digits begin: the last mention, as the footer comes after all values."""
    place = raw.rfind(STATED)
    if place < 0:
        raise UnsealedError("it states no SHA-256 of its own, as every part of a campaign does")
    return place + len(STATED)
