"""The pieces of the update with considered errors, each against numpy's matrices."""

import numpy as np
import pytest

from relnav.estimation.schmidt import carry_into, information_gained, reset_into, squared_volume


def covariance(n, seed):
    A = np.random.default_rng(seed).normal(size=(n, n + 3))
    return A @ A.T


def test_a_turn_taken_in_turns_the_errors():
    P, theta = covariance(8, 1), np.array([0.3, -0.2, 0.5])
    cross = np.array([[0.0, -theta[2], theta[1]], [theta[2], 0.0, -theta[0]], [-theta[1], theta[0], 0.0]])
    G = np.eye(8)
    G[2:5, 2:5] -= 0.5 * cross
    out = P.copy()
    reset_into(out, theta, 2)
    np.testing.assert_allclose(out, G @ P @ G.T, rtol=0.0, atol=1e-13 * np.abs(P).max())


def test_a_step_of_the_errors_that_move():
    """F (4, 6) of 9 errors: the first four move, driven by the first six; the others stay, whole where they drive."""
    rng, P = np.random.default_rng(2), covariance(9, 3)
    F, Q = rng.normal(size=(4, 6)) * (rng.random((4, 6)) < 0.6), covariance(4, 4)
    whole = np.eye(9)
    whole[:4, :6] = F
    whole[:4, 6:] = 0.0
    expected = whole @ P @ whole.T
    expected[:4, :4] += Q
    seen = P.copy()
    seen[np.tril_indices(9, -1)] = np.where(np.tril_indices(9, -1)[0] < 6, seen[np.tril_indices(9, -1)], np.nan)
    after = np.full((9, 9), np.nan)
    places, counts = np.zeros((4, 6), dtype=np.int64), np.zeros(4, dtype=np.int64)
    carry_into(seen, F, Q, after, np.empty((6, 4)), places, np.empty((4, 6)), counts)
    right = np.triu_indices(9)
    np.testing.assert_allclose(after[right], expected[right], rtol=0.0, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(after[:6, :6], expected[:6, :6], rtol=0.0, atol=1e-12 * np.abs(expected).max())
    assert counts.tolist() == np.count_nonzero(F, axis=1).tolist()


def test_volumes_and_what_they_shrink_by():
    P = covariance(7, 5)
    for at in (0, 2, 4):
        block = P[at : at + 3, at : at + 3]
        assert squared_volume(P, at) == pytest.approx(np.linalg.det(block), rel=1e-12)
    assert information_gained(8.0, 2.0) == pytest.approx(np.log(2.0), rel=1e-15)
    assert information_gained(1.0, 1.0) == 0.0
