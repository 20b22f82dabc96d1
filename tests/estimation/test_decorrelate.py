"""Correlated measurements made independent: R = L diag(d) L^T, and the filter that uses it against the joint update."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_triangular

from relnav.estimation.factored import compose, decorrelate, factorize, scalar_update


def random_spd(rng: np.random.Generator, size: int) -> np.ndarray:
    m = rng.normal(size=(size, size + 2))
    return m @ m.T


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.integers(1, 6), st.integers(0, 10_000))
def test_factors(size: int, seed: int) -> None:
    r = random_spd(np.random.default_rng(seed), size)
    factor, variances = np.zeros((size, size)), np.zeros(size)
    assert decorrelate(r, factor, variances)
    np.testing.assert_array_equal(np.diag(factor), 1.0)
    np.testing.assert_array_equal(np.triu(factor, 1), 0.0)
    np.testing.assert_allclose(factor @ np.diag(variances) @ factor.T, r, rtol=0.0, atol=1e-13 * r.max())


def test_more_columns_than_rows_are_left_alone() -> None:
    """The caller's scratch is wider than the measurement."""
    r = np.hstack([random_spd(np.random.default_rng(1), 3), np.full((3, 3), np.nan)])
    factor, variances = np.zeros((3, 6)), np.zeros(3)
    assert decorrelate(r, factor, variances)
    np.testing.assert_allclose(factor[:, :3] @ np.diag(variances) @ factor[:, :3].T, r[:, :3], atol=1e-13 * 10)
    np.testing.assert_array_equal(factor[:, 3:], 0.0)


@settings(derandomize=True, max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_scalar_updates_of_decorrelated_measurements_are_the_joint_update(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, r, h = random_spd(rng, 6), random_spd(rng, 3), rng.normal(size=(3, 6))
    x, z = rng.normal(size=6), rng.normal(size=3)
    s = h @ p @ h.T + r
    k = np.linalg.solve(s, h @ p).T
    expected_x, expected_p = x + k @ (z - h @ x), p - k @ s @ k.T
    factor, variances = np.zeros((3, 3)), np.zeros(3)
    assert decorrelate(r, factor, variances)
    rows = solve_triangular(factor, h, lower=True)
    values = solve_triangular(factor, z, lower=True)
    ud, got = factorize(p), x.copy()
    nis = 0.0
    for i in range(3):
        residual = values[i] - rows[i] @ got
        nis += residual**2 / scalar_update(got, ud, np.ascontiguousarray(rows[i]), variances[i], residual)
    np.testing.assert_allclose(got, expected_x, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(compose(ud), expected_p, rtol=0.0, atol=1e-11 * p.max())
    assert nis == pytest.approx((z - h @ x) @ np.linalg.solve(s, z - h @ x), rel=1e-8)


@pytest.mark.parametrize(
    "r",
    [
        np.zeros((2, 2)),
        np.diag([1.0, -1.0]),
        np.ones((2, 2)),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        np.full((3, 3), np.nan),
        np.diag([1.0, np.nan]),
    ],
)
def test_not_definite(r: np.ndarray) -> None:
    assert not decorrelate(r, np.zeros(r.shape), np.zeros(len(r)))
