"""Numbers as text and back are what Python's `repr` and `float` give, whatever the number."""

import numpy as np
import pytest

from relnav.decimals import powers_of_ten, read_rows
from relnav.files.compiled_text import texts_of

N = 20_000
RNG = np.random.default_rng(5)
BITS = RNG.integers(0, 2**64, N, dtype=np.uint64).view(np.float64)
TENS = np.array([float(f"1e{power}") for power in range(-30, 30)])  # `10.0**power` differs between processors
FAMILIES = {
    "any bits": np.where(np.isnan(BITS), np.inf, BITS),
    "as measured": RNG.normal(size=N) * 10.0 ** RNG.integers(-20, 20, N),
    "few digits": np.round(RNG.normal(size=N) * 100.0, 3),
    "integers": RNG.integers(-(10**17), 10**17, N).astype(np.float64),
    "powers of two": np.ldexp(1.0, RNG.integers(-1074, 1024, N)),
    "beside powers of ten": np.nextafter(
        TENS[RNG.integers(0, len(TENS), N)], np.where(RNG.random(N) < 0.5, 0.0, np.inf)
    ),
    "ties": np.ldexp(RNG.integers(2**50, 2**53, N).astype(np.float64), RNG.integers(-60, 10, N)),
    "ends": np.tile(
        [0.0, -0.0, 5e-324, 1.7976931348623157e308, np.inf, -np.inf, 1e16, 1e-4, 9999999999999998.0, 1e-5], 2
    ),
}


def text_of(values):
    """Two columns as compiled code writes them."""
    return "".join(str(text, "ascii") for text in texts_of(list(values.reshape(-1, 2).T), ()))


@pytest.mark.parametrize("family", FAMILIES)
def test_written_as_repr(family):
    values = FAMILIES[family].reshape(-1, 2)
    assert text_of(values) == "".join(f"{a!r},{b!r}\n" for a, b in values.tolist())


@pytest.mark.parametrize("family", FAMILIES)
def test_read_as_float(family):
    values = FAMILIES[family].reshape(-1, 2)
    text = text_of(values).encode()
    out, lines = np.empty_like(values), np.empty(len(values), dtype=np.int64)
    ask, state = np.empty((values.size, 4), dtype=np.int64), np.array([0, 1, 0, 0, 0])
    column = np.arange(2)
    assert read_rows(np.frombuffer(text, dtype=np.uint8), column, powers_of_ten(), out, lines, ask, state)
    for row, place, begin, end in ask[: state[4]].tolist():
        out[row, place] = float(text[begin:end])
    np.testing.assert_array_equal(out.view(np.int64), values.view(np.int64))
    assert state.tolist()[:4] == [len(text), len(values) + 1, len(values), len(values)]
    assert family in ("any bits", "powers of two", "ends") or state[4] < 0.001 * values.size


def test_powers_of_ten_to_twice_the_precision_of_a_float():
    for k in (-280, -22, -1, 0, 1, 22, 23, 280):
        high, low = powers_of_ten()[k + 280].tolist()
        assert high == float(f"1e{k}")
        (a, b), (c, d) = high.as_integer_ratio(), low.as_integer_ratio()
        off = abs((a * d + c * b) * 10 ** max(-k, 0) - 10 ** max(k, 0) * b * d)
        assert off * 2**105 <= 10 ** max(k, 0) * b * d
