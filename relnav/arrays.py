"""Names for arrays, and the one place that takes numbers from a caller.

Inside, arrays are float64 throughout, the shape said in words because the type system cannot hold it. What a caller
hands over can be anything that numpy reads; a number that is missing there is NaN here, and what is not a real number
is refused, because numpy alone would drop masks, imaginary parts and units of time without a word.
"""

import sys
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector: TypeAlias = NDArray[np.float64]
"""One axis: a position (3,), a state (6,), values over epochs (n,)."""

Matrix: TypeAlias = NDArray[np.float64]
"""Two axes: a rotation (3, 3), a covariance (6, 6), spots (3, 2)."""

Stack: TypeAlias = NDArray[np.float64]
"""Three axes: one matrix an epoch, (n, 6, 6)."""

Flags: TypeAlias = NDArray[np.bool_]
"""One truth value an epoch, (n,)."""

Codes: TypeAlias = NDArray[np.int64]
"""One small integer an epoch, (n,)."""

Record: TypeAlias = Any
"""One record of a structured type, or an array of them: fields by name (`record["state"]`)."""

LARGEST = 1e30
"""Of a state, a covariance, a control or a sigma that is handed over, SI: more is a mistake, and powers overflow."""

_FLOAT = np.dtype(np.float64)
_REAL_KINDS = "biuf"
_ROWS = (list, tuple)
_NOT_REAL = {
    "c": "complex numbers: give their real part if that is meant",
    "M": "dates (datetime64): give seconds, (t - t[0]) / np.timedelta64(1, 's')",
    "m": "spans of time (timedelta64): give seconds, t / np.timedelta64(1, 's')",
    "U": "text: convert it to numbers first",
    "S": "text: convert it to numbers first",
    "T": "text: convert it to numbers first",
    "V": "records with fields: give one array of numbers",
}


def numbers(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """A caller's numbers as float64, of any shape; the array itself, not a copy, where it is that already.

    What is masked (`numpy.ma`), None, or NA in a column of pandas is a missing value, NaN: of a spot, one that was not
    seen.

    Raises
    ------
    ValueError
        For what is not real numbers, a lone NA of pandas among them, rows of unequal length, or an integer beyond the
        largest float; `name` says in the sentence which argument it was.
    """
    if type(value) is np.ndarray and value.dtype == _FLOAT:
        return value
    mask: Any = None
    try:
        if not _is_masked(value):
            given = np.asarray(value)
        elif isinstance(value, np.ma.MaskedArray):
            given, mask = np.ma.getdata(value), np.ma.getmaskarray(value)
        else:
            given = np.asarray([numbers(name, item) for item in value])  # type: ignore[union-attr]  # a list or tuple here
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} holds numbers in rows of one length: {error}") from None
    if given.dtype.kind == "O":
        missing = np.zeros(given.shape, dtype=bool) if mask is None else mask
        of_pandas = type(value).__module__.partition(".")[0] == "pandas"
        items = [
            np.nan if out or (of_pandas and _is_na(item)) else _real(name, item)
            for item, out in zip(given.flat, missing.flat, strict=True)
        ]
        return np.array(items, dtype=np.float64).reshape(given.shape)
    if given.dtype.kind not in _REAL_KINDS:
        raise ValueError(f"{name} holds real numbers; got {_NOT_REAL.get(given.dtype.kind, str(given.dtype))}")
    with np.errstate(over="ignore"):  # beyond the largest float: infinite, and refused or not seen as that
        array: NDArray[np.float64] = given.astype(np.float64, copy=mask is not None)
    if mask is not None:
        array[mask] = np.nan
    return array


def of_floats(value: Any) -> Any:
    """A list or tuple of floats, or of such lists of one length, as an array: a microsecond; all else as it is."""
    if type(value) in _ROWS and value:
        rows = value if type(value[0]) in _ROWS else (value,)
        size = len(rows[0])
        for row in rows:
            if type(row) not in _ROWS or len(row) != size:
                return value
            for entry in row:
                if type(entry) is not float:
                    return value
        return np.array(value)
    return value


def number(name: str, value: float) -> float:
    """A caller's single number; ValueError for anything else, as `numbers`."""
    if type(value) is float:
        return value
    array = numbers(name, value)
    if array.shape != ():
        raise ValueError(f"{name} is one number; got an array of shape {array.shape}")
    return float(array)


def whole(name: str, value: Any, least: int = 0, below: int = 2**64) -> int:
    """A caller's whole number; ValueError for anything else, and outside of its bounds."""
    if not isinstance(value, int | np.integer) or not least <= value < below:
        bounds = f"{least} or more" + (" and below 2^64" if below == 2**64 else f" and below {below}")
        raise ValueError(f"{name} is {bounds}, a whole number; got {value!r}")
    return int(value)


def vector(name: str, value: ArrayLike, shape: tuple[int, ...], most: float = LARGEST) -> NDArray[np.float64]:
    """A caller's array as float64; ValueError for another shape, or what is not finite or beyond `most`."""
    array = numbers(name, value)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {shape}; got {array.shape}")
    if not (np.abs(array) <= most).all():
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite; got {array.tolist()}")
        raise ValueError(f"{name} must be up to {most:g} in size; got {array.tolist()}")
    return array


def one_piece(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """`numbers` in one piece of memory that may be written: kernels compile anew for any other kind of array."""
    array = numbers(name, value)
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else array.copy(order="C")


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array itself, from now on read-only."""
    array.setflags(write=False)
    return array


def _is_masked(value: Any) -> bool:
    """Whether there is a mask in an array, or in an array or number of a list."""
    if "numpy.ma" not in sys.modules:  # nobody can have made one, and importing it takes time
        return False
    if isinstance(value, (list, tuple)):
        return any(_is_masked(item) for item in value)
    return isinstance(value, np.ma.MaskedArray)


def _is_na(item: Any) -> bool:
    """Whether it is pandas' NA, without importing pandas."""
    return type(item).__name__ == "NAType"


def _real(name: str, item: Any) -> float:
    """One Python object as a float; NaN for a missing value."""
    if item is None:
        return float("nan")
    if _is_na(item):
        raise ValueError(f"{name} holds real numbers; got NA of pandas: give NaN for what was not seen")
    kind = item.dtype.kind if isinstance(item, np.generic) else "U" if isinstance(item, (str, bytes)) else "O"
    if kind in _NOT_REAL:
        raise ValueError(f"{name} holds real numbers; got {_NOT_REAL[kind]}")
    try:
        return float(item)
    except OverflowError:
        raise ValueError(f"{name} holds a number beyond the largest float, 1.8e308") from None
    except (TypeError, ValueError):
        raise ValueError(f"{name} holds real numbers; got a {type(item).__name__} among them") from None
