"""A memory's parts stand at the same places in compiled code as from Python, have no number in common, and fill it."""

from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

from relnav.codegen.kernel import kernel
from relnav.codegen.memory_layout import Layout

INNER = np.dtype([("count", np.int64), ("pair", np.float64, 2)])
FIXED = np.dtype([("x", np.float64), ("inner", INNER), ("m", np.int64), ("turn", np.float64, (2, 3))])
ROW = np.dtype([("a", np.float64), ("b", np.float64, (2, 2))])


class Toy(NamedTuple):
    """Of n rows and m errors."""

    fixed: Any
    inner: Any
    vector: Annotated[Any, "2n"]
    rows: Annotated[Any, ROW, "n"]
    matrix: Annotated[Any, "2n", "m"]
    stack: Annotated[Any, 3, "m", 4]
    nothing: Annotated[Any, 0, 0]


LAYOUT = Layout(Toy, FIXED, {"n": "inner.count", "m": "m"}, {})
views = LAYOUT.views


@kernel
def number_all(block, start: float) -> float:
    """Write a number of its own into everything that is not a count; returns the last."""
    m, at = views(block), start
    fixed, pair, turn = m.fixed, m.inner["pair"], m.fixed["turn"]
    fixed["x"] = at
    for i in range(2):
        at += 1.0
        pair[i] = at
        for j in range(3):
            at += 1.0
            turn[i, j] = at
    for i in range(m.vector.shape[0]):
        at += 1.0
        m.vector[i] = at
    for i in range(m.rows.shape[0]):
        b = m.rows[i]["b"]
        at += 1.0
        m.rows[i]["a"] = at
        for j in range(2):
            for k in range(2):
                at += 1.0
                b[j, k] = at
    for i in range(m.matrix.shape[0]):
        for j in range(m.matrix.shape[1]):
            at += 1.0
            m.matrix[i, j] = at
    for i in range(m.stack.shape[0]):
        for j in range(m.stack.shape[1]):
            for k in range(m.stack.shape[2]):
                at += 1.0
                m.stack[i, j, k] = at
    return at + m.nothing.size


@pytest.mark.parametrize(("n", "m"), [(3, 5), (1, 0), (7, 2)])
def test_compiled_views_are_those_of_python(n, m):
    compiled, plain = LAYOUT.new(n=n, m=m), LAYOUT.new(n=n, m=m)
    last = number_all(compiled, 1.0)
    assert getattr(number_all, "py_func", number_all)(plain, 1.0) == last
    np.testing.assert_array_equal(compiled, plain)
    counts = views(plain).fixed["m"], views(plain).inner["count"]
    assert counts == (m, n)
    numbers = np.delete(plain, [1, 4])  # the counts, whole numbers among floats
    np.testing.assert_array_equal(np.sort(numbers), np.arange(1.0, last + 1.0))
