"""Wahba's rotation: against scipy, its covariance against scatter, and what cannot be solved."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.geometry.rotation_vector import attitude_error
from relnav.geometry.wahba import solve_wahba

SIGMA = 1e-5


def directions(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def noisy(rng, w, sigma):
    e = rng.normal(size=w.shape) * np.broadcast_to(sigma, (len(w),))[:, None]
    e -= w * np.sum(e * w, axis=1, keepdims=True)
    return (w + e) / np.linalg.norm(w + e, axis=1, keepdims=True)


def test_it_is_scipys_rotation(outside):
    rng = np.random.default_rng(1)
    v, truth = directions(rng, 12), Rotation.random(rng=rng).as_matrix()
    sigma = rng.uniform(1e-5, 1e-4, 12)
    w = noisy(rng, v @ truth.T, sigma)
    theirs, _ = Rotation.align_vectors(w, v, weights=1.0 / sigma**2)
    off = np.abs(solve_wahba(w, v, sigma).dcm - theirs.as_matrix()).max()
    outside("SciPy Rotation.align_vectors", "attitude from twelve directions, matrix elements", off, 1e-12)


def test_covariance_and_chi2_over_many_draws():
    rng = np.random.default_rng(2)
    v, truth = directions(rng, 5), Rotation.random(rng=rng).as_matrix()
    sigma = np.array([1.0, 2.0, 1.0, 3.0, 1.5]) * SIGMA
    nees, chi2 = [], []
    for _ in range(2000):
        solution = solve_wahba(noisy(rng, v @ truth.T, sigma), v, sigma)
        e = attitude_error(solution.dcm, truth)
        nees.append(e @ np.linalg.solve(solution.covariance, e))
        chi2.append(solution.chi2)
    assert np.mean(nees) == pytest.approx(3.0, abs=5.0 * np.sqrt(6.0 / 2000))
    assert solution.dof == 7
    assert np.mean(chi2) == pytest.approx(7.0, abs=5.0 * np.sqrt(14.0 / 2000))


def test_a_reflection_is_never_returned():
    v = directions(np.random.default_rng(3), 6)
    solution = solve_wahba(v * (1.0, 1.0, -1.0), v, SIGMA)
    assert np.linalg.det(solution.dcm) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("w", "v", "message"),
    [
        (np.eye(3)[:1], np.eye(3)[:1], "n of 2 or more"),
        (np.eye(3), np.eye(3)[:2], "two equal arrays"),
        (2.0 * np.eye(3), np.eye(3), "measured holds unit vectors"),
        (np.eye(3), np.full((3, 3), np.nan), "known holds unit vectors"),
        (np.array([[0, 0, 1.0], [0, 0, 1.0]]), np.array([[0, 0, 1.0], [0, 0, -1.0]]), "along one line"),
    ],
)
def test_what_cannot_be_solved(w, v, message):
    with pytest.raises(ValueError, match=message):
        solve_wahba(w, v, SIGMA)
