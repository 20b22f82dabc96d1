"""Paths as a program hands them over: a text or a path, or a sentence about what came instead."""

import os
from pathlib import Path
from typing import Any

from relnav.errors import UsageError
from relnav.files.wording import shown


def path_of(value: Any, what: str) -> Path:
    """The path.

    Raises
    ------
    UsageError
        For what is neither a text nor a path, or holds a null character; names what was expected.
    """
    if not isinstance(value, str | os.PathLike):
        raise UsageError(f"{what} is expected, a text or a path; got a {type(value).__name__}: {shown(value, 80)}")
    named = os.fspath(value)
    if not isinstance(named, str) or "\x00" in named:
        raise UsageError(f"{what} is expected, a text or a path without null characters; got {shown(repr(named), 80)}")
    return Path(named)
