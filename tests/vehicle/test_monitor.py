"""Faded sums of squared innovations: the arithmetic, and how often a healthy one raises an alarm."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from relnav.vehicle.monitor import FADES_S, Sums


def test_it_is_the_faded_sum():
    times, nis = [0.5, 1.0, 4.0], [3.0, 1.0, 7.0]
    sums = Sums(0.0)
    for t, value in zip(times, nis, strict=True):
        sums = sums.after(t, value, 2)
    weights = [math.exp(-(times[-1] - t) / FADES_S) for t in times]
    assert sums.nis == pytest.approx(np.dot(weights, nis), rel=1e-14)
    assert sums.dof == pytest.approx(2.0 * sum(weights), rel=1e-14)
    assert sums.variance == pytest.approx(4.0 * np.dot(weights, weights), rel=1e-14)
    assert math.isnan(Sums(0.0).deviation)


@pytest.mark.parametrize(("rate_hz", "dof"), [(1.0, 2), (10.0, 6)])
def test_of_white_innovations_the_deviation_is_normal(rate_hz, dof):
    """Also far out: of 4,000 independent ends, as many above 2 and above 3 sigma as a normal variable has."""
    rng = np.random.default_rng(3)
    ends = []
    for _ in range(4000):
        sums = Sums(0.0)
        for k, value in enumerate(rng.chisquare(dof, int(40.0 * rate_hz)).tolist()):
            sums = sums.after((k + 1) / rate_hz, value, dof)
        ends.append(sums.deviation)
    ends = np.array(ends)
    assert abs(ends.mean()) < 4.0 / math.sqrt(len(ends))
    assert abs(ends.std() - 1.0) < 0.05
    for limit in (2.0, 3.0):
        expected = len(ends) * norm.sf(limit)
        assert abs((ends > limit).sum() - expected) < 4.0 * math.sqrt(expected)
