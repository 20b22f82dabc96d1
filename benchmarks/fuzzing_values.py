"""What a program can hand over by mistake instead of a good array, and what must hold of a call that is given it."""

import copy
import pickle
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from fuzzing import SLOWEST_S, watched
from hypothesis import strategies as st
from numba.core.event import install_timer

NUMBERS = [0.0, -0.0, 1.0, -1.0, 1e-300, 5e-324, 1e-9, 1e3, 1e10, 1e20, 1e155, 1e300, -1e308, np.nan, np.inf, -np.inf]
OTHERS: list[Any] = [
    None,
    "text",
    b"",
    1j,
    [],
    {},
    [[1.0], [2.0, 3.0]],
    object(),
    10**400,
    True,
    np.datetime64("2026-01-01"),
]
OTHERS += [np.ma.masked, float, [None], np.zeros((0, 2)), np.zeros((2, 2, 2, 2)), np.array(["a"]), np.zeros(3, "f4,f4")]
number = st.sampled_from(NUMBERS) | st.floats()


@st.composite
def like(draw: Any, good: Any, *, optional: bool = False) -> Any:
    """Something like a good array or number: mostly itself, or with numbers, shape, type or all of it exchanged."""
    if optional and draw(st.integers(0, 2)):
        return None
    what = draw(st.integers(0, 19))
    if what == 0:
        return copy.deepcopy(draw(st.sampled_from(OTHERS)))
    array = np.array(good, dtype=float)
    if array.ndim == 0:
        return draw(number) if what < 4 else good
    if what == 1:
        return _reshaped(draw, array)
    for _ in range(draw(st.integers(1, 3)) if what < 7 else 0):
        array.flat[draw(st.integers(0, array.size - 1))] = draw(number)
    return _otherwise(draw, array) if what in (2, 3, 7) else array


def _reshaped(draw: Any, array: Any) -> Any:
    """Rows or columns more or less."""
    how = draw(st.sampled_from(["less", "more", "turned", "flat", "deep"]))
    if how == "less":
        return array[:-1]
    if how == "more":
        return np.concatenate([array, array])
    return array.T if how == "turned" else array.ravel() if how == "flat" else array[None]


def _otherwise(draw: Any, array: Any) -> Any:
    """The same numbers in another container."""
    how = draw(st.sampled_from(["list", "float32", "int", "object", "masked", "fortran", "strided", "kept", "swapped"]))
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if how in ("float32", "object", "int"):
            return array.astype({"float32": "f4", "object": "O", "int": "i8"}[how])
    if how == "masked":
        return np.ma.masked_array(array, draw(st.lists(st.booleans(), min_size=array.size, max_size=array.size)))
    if how == "strided":
        return np.repeat(array, 2, axis=0)[::2]
    if how == "kept":
        array.setflags(write=False)
    made = {"list": array.tolist(), "fortran": np.asfortranarray(array), "swapped": array.astype(">f8")}
    return made.get(how, array)


def drawn(data: Any, rare: int = 1, **good: Any) -> dict[str, Any]:
    """Optional arguments: each like a good value, or (`rare`) mostly left out."""
    return {name: data.draw(like(value, optional=bool(rare))) for name, value in good.items()}


def rotation(angle: float = 0.3, axis: int = 0) -> Any:
    """A turn about an axis, (3, 3)."""
    c, s, i, j = np.cos(angle), np.sin(angle), (axis + 1) % 3, (axis + 2) % 3
    dcm = np.eye(3)
    dcm[i, i], dcm[j, j], dcm[i, j], dcm[j, i] = c, c, s, -s
    return dcm


def check_covariance(covariance: Any, *, singular: bool = False) -> None:
    """Finite, variances above zero, positive definite to rounding."""
    covariance = np.asarray(covariance)
    assert np.isfinite(covariance).all(), "a covariance is finite"
    variances = np.diagonal(covariance)
    assert (variances >= 0.0).all() if singular else (variances > 0.0).all(), "a variance is above zero"
    scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    assert np.linalg.eigvalsh(covariance / scale / scale[:, None]).min() > -1e-9, "a covariance is positive definite"


def asked(call: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """What a call gives; None if it refuses with a sentence. AssertionError for everything that must not be."""
    before, begin, result = _kept(arguments, named), time.process_time(), None
    compiling: list[float] = []  # once a process, and told: no part of a call's time
    try:
        with warnings.catch_warnings(), install_timer("numba:compile", compiling.append), watched(30 * SLOWEST_S):
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", ".* encountered in scalar ")  # of kernels run as plain Python alone
            result = call(*arguments, **named)
    except ValueError as error:
        message = str(error)
        assert message, "an error says something"
        assert len(message) < 30_000, "a message is read by people"
        assert all(line.isprintable() for line in message.split("\n")), f"a message in visible characters: {message!r}"
    assert time.process_time() - begin - sum(compiling) < SLOWEST_S, "it takes too long"
    assert _kept(arguments, named) == before, "arguments stay as they were"
    return result


def _kept(arguments: tuple[Any, ...], named: dict[str, Any]) -> list[bytes]:
    arrays = [a for a in (*arguments, *named.values()) if isinstance(a, np.ndarray) and a is not np.ma.masked]
    return [a.tobytes() for a in arrays if a.dtype != object]


def state_of(filter_: Any) -> bytes:
    """Everything that a filter knows: what its pickle holds."""
    held = filter_.__getstate__()
    return pickle.dumps({name: value for name, value in held.items() if name not in ("model", "mission", "arguments")})


def in_turn(filter_: Any, look: Callable[[Any], None], call: Callable[..., Any], *arguments: Any, **named: Any) -> str:
    """One call of a filter, which stays as it was if it refuses; `look` at the record."""
    before = state_of(filter_)
    record = asked(call, *arguments, **named)
    if record is None:
        assert state_of(filter_) == before, "a refused call leaves the filter as it was"
        return "refused"
    look(record)
    return "given"
