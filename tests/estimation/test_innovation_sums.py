"""Sums of the latest innovations: how often right ones are refused, with and without errors that last, and drifts."""

import numpy as np
import pytest

from relnav.estimation.attitude import LASTING
from relnav.estimation.gating import chi_square_limit
from relnav.estimation.innovation_sums import INNOVATION, RECENT, SUMS, remember_innovation, sums_are_credible

RUNS, SHARE = 1500, 0.02
LIMIT = chi_square_limit(1.0 - SHARE, 3)


def refused(rng, *, sigma, count, drift=0.0):
    """Share of runs refused after so many innovations; sigma: of a lasting error, in those of the noise."""
    recent, sums, several = np.zeros(RECENT, INNOVATION), np.zeros(1, SUMS)[0], 0
    effect = np.zeros((3, LASTING))
    effect[:, :3] = sigma * np.eye(3)
    root = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 2.0]])
    covariance = root @ root.T + effect @ effect.T
    for _ in range(RUNS):
        lasting = sigma * rng.normal(size=3)
        for k in range(count):
            y = root @ rng.normal(size=3) + lasting + drift * np.array([0.0, 0.0, 2.0])
            remember_innovation(recent[k % RECENT], y, covariance, effect)
        several += not sums_are_credible(recent, count, sums, LIMIT)
    return several / RUNS


@pytest.mark.parametrize("sigma", [0.0, 3.0], ids=["white", "lasting"])
@pytest.mark.parametrize("count", [2, 12, 30])
def test_right_innovations_are_refused_as_rarely_as_stated(sigma, count):
    """At least by one sum's share, at most by that of all. Lasting errors taken for noise: a seventh and more."""
    share = refused(np.random.default_rng(3), sigma=sigma, count=count)
    spread = 4.0 * np.sqrt(SHARE / RUNS)
    assert SHARE - spread < share < (min(count, RECENT) - 1) * SHARE + spread


def test_a_drift_below_the_noise_is_seen_in_many():
    """One sigma each: 12 in the sum of twelve, of three degrees of freedom; two hardly show it."""
    rng = np.random.default_rng(4)
    assert refused(rng, sigma=0.0, count=2, drift=1.0) < 0.2
    assert refused(rng, sigma=0.0, count=40, drift=1.0) > 0.5


def test_one_innovation_is_the_gate_s_matter():
    recent, sums = np.zeros(RECENT, INNOVATION), np.zeros(1, SUMS)[0]
    remember_innovation(recent[0], np.full(3, 100.0), np.eye(3), np.zeros((3, LASTING)))
    assert sums_are_credible(recent, 1, sums, LIMIT)
