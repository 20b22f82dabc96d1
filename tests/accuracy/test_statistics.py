"""Error statistics and NEES bands on numbers whose answer is known."""

import numpy as np
import pytest

from relnav.accuracy.statistics import error_statistics, nees_band


def test_statistics_of_a_biased_normal():
    error = 0.3 + 2.0 * np.random.default_rng(1).normal(size=200_000)
    statistics = error_statistics(error, np.full(200_000, 2.0))
    assert statistics.bias == pytest.approx(0.3, abs=0.02)
    assert statistics.sigma == pytest.approx(2.0, rel=0.01)
    assert statistics.rms == pytest.approx(np.hypot(0.3, 2.0), rel=0.01)
    assert statistics.three_sigma == pytest.approx(3.09 * 2.0, rel=0.05)  # of |N(0.15, 1)|
    assert statistics.coverage_1 == pytest.approx(0.6774, abs=0.004)
    assert statistics.count == 200_000


def test_statistics_leave_out_what_is_not_there():
    statistics = error_statistics(np.array([1.0, np.nan, -1.0]), np.array([1.0, 1.0, np.nan]))
    assert statistics.count == 1
    assert np.isnan(error_statistics(np.array([np.nan]), np.ones(1)).rms)


@pytest.mark.parametrize(("scale", "low", "high"), [(1.0, 0.93, 0.97), (1.2, 0.0, 0.5), (0.8, 0.0, 0.5)])
def test_band_of_honest_over_and_underconfident_runs(scale, low, high):
    values = scale * np.random.default_rng(2).chisquare(6, size=(200, 3000))
    band = nees_band(values, 6)
    assert low <= band.inside_95 <= high
    assert (band.above_9999 > 0.1) == (scale > 1.0)
    assert band.mean == pytest.approx(6.0 * scale, rel=0.01)


def test_band_counts_runs_epoch_by_epoch():
    values = np.random.default_rng(3).chisquare(6, size=(10, 4))
    values[:6, 0] = np.nan
    values[:2, 1] = np.nan
    assert nees_band(values, 6).epochs == 3
