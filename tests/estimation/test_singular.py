"""The factored filter at the edge: perfect measurements, known components, covariances without full rank."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.estimation.factored import compose, factorize, factorize_into, scalar_update


def covariance(seed: int) -> np.ndarray:
    m = np.random.default_rng(seed).normal(size=(6, 9))
    return m @ m.T


@settings(derandomize=True, max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_a_perfect_measurement(seed: int) -> None:
    """With r = 0 the measured combination is known afterwards, the rest as the conditional normal distribution says."""
    p, h = covariance(seed), np.random.default_rng(seed + 1).normal(size=6)
    ud, x = factorize(p), np.zeros(6)
    s = scalar_update(x, ud, h, 0.0, 1.0)
    assert s == pytest.approx(h @ p @ h, rel=1e-12)
    np.testing.assert_allclose(x, p @ h / (h @ p @ h), rtol=0.0, atol=1e-12 * np.abs(x).max())
    assert h @ x == pytest.approx(1.0, rel=1e-12)
    after = compose(ud)
    np.testing.assert_allclose(after, p - np.outer(p @ h, p @ h) / (h @ p @ h), rtol=0.0, atol=1e-12 * p.max())
    np.testing.assert_allclose(after @ h, 0.0, atol=1e-12 * p.max())
    assert (np.diag(ud) >= 0.0).all()


@pytest.mark.parametrize("component", range(6))
def test_the_same_perfect_measurement_twice(component: int) -> None:
    """The second time there is nothing to learn: nothing changes, and 0 is returned."""
    h = np.zeros(6)
    h[component] = 1.0
    ud, x = factorize(covariance(2)), np.zeros(6)
    assert scalar_update(x, ud, h, 0.0, 1.0) > 0.0
    before_x, before = x.copy(), compose(ud)
    assert scalar_update(x, ud, h, 0.0, 5.0) == pytest.approx(0.0, abs=1e-13)
    if x[component] == before_x[component]:
        np.testing.assert_array_equal(x, before_x)
    np.testing.assert_allclose(compose(ud), before, rtol=0.0, atol=1e-13)


def test_nothing_known_to_be_uncertain() -> None:
    ud, x = np.zeros((6, 6)), np.ones(6)
    assert scalar_update(x, ud, np.ones(6), 0.0, 5.0) == 0.0
    np.testing.assert_array_equal(x, 1.0)
    assert scalar_update(x, ud, np.ones(6), 2.0, 5.0) == 2.0
    np.testing.assert_array_equal(x, 1.0)
    np.testing.assert_array_equal(ud, 0.0)


@pytest.mark.parametrize("known", [[0], [5], [2, 3], [0, 1, 2], [3, 4, 5], [0, 1, 2, 3, 4, 5]])
def test_components_without_uncertainty(known: list[int]) -> None:
    p = covariance(3)
    p[known, :] = 0.0
    p[:, known] = 0.0
    ud, x = factorize(p), np.zeros(6)
    np.testing.assert_allclose(compose(ud), p, rtol=0.0, atol=1e-13)
    h = np.linspace(1.0, 2.0, 6)
    s = scalar_update(x, ud, h, 0.5, 1.0)
    k = p @ h / (h @ p @ h + 0.5)
    assert s == pytest.approx(h @ p @ h + 0.5, rel=1e-12)
    np.testing.assert_allclose(x, k, rtol=0.0, atol=1e-13)
    np.testing.assert_array_equal(x[known], 0.0)
    np.testing.assert_allclose(compose(ud), p - np.outer(k, h @ p), rtol=0.0, atol=1e-12)


def test_time_update_fills_a_singular_covariance(time_update) -> None:
    p, q = np.diag([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), np.diag([0.0, 0.0, 0.0, 1e-4, 1e-4, 1e-4])
    phi = np.eye(6) + np.eye(6, k=3)
    ud = factorize(p)
    for _ in range(2):
        p = phi @ p @ phi.T + q
        time_update(ud, phi, factorize(q))
        np.testing.assert_allclose(compose(ud), p, rtol=0.0, atol=1e-15)


def test_rank_deficient_in_round_numbers() -> None:
    p = np.zeros((6, 6))
    p[:2, :2] = [[4.0, 2.0], [2.0, 1.0]]  # rank one, and every operation on it exact
    np.testing.assert_array_equal(compose(factorize(p)), p)


@pytest.mark.parametrize("rank", [1, 3, 5])
def test_rank_deficient_to_rounding(rank: int) -> None:
    """Such as the execution error of one impulse, sigma^2 u u^T: semidefinite but for the last bit."""
    rng = np.random.default_rng(9)
    for _ in range(20):
        m = rng.normal(size=(6, rank))
        p = m @ m.T
        p = 0.5 * (p + p.T)
        ud = np.zeros((6, 6))
        assert factorize_into(p, ud)
        np.testing.assert_allclose(compose(ud), p, rtol=0.0, atol=1e-11 * p.max())  # pivots of 1e-5 amplify rounding
