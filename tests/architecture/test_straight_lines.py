"""Straight-line functions: the machine code does what their Python lines do, and what cannot be traced says so."""

import inspect
import math

import numpy as np
import pytest

import relnav._kernel as compiler
from relnav._kernel import STRAIGHT_LINES, kernel, quotient, select, straight_line
from relnav._trace import Trace
from relnav.navigation import log  # noqa: F401  (registers the filter's functions)

NAMES = {f"{function.__module__}.{function.__name__}": function for function in STRAIGHT_LINES}


def arguments(function, rng):
    """Arrays and floats that fit the shapes, of both signs; U D factors get a positive diagonal."""
    shapes = STRAIGHT_LINES[function]
    out = []
    for name in inspect.signature(function).parameters:
        if name not in shapes:
            out.append(float(rng.uniform(0.1, 2.0)))
            continue
        shape = shapes[name]
        if isinstance(shape, str) or isinstance(shape[0], str):
            known = np.array([list(row) for row in ([shape] if isinstance(shape, str) else shape)])
            value = np.where(known == "*", rng.normal(size=known.shape), known == "1").astype(float)
            value = value[0] if isinstance(shape, str) else value
        else:
            value = rng.normal(size=shape)
        if value.shape in ((6, 6), (7, 6)) and not isinstance(shape[0], str):
            square = value[-6:]
            square[np.diag_indices(6)] = np.abs(square[np.diag_indices(6)])
            square[np.tril_indices(6, -1)] = 0.0
        out.append(value)
    return out


def caller(function):
    """A kernel that calls it: only from there does the machine code run."""
    names = ", ".join(inspect.signature(function).parameters)
    space = {"called": function}
    exec(
        f"def call({names}):\n    return called({names})\n", space
    )  # numba needs a function with these very parameters
    return compiler._NJIT(**compiler._OPTIONS)(space["call"])


@pytest.mark.skipif(not compiler.is_compiled(), reason="numba is switched off")
@pytest.mark.parametrize("name", NAMES)
def test_compiled_is_plain(name):
    """To rounding: numpy's and the machine's atan2 may differ in the last bit, all else is the same operations."""
    function, rng = NAMES[name], np.random.default_rng(5)
    call = caller(function)
    for _ in range(20):
        plain = arguments(function, rng)
        compiled = [value.copy() if isinstance(value, np.ndarray) else value for value in plain]
        expected, got = function(*plain), call(*compiled)
        if expected is not None:
            np.testing.assert_allclose(np.array(got, float), np.array(expected, float), rtol=1e-13, atol=0.0)
        for one, other in zip(plain, compiled, strict=True):
            np.testing.assert_allclose(other, one, rtol=1e-13, atol=1e-300)


def test_what_is_known_falls_away():
    def product(matrix, vector, out):
        for i in range(2):
            total = 0.0
            for j in range(2):
                total += matrix[i, j] * vector[j]
            out[i] = total

    trace = Trace(product, {"matrix": ("10", "0*"), "vector": (2,), "out": (2,)})
    names = [trace.nodes[place][0] for place in trace.needed()]
    assert sorted(names) == ["*", "entry", "entry", "entry"]


def test_nothing_is_computed_twice():
    def twice(a, b):
        return (a + b) * (b + a)

    names = [Trace(twice, {}).nodes[place][0] for place in Trace(twice, {}).needed()]
    assert names == ["argument", "argument", "+", "*"]


def test_a_branch_on_numbers_is_refused():
    def branch(a):
        return 1.0 if a > 0.0 else 2.0

    with pytest.raises(TypeError, match=r"cannot branch on its numbers: use select"):
        Trace(branch, {})


@pytest.mark.skipif(not compiler.is_compiled(), reason="numba is switched off")
def test_choices_results_and_scratch():
    @straight_line(v=(2,))
    def polar(v, turn):
        squares = np.zeros(2)
        for i in range(2):
            squares[i] = v[i] * v[i]
        r = math.sqrt(squares[0] + squares[1])
        v[0] = quotient(v[0], r, 7.0)
        return r, select((r > 1.0) & (turn > 0.0), math.atan2(v[1], v[0]) + turn, -turn), abs(-r) <= 5.0

    @kernel
    def call(v, turn):
        return polar(v, turn)

    try:
        for values in ([3.0, 4.0], [0.0, 0.0], [-6.0, 8.0]):
            a, b = np.array(values), np.array(values)
            assert call(a, 0.5) == pytest.approx(polar(b, 0.5), rel=1e-15)
            np.testing.assert_array_equal(a, b)
    finally:
        del STRAIGHT_LINES[polar]
