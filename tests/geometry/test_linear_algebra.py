"""Small solvers against numpy's, what they refuse, and the skew matrix."""

import numpy as np
import pytest

from relnav.geometry.linear_algebra import (
    cholesky,
    cross_matrix,
    invert_three,
    solve_lower,
    solve_lower_transposed,
    solve_positive,
)


@pytest.fixture
def positive():
    """positive(rng, n) -> a positive definite matrix (n, n) whose rows differ by orders of magnitude."""

    def make(rng, n):
        root = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-4, 4, n)
        return root.T @ root

    return make


@pytest.mark.parametrize("n", [1, 2, 6, 12])
def test_cholesky_against_numpy(positive, n):
    rng = np.random.default_rng(3)
    for _ in range(20):
        matrix = positive(rng, n)
        expected, factor = np.linalg.cholesky(matrix), matrix.copy()
        factor[np.triu_indices(n, 1)] = np.nan  # the upper triangle is not read
        assert cholesky(factor, 0.0, factor)
        np.testing.assert_allclose(np.tril(factor), expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("n", [1, 2, 6, 12])
def test_substitution_against_numpy(n):
    rng = np.random.default_rng(4)
    for _ in range(20):
        lower, right = np.tril(rng.normal(size=(n, n)), -1) + np.diag(rng.uniform(1.0, 3.0, n)), rng.normal(size=n)
        forward, backward = right.copy(), right.copy()
        squares = solve_lower(lower, forward)
        solve_lower_transposed(lower, backward)
        np.testing.assert_allclose(forward, np.linalg.solve(lower, right), rtol=0.0, atol=1e-9 * np.abs(forward).max())
        np.testing.assert_allclose(
            backward, np.linalg.solve(lower.T, right), rtol=0.0, atol=1e-9 * np.abs(backward).max()
        )
        assert squares == pytest.approx(forward @ forward, rel=1e-12)


def test_a_column_of_a_matrix_is_solved_in_place():
    lower, columns = np.array([[2.0, 0.0], [1.0, 4.0]]), np.array([[2.0, 8.0, 4.0], [9.0, 8.0, 6.0]])
    assert solve_lower(lower, columns[:, 1]) == 4.0**2 + 1.0**2
    np.testing.assert_array_equal(columns, [[2.0, 4.0, 4.0], [9.0, 1.0, 6.0]])


def test_solve_positive(positive):
    rng = np.random.default_rng(3)
    for _ in range(50):
        matrix, x = positive(rng, 6), rng.normal(size=6)
        right = matrix @ x
        assert solve_positive(matrix, right, 1e-13, np.empty((6, 6)))
        np.testing.assert_allclose(matrix @ right, matrix @ x, rtol=1e-6, atol=1e-9 * np.abs(matrix @ x).max())


@pytest.mark.parametrize("last", [0.0, -1.0, np.nan])
def test_what_is_not_positive_definite_is_refused(last):
    matrix = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, last])
    assert not cholesky(matrix, 0.0, np.empty((6, 6)))
    assert not solve_positive(matrix, np.ones(6), 0.0, np.empty((6, 6)))


def test_the_least_pivot_is_a_share_of_its_diagonal():
    """Pivots of [[1, c], [c, 1]] times s: s and s (1 - c^2)."""
    for scale in (1e-9, 1.0, 1e9):
        matrix = scale * np.array([[1.0, np.sqrt(0.9)], [np.sqrt(0.9), 1.0]])
        assert cholesky(matrix, 0.099, np.empty((2, 2)))
        assert not cholesky(matrix, 0.101, np.empty((2, 2)))


def test_invert_three_against_numpy() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        m = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-6, 6, size=(3, 1))
        out = np.empty((3, 3))
        assert invert_three(m, out)
        columns = np.abs(out).max(axis=0)
        np.testing.assert_allclose(out / columns, np.linalg.inv(m) / columns, rtol=0.0, atol=1e-9)
        assert invert_three(m, m)
        np.testing.assert_array_equal(m, out)


@pytest.mark.parametrize(
    "m",
    [
        np.zeros((3, 3)),
        np.ones((3, 3)),
        np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]),
        np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3], [1.0, 0.0, 0.0]]),
        np.full((3, 3), np.nan),
        np.diag([1.0, np.nan, 1.0]),
    ],
)
def test_invert_three_knows_singular(m: np.ndarray) -> None:
    assert not invert_three(m, np.empty((3, 3)))


@pytest.mark.parametrize("shape", [(3,), (5, 3), (2, 4, 3), (0, 3)])
def test_cross_matrix(shape):
    rng = np.random.default_rng(6)
    v, w = rng.normal(size=shape), rng.normal(size=shape)
    matrix = cross_matrix(v)
    assert matrix.shape == (*shape, 3)
    np.testing.assert_allclose((matrix @ w[..., None])[..., 0], np.cross(v, w), rtol=0.0, atol=1e-15)


def test_cross_matrix_of_plain_numbers():
    np.testing.assert_array_equal(cross_matrix((1, 2, 3)), [[0.0, -3.0, 2.0], [3.0, 0.0, -1.0], [-2.0, 1.0, 0.0]])
