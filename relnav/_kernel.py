"""The one file that imports numba: `kernel` compiles a function of plain scalar loops, or leaves it plain Python.

`RELNAV_JIT=0` in the environment runs the same lines as plain Python (debugging, coverage, and the test that
compiled and plain results agree). Compiled code is cached beside the source, in the user's cache folder when the
install is read-only, and not at all when neither can be written. A compiled function holds the code of all it calls,
but numba stamps its cache with the defining file alone; here the stamp is the content of the whole package, so that a
changed callee is never run in its old form.
"""

import os
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from relnav._cache import package_stamp

P = ParamSpec("P")
R = TypeVar("R")

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False, "boundscheck": False}


def _numba_njit() -> Any | None:
    """Numba's compiler, or None when it is switched off or cannot be imported."""
    if os.environ.get("RELNAV_JIT", "1") == "0":
        return None
    try:
        from numba import njit
    except ImportError as error:
        warnings.warn(
            f"numba cannot be imported ({error}): relnav runs as plain Python, about a hundred times slower",
            RuntimeWarning,
            stacklevel=3,
        )
        return None
    return njit


_NJIT = _numba_njit()
_STAMP = package_stamp() if _NJIT is not None else ""
_CACHE = True


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a scalar-loop function on its first call; without numba, return it as it is."""
    global _CACHE  # noqa: PLW0603  (one switch for the process: the first refusal settles it, with one warning)
    if _NJIT is None:
        return function
    if _CACHE:
        try:
            compiled = _NJIT(cache=True, **_OPTIONS)(function)
            compiled._cache._cache_file._source_stamp = _STAMP
            cached: Callable[P, R] = compiled
            return cached
        except RuntimeError as error:
            _CACHE = False
            warnings.warn(
                f"no folder for compiled code can be written ({error}): relnav compiles anew in every process; "
                "set NUMBA_CACHE_DIR to a writable folder",
                RuntimeWarning,
                stacklevel=2,
            )
    uncached: Callable[P, R] = _NJIT(**_OPTIONS)(function)
    return uncached


def is_compiled() -> bool:
    """Whether kernels run compiled in this process."""
    return _NJIT is not None
