"""What is left of a long record: bounded, in order, every extreme and every sum kept, however it was cut."""

import numpy as np
import pytest

from relnav.files.thinning import Thinning


def thinned(t, columns, summed, cuts, most):
    thinning = Thinning(most)
    for begin, end in zip([0, *cuts], [*cuts, len(t)], strict=True):
        thinning.take(t[begin:end], columns[:, begin:end], summed[:, begin:end])
    return thinning.thin()


@pytest.mark.parametrize(("n", "most"), [(1, 8), (7, 8), (16, 8), (999, 8), (5000, 64), (4097, 256)])
def test_every_group_holds_the_extremes_of_its_epochs(n, most):
    rng = np.random.default_rng(n)
    t = np.cumsum(rng.uniform(0.1, 0.2, n))
    columns, summed = rng.normal(size=(3, n)), rng.normal(size=(2, n))
    columns[1, rng.random(n) < 0.4] = np.nan
    cuts = np.sort(rng.integers(0, n, 4)).tolist()
    thin = thinned(t, columns, summed, cuts, most)
    assert thin.epochs == n
    assert len(thin.begin) <= 2 * most + 1
    assert thin.begin[0] == t[0]
    assert thin.end[-1] == t[-1]
    first = np.searchsorted(t, thin.begin)
    last = np.searchsorted(t, thin.end)
    np.testing.assert_array_equal(first[1:], last[:-1] + 1)  # nothing left out, nothing twice
    for g, (a, b) in enumerate(zip(first, last, strict=True)):
        group = columns[:, a : b + 1]
        for k in range(3):
            known = group[k][~np.isnan(group[k])]
            if not known.size:
                assert np.isnan(thin.low[k, g])
                assert np.isnan(thin.high[k, g])
                continue
            assert thin.low[k, g] == known.min()
            assert thin.high[k, g] == known.max()
            if known.size > 1:
                assert thin.rising[k, g] == (np.nanargmin(group[k]) < np.nanargmax(group[k]))
        np.testing.assert_allclose(thin.sums[:, g], summed[:, a : b + 1].sum(axis=1), atol=1e-12)


def test_a_short_record_stays_as_it_is():
    t = np.arange(10.0)
    thin = thinned(t, t[None] ** 2, t[None], [3], 8)
    assert thin.whole
    np.testing.assert_array_equal(thin.times(), t)
    np.testing.assert_array_equal(thin.line(0), t**2)


def test_a_line_passes_through_one_peak_among_a_million():
    t = np.arange(1_000_000) / 10.0
    values = np.sin(t / 900.0)[None]
    values[0, 654_321] = 40.0
    thin = thinned(t, values, values[:0], [100_000, 700_001], 8192)
    line, times = thin.line(0), thin.times()
    assert line.max() == 40.0
    assert abs(times[line.argmax()] - t[654_321]) < 1.0 + t[-1] / 8192
    assert np.all(np.diff(times) > 0.0)
