"""P = U D U^T: factors, time update and measurement update against the textbook's full matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.estimation.factored import (
    add_rank_one,
    add_three_rank_ones,
    compose,
    compose_into,
    factorize,
    factorize_into,
    innovation_variance,
    scalar_update,
    solve_factored,
)

SEED = st.integers(0, 10_000)


def random_covariance(rng: np.random.Generator, spread: float = 3.0) -> np.ndarray:
    """Well conditioned correlations under sigmas over several decades."""
    m = rng.normal(size=(6, 9))
    c = m @ m.T
    sigma = 10.0 ** rng.uniform(-spread, spread, 6) / np.sqrt(np.diag(c))
    return c * np.outer(sigma, sigma)


def in_sigmas(p: np.ndarray, like: np.ndarray) -> np.ndarray:
    sigma = np.sqrt(np.diag(like))
    return p / np.outer(sigma, sigma)


def assert_same(got: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    np.testing.assert_allclose(in_sigmas(got, expected), in_sigmas(expected, expected), rtol=0.0, atol=tolerance)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(SEED)
def test_round_trip(seed: int) -> None:
    p = random_covariance(np.random.default_rng(seed))
    ld = factorize(p)
    assert (np.diag(ld) > 0.0).all()
    np.testing.assert_array_equal(np.triu(ld, 1), 0.0)
    u, d = np.tril(ld, -1) + np.eye(6), np.diag(np.diag(ld))
    assert_same(u @ d @ u.T, p, 2e-15)
    assert_same(compose(ld), p, 2e-15)
    np.testing.assert_array_equal(compose(ld), compose(ld).T)
    out = np.full((6, 6), np.nan)
    compose_into(ld, out)
    assert_same(out, p, 2e-15)


def test_many_at_once() -> None:
    rng = np.random.default_rng(1)
    p = np.array([[random_covariance(rng) for _ in range(3)] for _ in range(2)])
    ld = np.array([[factorize(q) for q in row] for row in p])
    got = compose(ld)
    assert got.shape == (2, 3, 6, 6)
    for i in range(2):
        for j in range(3):
            assert_same(got[i, j], p[i, j], 2e-15)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(SEED)
def test_time_update(time_update, seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, q, phi = random_covariance(rng, 1.0), random_covariance(rng, 1.0), rng.normal(size=(6, 6))
    ld = factorize(p)
    time_update(ld, phi, factorize(q))
    expected = phi @ p @ phi.T + q
    assert_same(compose(ld), expected, 1e-13)
    np.testing.assert_array_equal(np.triu(ld, 1), 0.0)
    assert (np.diag(ld) > 0.0).all()


def test_time_update_without_noise_and_without_uncertainty(time_update) -> None:
    rng = np.random.default_rng(4)
    p, phi, none = random_covariance(rng, 1.0), rng.normal(size=(6, 6)), np.zeros((6, 6))
    ld = factorize(p)
    time_update(ld, phi, none)
    assert_same(compose(ld), phi @ p @ phi.T, 1e-13)
    ld = np.zeros((6, 6))
    time_update(ld, phi, factorize(p))
    assert_same(compose(ld), p, 1e-14)
    ld = np.zeros((6, 6))
    time_update(ld, phi, none)
    np.testing.assert_array_equal(ld, 0.0)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(SEED, st.floats(-4.0, 4.0))
def test_measurement_update(seed: int, log_r: float) -> None:
    """K = P h / (h P h + r), x + K residual, P - K h P: Bar-Shalom, Li, Kirubarajan (2001), section 5.2.3."""
    rng = np.random.default_rng(seed)
    p, h, x = random_covariance(rng, 1.0), rng.normal(size=6), rng.normal(size=6)
    r, residual = 10.0**log_r, 0.7
    ld, updated = factorize(p), x.copy()
    s = h @ p @ h + r
    assert innovation_variance(ld, h, h) == pytest.approx(s - r, rel=1e-12)
    assert scalar_update(updated, ld, h, r, residual) == pytest.approx(s, rel=1e-12)
    k = p @ h / s
    np.testing.assert_allclose(updated, x + k * residual, rtol=0.0, atol=1e-12 * np.abs(k).max() + 1e-14)
    # Joseph's form, which is the textbook's without its cancellation
    j = np.eye(6) - np.outer(k, h)
    assert_same(compose(ld), j @ p @ j.T + r * np.outer(k, k), 1e-10)


def test_a_zero_gradient_tells_nothing() -> None:
    p = random_covariance(np.random.default_rng(6))
    ld, x = factorize(p), np.arange(6.0)
    before = ld.copy()
    assert scalar_update(x, ld, np.zeros(6), 2.0, 5.0) == 2.0
    np.testing.assert_array_equal(x, np.arange(6.0))
    np.testing.assert_array_equal(ld, before)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(SEED)
def test_solve(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, rhs = random_covariance(rng, 1.0), rng.normal(size=6)
    got = rhs.copy()
    solve_factored(factorize(p), got)
    np.testing.assert_allclose(p @ got, rhs, rtol=0.0, atol=1e-9)


def test_solve_leaves_out_what_is_known() -> None:
    p = np.diag([2.0, 0.0, 4.0, 1.0, 0.0, 5.0])
    got = np.ones(6)
    solve_factored(factorize(p), got)
    np.testing.assert_allclose(got, [0.5, 0.0, 0.25, 1.0, 0.0, 0.2], rtol=1e-15)


def test_innovation_variance_of_two_measurements() -> None:
    rng = np.random.default_rng(8)
    p, h1, h2 = random_covariance(rng, 1.0), rng.normal(size=6), rng.normal(size=6)
    ld = factorize(p)
    assert innovation_variance(ld, h1, h2) == pytest.approx(h1 @ p @ h2, rel=1e-11)
    assert innovation_variance(ld, h2, h1) == pytest.approx(h1 @ p @ h2, rel=1e-11)


@pytest.mark.parametrize(
    "p",
    [
        np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1e-9]),
        np.diag([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
        np.eye(6) + 0.5 * (np.eye(6, k=1) + np.eye(6, k=-1)) * 2.5,
        np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]) + 0.1 * (np.eye(6, k=5) + np.eye(6, k=-5)),
    ],
    ids=["negative", "negative first", "correlation above one", "zero variance correlated"],
)
def test_not_positive_semidefinite(p: np.ndarray) -> None:
    with pytest.raises(ValueError, match="the covariance is not positive semidefinite"):
        factorize(p)
    assert not factorize_into(p, np.zeros((6, 6)))


@pytest.mark.parametrize(
    "p",
    [np.ones((6, 5)), np.ones(6), np.eye(6) + 0.1 * np.eye(6, k=1), np.full((6, 6), np.nan)],
    ids=["size", "vector", "not symmetric", "NaN"],
)
def test_not_a_covariance(p: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"a covariance is a symmetric matrix \(n, n\); got"):
        factorize(p)


def test_rank_one():
    rng = np.random.default_rng(3)
    for rank in (6, 4, 0):
        a = rng.normal(size=(6, rank))
        ld, v = factorize(a @ a.T), rng.normal(size=6)
        if rank == 4:
            v[2] = 0.0
        add_rank_one(ld, v)
        np.testing.assert_allclose(compose(ld), a @ a.T + np.outer(v, v), atol=1e-12)
        assert (np.diag(ld) >= 0.0).all()


@pytest.mark.parametrize("size", [6, 12])
def test_three_at_once_are_three_one_after_another(size):
    rng = np.random.default_rng(4)
    for rank in (size, size - 2, 0):
        a, v = rng.normal(size=(size, rank)), rng.normal(size=(3, size))
        v[1, 0] = v[2] = 0.0
        one_by_one = factorize(a @ a.T)
        at_once = one_by_one.copy()
        for row in v:
            add_rank_one(one_by_one, row)
        add_three_rank_ones(at_once, v)
        np.testing.assert_array_equal(at_once, one_by_one)
