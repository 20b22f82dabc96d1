"""One place that knows the scratch of the time update, and records of monitors."""

import inspect
from collections.abc import Callable

import numpy as np
import pytest

import relnav.codegen.kernel as compiler
from relnav.estimation.factored import scalar_update, time_update_into
from relnav.estimation.monitors import watched_type
from relnav.estimation.smoothing import backward_model, smooth_step


@pytest.fixture(scope="session")
def time_update() -> Callable[[np.ndarray, np.ndarray, np.ndarray], None]:
    """(ld, phi, factors of Q): replaces ld in place."""
    return time_update_into


def compiled(function):
    """A kernel that calls a straight-line function: only from there does its machine code run."""
    if not compiler.is_compiled():
        return function
    names = ", ".join(inspect.signature(function).parameters)
    space = {"called": function}
    exec(f"def call({names}):\n    return called({names})\n", space)
    return compiler.kernel(space["call"])


@pytest.fixture(scope="session")
def compiled_time_update():
    return compiled(time_update_into)


@pytest.fixture(scope="session")
def compiled_update():
    return compiled(scalar_update)


@pytest.fixture(scope="session")
def compiled_smooth():
    return compiled(smooth_step)


@pytest.fixture(scope="session")
def compiled_model():
    return compiled(backward_model)


@pytest.fixture(scope="session")
def filled():
    """A record of zeros but for some fields."""

    def fill(dtype, **fields):
        one = np.zeros(1, dtype)[0]
        for name, value in fields.items():
            one[name] = value
        return one

    return fill


@pytest.fixture(scope="session")
def grouped():
    """Groups of the monitors, each from its fields."""

    def group(*several):
        groups = np.zeros(len(several), watched_type())
        for one, fields in zip(groups, several, strict=True):
            for name, value in fields.items():
                one[name] = value
        return groups

    return group
