"""Correlation of neighbouring innovations: a standard normal number for white ones, and what coloured noise does."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import expm

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.estimation.whiteness import NeighbourSums

FACING = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
RUNS, STEPS, DT, SPOT_M = 12, 1200, 0.1, 1e-5


def sums_of(v, used=None, parts=1):
    sums = NeighbourSums()
    used = np.ones(len(v), dtype=bool) if used is None else used
    for part in np.array_split(np.arange(len(v)), parts):
        sums.take(v[part], used[part])
    return sums


def uneven(rng, n):
    """White numbers whose size changes a hundredfold, correlated within an image, one of them seldom seen."""
    v = rng.normal(size=(n, 4)) @ rng.normal(size=(4, 4)) * 10.0 ** np.linspace(0.0, 2.0, n)[:, None]
    v[rng.random(n) < 0.7, 2] = np.nan
    return v


def test_white_innovations_give_a_standard_normal_number():
    rng = np.random.default_rng(1)
    z = np.array([sums_of(uneven(rng, 400)).z for _ in range(400)])
    low, high = chi_square_interval(len(z), 0.999)
    assert low < np.mean(z**2) < high
    assert abs(np.mean(z)) < 3.3 / math.sqrt(len(z))


@pytest.mark.parametrize("a", [-0.5, 0.3, 0.8])
def test_correlation_of_neighbours(a):
    v = np.random.default_rng(2).normal(size=(4000, 3))
    for k in range(1, len(v)):
        v[k] = a * v[k - 1] + math.sqrt(1.0 - a * a) * v[k]
    sums = sums_of(v * [1.0, 1e-6, 1e3])
    assert sums.correlation == pytest.approx(a, abs=0.03)
    assert sums.overconfident(1.0) is (a > 0.0)
    assert not sums.overconfident((1.0 - a) / (1.0 + a))


def test_in_parts_as_at_once():
    rng = np.random.default_rng(3)
    v, used = uneven(rng, 500), rng.random(500) < 0.9
    whole = sums_of(v, used)
    for parts in (2, 37, 500):
        cut = sums_of(v, used, parts)
        assert cut.z == pytest.approx(whole.z, rel=1e-9)
        assert cut.correlation == pytest.approx(whole.correlation, rel=1e-9)


def test_too_few_images_say_nothing():
    for n in (0, 1, 15):
        sums = sums_of(np.random.default_rng(4).normal(size=(n, 6)))
        assert math.isnan(sums.z)
        assert math.isnan(sums.correlation)
        assert not sums.overconfident(10.0)


def flown(truth, rng, correlation_s):
    """States (n, 6) on V-bar under white acceleration, and spots (n, 3, 2) with Gauss-Markov noise of 10 um."""
    phi, q = expm(truth.hill_matrix(truth.n) * DT), 1e-10
    root = np.linalg.cholesky(q * np.kron([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]], np.eye(3)))
    a = math.exp(-DT / correlation_s) if correlation_s else 0.0
    x, e, states, spots = np.array([6.5, 0, 0, 0, 0, 0.0]), rng.normal(size=(3, 2)), [], []
    for _ in range(STEPS):
        c = (truth.beacons - x[:3]) @ FACING.T
        states.append(x)
        spots.append(truth.f * c[:, :2] / c[:, 2:] + SPOT_M * e)
        e = a * e + math.sqrt(1.0 - a * a) * rng.normal(size=(3, 2))
        x = phi @ x + root @ rng.normal(size=6)
    return np.array(states), np.array(spots)


@pytest.mark.parametrize("method", ["fix", "spots"])
@pytest.mark.parametrize(
    ("correlation_s", "told"), [(0.0, False), (0.2, True), (0.2, False), (2.0, True), (2.0, False)]
)
def test_coloured_spot_noise(truth, method, correlation_s, told):
    """A filter that takes it for white says that it is overconfident, while NIS is 1 or less; one that is told is not.

    told: noise is stated as it is. Otherwise times sqrt((1 + a) / (1 - a)), as the documentation says, and NEES is 1.
    """
    model = relnav.load_model(
        "three_beacon_psd", {"attitude.sigma_deg": 0.0, "acceleration_noise_density_m2_s3": 1e-10}
    )
    a = math.exp(-DT / correlation_s) if correlation_s else 0.0
    stated = SPOT_M if told else SPOT_M * math.sqrt((1.0 + a) / (1.0 - a))
    sensor = dataclasses.replace(model.sensor, spot_noise_m=stated)
    model = dataclasses.replace(model, sensor=sensor, detector=None, light=None)
    nees, t = [], np.arange(STEPS) * DT
    for run in range(RUNS):
        states, spots = flown(truth, np.random.default_rng([run, 5]), correlation_s)
        solution = relnav.filter_epochs(model, t, spots, method=method)
        verdict = solution.nis_consistency()
        assert verdict.correlated is told
        assert ("overconfident: errors are alike from image to image" in str(verdict)) is told
        assert verdict.overconfident is told or correlation_s == 0.0
        assert not verdict.ratio > verdict.upper or correlation_s == 0.0  # NIS alone does not tell
        e = solution.state[600::150] - states[600::150]
        nees.extend(np.einsum("ki,ki->k", e, np.linalg.solve(solution.covariance[600::150], e[..., None])[..., 0]) / 6)
    assert np.mean(nees) > 2.0 if told else 0.6 < np.mean(nees) < 1.5
