"""What kernels say of numbers of which RUNS stand side by side, one of each run (`lanes.py`), and of single ones alike.

A kernel that is compiled for such numbers does its lines for RUNS runs at once. It may decide by them only what all
runs decide alike. What a run has for itself is chosen with `select`; what all may do if one has to is asked with
`anywhere` and done with `held`; comparisons are joined with `&` and `|`, which decide nothing.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

N = TypeVar("N", int, float)
R = TypeVar("R")

RUNS = 8
"""Doubles of a 512-bit register. Where registers hold four, two instructions that do not wait for one another: most of
a filter's time is waiting for divisions."""


def select(condition: bool, a: N, b: N) -> N:
    """`a` where the condition holds, else `b`: a choice without a branch."""
    return a if condition else b


def quotient(a: float, b: float, otherwise: float) -> float:
    """Divide a by b where b > 0, else `otherwise`: a division without a branch, for `straight_line` functions."""
    return a / b if b > 0.0 else otherwise


def anywhere(condition: bool) -> bool:
    """Whether a condition holds for any run."""
    return condition


def held(condition: bool) -> bool:
    """A condition after `if anywhere(condition)`: for a single run it holds there, and no choice by it is left over."""
    return condition


def lanes_of(array: Any) -> Any:
    """An array (..., RUNS) of `new_lanes` as one of numbers that stand side by side; in compiled code alone."""
    raise NotImplementedError(f"numbers side by side are for compiled code; got an array of shape {array.shape}")


def attempt(function: Callable[..., R], *arguments: Any) -> tuple[int, R]:
    """Call a kernel from another one; 0 and what it returns, if the runs agree in all that it decides.

    Else the runs, as bits, for which a condition held where it did not for the others; what was written by then stays.
    """
    return 0, function(*arguments)


def new_lanes(*shape: int, dtype: Any = np.float64, make: Callable[..., Any] = np.zeros) -> Any:
    """Zeros (..., RUNS), that begin where a processor can take RUNS of them at once; `np.empty` makes any numbers."""
    size, line = math.prod(shape) * RUNS, 8 * RUNS
    room = make(size + RUNS, dtype=dtype)
    first = -room.ctypes.data % line // 8
    return room[first : first + size].reshape(*shape, RUNS)
