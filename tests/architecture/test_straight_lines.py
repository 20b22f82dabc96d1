"""Straight-line functions: the machine code does what their Python lines do, and what cannot be traced says so."""

import inspect
import math

import numpy as np
import pytest

import relnav.codegen.kernel as compiler
from relnav.codegen.kernel import (
    STRAIGHT_LINES,
    kernel,
    shapes_of,
    side_by_side,
    sizes_of,
    square,
    straight_line,
    vector,
)
from relnav.codegen.together import quotient, select
from relnav.codegen.trace import LANES, Trace
from relnav.navigation import log, pose_log  # noqa: F401  (registers the filters' functions)
from relnav.navigation.attitude import target_attitude  # noqa: F401  (as above)

NAMES = {
    f"{function.__module__}.{function.__name__}" + (f" of {n}" if n else ""): (function, n)
    for function in STRAIGHT_LINES
    for n in sizes_of(function)
}
FROM_PYTHON = {name: function for name, (function, n) in NAMES.items() if n in (0, 6)}


def arguments(function, rng, n=6):
    """Arrays and floats that fit the shapes, of both signs; L D factors get a positive diagonal."""
    shapes = shapes_of(function, n)
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
        if value.shape in ((6, 6), (12, 12)) and not isinstance(shape[0], str):
            value[np.diag_indices(len(value))] = np.abs(np.diag(value))
            value[np.triu_indices(len(value), 1)] = 0.0
        out.append(value)
    return out


def caller(function):
    """A kernel that calls it: only from there does the machine code run."""
    names = ", ".join(inspect.signature(function).parameters)
    space = {"called": function}
    exec(
        f"def call({names}):\n    return called({names})\n", space
    )  # numba needs a function with these very parameters
    return compiler.kernel(space["call"])


@pytest.mark.parametrize("name", NAMES)
def test_the_trace_does_what_the_lines_do(derivatives, name):
    """Bit for bit, each product rounded as in Python."""
    (function, n), rng = NAMES[name], np.random.default_rng(6)
    trace = Trace(function, shapes_of(function, n))
    for _ in range(3):
        given = arguments(function, rng, n)
        traced = [value.copy() if isinstance(value, np.ndarray) else value for value in given]
        expected, got = function(*given), derivatives.run(trace, traced)
        for one, other in zip(given, traced, strict=True):
            np.testing.assert_array_equal(other, one)
        if expected is not None:
            np.testing.assert_array_equal(got, np.atleast_1d(expected))


@pytest.mark.skipif(not compiler.is_compiled(), reason="numba is switched off")
@pytest.mark.parametrize("name", FROM_PYTHON)
def test_compiled_is_plain(name):
    """To the rounding of fused products, as badly conditioned inputs amplify it."""
    function, rng = FROM_PYTHON[name], np.random.default_rng(5)
    call = caller(function)
    for _ in range(20):
        plain = arguments(function, rng)
        compiled = [value.copy() if isinstance(value, np.ndarray) else value for value in plain]
        expected, got = function(*plain), call(*compiled)
        if expected is not None:
            np.testing.assert_allclose(np.array(got, float), np.array(expected, float), rtol=1e-8, atol=1e-12)
        for one, other in zip(plain, compiled, strict=True):
            np.testing.assert_allclose(other, one, rtol=1e-8, atol=1e-10 * np.max(np.abs(one)))


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


@pytest.mark.skipif(not compiler.is_compiled(), reason="numba is switched off")
def test_the_size_is_that_of_a_records_field():
    """Of the same lines: written out for six states and for twelve, by the type of the memory that they are given."""

    @straight_line(x=vector, m=square)
    def norm(x, m):
        total = 0.0
        for i in range(x.shape[0]):
            for j in range(x.shape[0]):
                total += x[i] * m[i, j] * x[j]
        return total

    @kernel
    def call(record):
        return norm(record["x"], record["m"])

    try:
        rng = np.random.default_rng(1)
        for n in (6, 12):
            record = np.zeros(1, dtype=[("x", float, n), ("m", float, (n, n))])[0]
            record["x"], record["m"] = rng.normal(size=n), rng.normal(size=(n, n))
            assert call(record) == pytest.approx(record["x"] @ record["m"] @ record["x"], rel=1e-12)
    finally:
        del STRAIGHT_LINES[norm]


def test_side_by_side_each_lane_is_as_when_alone():
    """Bit for bit: every kind of operation, entries in whole pieces and single ones, shared arrays and numbers."""

    @straight_line(own=(2, 3), out=(7,), shared=(3,))
    def mixture(own, out, shared, factor):
        for j in range(3):
            product = own[0, j] * shared[j] - own[1, j] * factor
            out[j] = abs(product) + math.sqrt(quotient(own[0, j], factor, 1.0) * own[0, j])
            out[3 + j] = select((own[1, j] > 0.0) & (product <= 1.0), -own[1, j], 2.0)
        out[6] = own[1, 2] / own[0, 0]

    together = side_by_side(mixture, "own", "out")

    @kernel
    def alone(own, out, shared, factor):
        for lane in range(LANES):
            mixture(own[lane], out[lane], shared, factor)

    @kernel
    def joined(own, out, shared, factor):
        together(own, out, shared, factor)

    try:
        rng = np.random.default_rng(8)
        for _ in range(20):
            own, shared = rng.normal(size=(LANES, 2, 3)), rng.normal(size=3)
            own[:, 0] = np.abs(own[:, 0])
            one, other, plain = (np.zeros((LANES, 7)) for _ in range(3))
            alone(own, one, shared, 0.7)
            joined(own, other, shared, 0.7)
            np.testing.assert_array_equal(other, one)
            together(own, plain, shared, 0.7)
            np.testing.assert_allclose(plain, one, rtol=1e-13, atol=1e-13)
            assert len({tuple(row) for row in one.tolist()}) == LANES
    finally:
        del STRAIGHT_LINES[mixture]


@pytest.mark.skipif(not compiler.is_compiled(), reason="numba is switched off")
def test_side_by_side_arrays_have_no_gaps():
    @straight_line(own=(2,))
    def double(own):
        own[0] = 2.0 * own[1]

    together = side_by_side(double, "own")

    @kernel
    def call(own):
        together(own)

    try:
        with pytest.raises(TypeError, match="argument 1 of double side by side has gaps"):
            call(np.zeros((LANES, 4))[:, ::2])
    finally:
        del STRAIGHT_LINES[double]
