"""The pieces of the update with considered errors, each against numpy's matrices."""

import numpy as np
import pytest

from relnav.estimation.schmidt import (
    carry_into,
    gate_rows,
    take_chosen,
    take_gated,
)

LIMITS = np.array([0.0, 10.8, 13.8, 16.3, 18.5, 20.5, 22.5, 24.3, 26.1])
"""Of chi-square, exceeded with 1e-3, by degrees of freedom from none to eight."""


def covariance(n, seed):
    A = np.random.default_rng(seed).normal(size=(n, n + 3))
    return A @ A.T


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


class Rows:
    """Three to four groups of two rows about nine errors, of which the first five are kept whole and two considered."""

    def __init__(self, groups, seed):
        rng, m = np.random.default_rng(seed), 2 * groups
        self.P, self.H, self.R = covariance(9, seed), rng.normal(size=(m, 9)), np.zeros((m, m))
        for g in range(groups):
            self.R[2 * g : 2 * g + 2, 2 * g : 2 * g + 2] = covariance(2, seed + g)
        self.S = self.H @ self.P @ self.H.T + self.R
        self.y = 0.5 * np.linalg.cholesky(self.S) @ rng.normal(size=m)
        self.considered = np.zeros(9, dtype=bool)
        self.considered[[4, 7]] = True
        self.chosen, self.places = np.full(m, 7), np.zeros(9, dtype=np.int64)
        self.work = np.full((4 * m + 3, 9), np.nan)

    def gate(self):
        return gate_rows(
            self.P, self.y, self.H, self.R, 2, LIMITS, 5, self.chosen, self.work, self.places
        )  # fmt: skip

    def nis(self, rows):
        return self.y[rows] @ np.linalg.solve(self.S[np.ix_(rows, rows)], self.y[rows])

    def updated(self, rows):
        """P and the correction by Schmidt's gain, which is zero for what is considered, in Joseph's form."""
        H, S = self.H[rows], self.S[np.ix_(rows, rows)]
        K = self.P @ H.T @ np.linalg.inv(S)
        K[self.considered] = 0.0
        left = np.eye(9) - K @ H
        return left @ self.P @ left.T + K @ self.R[np.ix_(rows, rows)] @ K.T, K @ self.y[rows]


def taken(rows):
    P, correction = rows.P.copy(), np.full(9, np.nan)
    take_gated(P, rows.considered, 5, rows.chosen, rows.work, rows.places, correction)
    return P, correction


def assert_updated(rows, believed, P, correction):
    expected, expected_correction = rows.updated(believed)
    right = np.triu_indices(9)
    np.testing.assert_allclose(P[right], expected[right], rtol=0.0, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(P[:5, :5], expected[:5, :5], rtol=0.0, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(correction, expected_correction, rtol=0.0, atol=1e-11 * np.abs(correction).max())


@pytest.mark.parametrize("groups", [1, 3, 4])
def test_all_that_is_seen_is_believed(groups):
    rows = Rows(groups, 10 + groups)
    nis, seen, used = rows.gate()
    assert (seen, used) == (groups, groups)
    assert nis == pytest.approx(rows.nis(np.arange(2 * groups)), rel=1e-11)
    assert rows.chosen.tolist() == [1] * 2 * groups
    assert_updated(rows, np.arange(2 * groups), *taken(rows))


def test_what_is_not_seen_is_not_counted():
    rows = Rows(4, 20)
    rows.y[3] = np.nan
    believed = np.array([0, 1, 4, 5, 6, 7])
    nis, seen, used = rows.gate()
    assert (seen, used) == (3, 3)
    assert nis == pytest.approx(rows.nis(believed), rel=1e-11)
    assert rows.chosen.tolist() == [1, 1, 0, 0, 1, 1, 1, 1]
    assert_updated(rows, believed, *taken(rows))
    rows.y[:] = np.nan
    assert rows.gate() == (0.0, 0, 0)


def test_a_group_that_is_not_credible_alone_goes():
    rows = Rows(4, 30)
    rows.y[4] += 6.0 * np.sqrt(rows.S[4, 4])
    nis, seen, used = rows.gate()
    assert (seen, used) == (4, 3)
    assert nis == pytest.approx(rows.nis(np.arange(8)), rel=1e-11)
    believed = np.array([0, 1, 2, 3, 6, 7])
    assert rows.chosen.tolist() == [1, 1, 1, 1, 0, 0, 1, 1]
    assert_updated(rows, believed, *taken(rows))


def test_the_one_that_contradicts_the_others_goes():
    """Credible alone where little is known before, but not with the three that agree."""
    rows = Rows(4, 40)
    rows.P *= 1e4
    rows.H[:, 3:] = 0.0
    rows.S = rows.H @ rows.P @ rows.H.T + rows.R
    rows.y = rows.H @ (np.linalg.cholesky(rows.P) @ np.full(9, 0.2))
    rows.y[2:4] += 40.0
    alone = [rows.nis(np.arange(2 * g, 2 * g + 2)) for g in range(4)]
    assert max(alone) < LIMITS[2]
    assert rows.nis(np.arange(8)) > LIMITS[8]
    assert rows.nis(np.array([0, 1, 4, 5, 6, 7])) < LIMITS[6]
    _, seen, used = rows.gate()
    assert (seen, used) == (4, 3)
    assert rows.chosen.tolist() == [1, 1, 0, 0, 1, 1, 1, 1]


def test_two_that_contradict_one_another_both_go():
    rows = Rows(2, 50)
    rows.P *= 1e4
    rows.H[2:4] = rows.H[0:2]
    rows.S = rows.H @ rows.P @ rows.H.T + rows.R
    rows.y = np.array([0.0, 0.0, 60.0, 60.0])
    assert max(rows.nis(np.arange(2)), rows.nis(np.arange(2, 4))) < LIMITS[2]
    _, seen, used = rows.gate()
    assert (seen, used) == (2, 0)
    assert rows.chosen.tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("far", [0.0, 0.3])
def test_rows_taken_in_again(far):
    """Linearised where a correction led: the innovation is the residual there and what the correction predicts."""
    rows = Rows(3, 60)
    rows.gate()
    P, correction = rows.P.copy(), far * np.arange(9.0)
    expected = Rows(3, 60)
    expected.y = rows.y + rows.H @ correction
    again = (rows.considered, rows.y, rows.H, rows.R, 5, rows.chosen)
    assert take_chosen(rows.P, *again, P, correction, rows.work, rows.places)
    assert_updated(expected, np.arange(6), P, correction)
    rows.y[1] = np.nan
    P = np.full((9, 9), 3.0)
    assert not take_chosen(rows.P, *again[:1], rows.y, *again[2:], P, correction, rows.work, rows.places)
    assert (P == 3.0).all()
