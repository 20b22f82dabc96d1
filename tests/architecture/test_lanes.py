"""Numbers of which several stand side by side: each does what it does alone, and where they part it is said."""

import math

import numpy as np
import pytest

from relnav.codegen.kernel import is_compiled, kernel, long_entry
from relnav.codegen.together import RUNS, anywhere, attempt, held, lanes_of, new_lanes, select

pytestmark = pytest.mark.skipif(not is_compiled(), reason="side by side only in compiled code")
SPECIAL = [0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, math.nan, 0.5, 1e-300, 3.0]


@kernel
def arithmetic(a, b, k, j, out, whole):
    """All that kernels do with numbers, without a decision."""
    out[0], out[1], out[2], out[3] = a + b, a - b, a * b, a / b
    out[4], out[5], out[6], out[7] = a + 1.0, 2 * a, k * b, -a
    out[8], out[9], out[10] = max(a, b), min(a, b, 0.5), abs(a)
    out[11], out[12], out[13] = a**2, a**3, math.sqrt(abs(a))
    out[14], out[15], out[16] = select(a < b, a, b), select((a >= b) | (k == 2), 1.0, a), select(a != b, 1, k)
    out[17], out[18] = select(not a > b, a, 0.0), float(a)
    out[19] = 1.0
    out[19] += a
    out[19] *= b
    out[20] = math.log(abs(a)) + math.exp(min(a, 3.0)) + math.atan2(a, b)
    out[21] = math.sin(select(abs(a) < 4.0, a, 0.0)) + math.cos(0.1 * k) + math.acos(max(-1.0, min(1.0, a)))
    tame = select(abs(a) < 1e6, a, 0.0)
    whole[0], whole[1], whole[2], whole[3] = k + j, k - 2, k * j, -k
    whole[4], whole[5], whole[6], whole[7] = k % 3, k // 3, abs(k), max(k, j)
    whole[8], whole[9] = (k & 6) | 1, select((k > 0) & (j <= 2), k, j)
    whole[10], whole[11], whole[12] = math.floor(tame), math.ceil(tame), int(tame)
    whole[10] |= 4


@long_entry
def arithmetic_of_one(a, b, k, j, out, whole):
    for case in range(a.shape[0]):
        arithmetic(a[case], b[case], k[case], j[case], out[case], whole[case])


@long_entry
def arithmetic_of_lanes(a, b, k, j, out, whole):
    divided = 0
    for case in range(a.shape[0]):
        one, other = lanes_of(a)[case], lanes_of(b)[case]
        found, _ = attempt(
            arithmetic, one, other, lanes_of(k)[case], lanes_of(j)[case], lanes_of(out)[case], lanes_of(whole)[case]
        )
        divided |= found
    return divided


def test_every_operation_gives_each_lane_the_bits_that_it_has_alone():
    rng, cases = np.random.default_rng(1), 300
    numbers = rng.normal(size=(2, cases, RUNS)) * 10.0 ** rng.integers(-3, 4, (2, cases, RUNS))
    special = rng.random(numbers.shape) < 0.3
    numbers[special] = rng.choice(SPECIAL, special.sum())
    a, b, out = new_lanes(cases), new_lanes(cases), new_lanes(cases, 22)
    k, j, whole = (new_lanes(*shape, dtype=np.int64) for shape in ((cases,), (cases,), (cases, 13)))
    a[:], b[:] = numbers
    k[:], j[:] = rng.integers(-9, 10, (2, cases, RUNS))
    assert arithmetic_of_lanes(a, b, k, j, out, whole) == 0
    for lane in range(RUNS):
        one, ones = np.zeros((cases, 22)), np.zeros((cases, 13), dtype=np.int64)
        arithmetic_of_one(*(np.ascontiguousarray(x[:, lane]) for x in (a, b, k, j)), one, ones)
        np.testing.assert_array_equal(out[..., lane], one)
        signs = np.signbit(one) & ~np.isnan(one)
        np.testing.assert_array_equal(np.signbit(out[..., lane]) & ~np.isnan(one), signs)
        np.testing.assert_array_equal(whole[..., lane], ones)


@kernel
def ask(table, k, out):
    """Each lane's own entry of its own array, from either end; and what a few have to do."""
    out[0], some = table[k], table[k] > 2.0
    if anywhere(some):
        out[1] = select(held(some), out[0], -1.0)


@long_entry
def ask_of_one(table, k, out):
    for case in range(k.shape[0]):
        ask(table[case], k[case], out[case])


@long_entry
def ask_in_lanes(table, k, out):
    divided = 0
    for case in range(k.shape[0]):
        found, _ = attempt(ask, lanes_of(table)[case], lanes_of(k)[case], lanes_of(out)[case])
        divided |= found
    return divided


def test_each_lane_has_an_index_of_its_own():
    rng, cases, size = np.random.default_rng(2), 200, 5
    table, k, out = new_lanes(cases, size), new_lanes(cases, dtype=np.int64), new_lanes(cases, 2)
    table[:], k[:] = rng.uniform(0.0, 4.0, table.shape), rng.integers(-size, size, k.shape)
    assert ask_in_lanes(table, k, out) == 0
    some = np.take_along_axis(table, k[:, None] % size, axis=1)[:, 0] > 2.0
    for lane in range(RUNS):
        one = np.zeros((cases, 2))
        ask_of_one(np.ascontiguousarray(table[..., lane]), np.ascontiguousarray(k[:, lane]), one)
        np.testing.assert_array_equal(out[:, 0, lane], one[:, 0])
        expected = np.where(some[:, lane], one[:, 1], np.where(some.any(axis=1), -1.0, 0.0))
        np.testing.assert_array_equal(out[:, 1, lane], expected)


@kernel
def decide(value, count, table, out):
    """What lanes may only do together: a branch, a loop, an index."""
    if value > 0.0:
        out[0] = 1.0
    for i in range(count):
        out[1] += table[i]
    out[2] = table[count]
    out[3] = 1.0 if anywhere(value > 5.0) else 0.0


@long_entry
def decide_in_lanes(value, count, table, out):
    divided, _ = attempt(decide, lanes_of(value)[0], lanes_of(count)[0], table, lanes_of(out))
    return divided


def decided(values, counts):
    value, count, out = new_lanes(1), new_lanes(1, dtype=np.int64), new_lanes(4)
    value[0], count[0] = values, counts
    return decide_in_lanes(value, count, np.arange(1.0, 9.0), out), out


def test_lanes_that_agree_decide_together():
    divided, out = decided(np.linspace(1.0, 6.0, RUNS), 3)
    assert divided == 0
    np.testing.assert_array_equal(out, np.array([1.0, 6.0, 4.0, 1.0])[:, None] * np.ones(RUNS))
    assert decided(-1.0, 3)[1][0].max() == 0.0


def test_lanes_that_do_not_agree_are_named():
    """By a condition: those for which it held; by a number: those that have that of the first."""
    values = np.where(np.isin(np.arange(RUNS), (1, 4)), 1.0, -1.0)
    assert decided(values, 3)[0] == 0b10010
    counts = np.where(np.arange(RUNS) == 2, 5, 3)
    assert decided(1.0, counts)[0] == 2**RUNS - 1 - 0b100


def test_arrays_of_lanes_begin_where_vectors_may():
    for shape in ((1,), (3, 2), (0, 4)):
        made = new_lanes(*shape)
        assert made.shape == (*shape, RUNS)
        assert made.flags.c_contiguous
        assert made.ctypes.data % (8 * RUNS) == 0 or made.size == 0


def test_from_python_it_says_where_it_can_be_used():
    with pytest.raises(NotImplementedError, match=r"compiled code; got an array of shape \(2, 8\)"):
        lanes_of(new_lanes(2))
    assert attempt(max, 1, 2) == (0, 2)
