"""Errors that last and are considered: S and what is reported against Schmidt's formulas in numpy."""

import numpy as np
import pytest

from relnav.estimation import considered
from relnav.estimation.rows import Observed, group_type, sweep, track_type

N, ERRORS = 6, 4


def factors(covariance):
    lower = np.linalg.cholesky(covariance)
    return np.tril(lower / np.diag(lower), -1) + np.diag(np.diag(lower) ** 2)


def composed(ld):
    lower = np.tril(ld, -1) + np.eye(N)
    return lower @ np.diag(np.diag(ld)) @ lower.T


def spd(rng, size):
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.2 * np.eye(size)


@pytest.mark.parametrize(("row", "felt"), [((0.0, 0.0), False), ((0.0, -0.5), True), ((0.5, -0.5), True)])
def test_an_error_is_felt_where_it_moves_anything(row, felt):
    assert considered.is_felt(np.array(row)) == felt


@pytest.mark.parametrize("size", [6, 12])
@pytest.mark.parametrize(("first", "last"), [(0, ERRORS), (1, 3), (2, 2)])
def test_what_is_taken_up_is_subtracted(first, last, size):
    """Of errors of every filter: rows see the first half of each six."""
    rng = np.random.default_rng(1)
    groups = np.zeros(3, group_type(size))
    groups["rows"], groups["gradient"] = (2, 1, 2), rng.normal(size=(3, 3, size))
    groups["gradient"][..., np.arange(size) % 6 > 2] = 0.0
    E, S = rng.normal(size=(6, ERRORS)), rng.normal(size=(ERRORS, size))
    taken = groups["gradient"][:, :2].reshape(6, size) @ S.T
    taken[3] = taken[:, :first] = taken[:, last:] = 0.0
    expected = E - taken
    considered.subtract_taken(groups, E, S, first, last)
    np.testing.assert_allclose(E, expected, rtol=0.0, atol=1e-12)


def test_what_is_not_taken_up_is_noise():
    rng = np.random.default_rng(2)
    E, R = rng.normal(size=(5, ERRORS)), spd(rng, 5)
    expected = R + E @ E.T
    R[np.triu_indices(5, 1)] = np.nan  # written, not read
    considered.add_lasting_noise(E, R)
    np.testing.assert_allclose(R, expected, rtol=0.0, atol=1e-12)


def test_a_covariance_times_a_vector_is_added():
    rng = np.random.default_rng(3)
    P, v, out = spd(rng, N), *rng.normal(size=(2, N))
    expected = out + P @ v
    considered.add_covariance_times(factors(P), v, out)
    np.testing.assert_allclose(out, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("correlated", [True, False])
@pytest.mark.parametrize(("left", "unused"), [((), ()), ((1,), ()), ((0,), ((2, 0),)), ((), ((0, 1), (1, 0)))])
def test_an_image_moves_the_errors_as_the_gain_does(correlated, left, unused):
    """S + K (E - H S), of the rows in use alone; an error that no row shows leaves its S as it is."""
    rng = np.random.default_rng(4)
    groups, scratch = np.zeros(3, group_type(N)), np.zeros(3, group_type(N))
    groups["rows"], groups["tested"], scratch["variance"] = 2, 1, 5.0
    groups["gradient"][:, :2, :3] = rng.normal(size=(3, 2, 3))
    R = spd(rng, 6) if correlated else np.diag(rng.uniform(0.5, 2.0, 6))
    groups["variance"][:, :2] = np.diag(R).reshape(3, 2)
    for g in left:
        groups[g]["tested"] = 0
    for g, k in unused:
        groups[g]["variance"][k] = 0.0
    used = np.flatnonzero((np.repeat(groups["tested"], 2) > 0) & (groups["variance"][:, :2].reshape(-1) > 0.0))
    none = np.zeros((0, 0))
    seen = Observed(groups, *((R, np.full((6, 6), 5.0), scratch) if correlated else (none, none, scratch[:0])))
    track, work = np.zeros(2, track_type(N))
    P = spd(rng, N)
    track["ld"] = factors(P)
    sweep(track, track["state"], seen, work)
    E, S = rng.normal(size=(6, ERRORS)), rng.normal(size=(ERRORS, N))
    E[:, 2] = 0.0
    H = groups["gradient"][:, :2].reshape(6, N)[used]
    gain = np.linalg.solve(H @ P @ H.T + R[np.ix_(used, used)], H @ P).T
    expected = S + (gain @ E[used]).T
    considered.update_sensitivities(work["ld"], seen, E, np.full((ERRORS, N), 7.0), S)
    np.testing.assert_allclose(S, expected, rtol=0.0, atol=1e-10)


def test_what_is_reported_has_all_of_it():
    rng = np.random.default_rng(5)
    P, S = spd(rng, N), rng.normal(size=(ERRORS, N))
    S[1] = 0.0
    ld = factors(P)
    considered.join_considered(ld, S)
    np.testing.assert_allclose(composed(ld), P + S.T @ S, rtol=0.0, atol=1e-12)
