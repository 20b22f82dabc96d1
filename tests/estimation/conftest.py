"""One place that knows the scratch of the time update."""

import inspect
from collections.abc import Callable

import numpy as np
import pytest

import relnav.codegen.kernel as compiler
from relnav.estimation.factored import scalar_update, time_update_into
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
