"""Cubic roots against numpy, line pairs against lines that are known, meetings that lie on both curves."""

import numpy as np
import pytest

from relnav.geometry.conic_pencil import cubic_roots, degenerate_member, line_pair, meet


def conic(matrix):
    m = np.asarray(matrix)
    return tuple(float(m[i, j]) for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)))


def matrix(m):
    return np.array([[m[0], m[1], m[3]], [m[1], m[2], m[4]], [m[3], m[4], m[5]]])


def of_lines(one, other):
    return np.outer(one, other) + np.outer(other, one)


@pytest.mark.parametrize("spread", [1.0, 1e4, 1e9])
def test_cubic_roots(spread):
    rng = np.random.default_rng(1)
    for _ in range(300):
        roots = rng.normal(size=3) * [1.0, 1.0, spread]
        k = np.poly(roots)
        count, *got = cubic_roots(*(float(value) for value in k))
        assert count == 3
        np.testing.assert_allclose(sorted(got), sorted(roots), rtol=1e-7)


def test_cubic_with_one_real_root():
    rng = np.random.default_rng(2)
    for _ in range(300):
        real, pair = rng.normal(), complex(rng.normal(), 0.1 + abs(rng.normal()))
        k = np.real(np.poly([real, pair, pair.conjugate()]))
        count, got, *_ = cubic_roots(*(float(value) for value in k))
        assert count == 1
        assert got == pytest.approx(real, rel=1e-10, abs=1e-12)


def test_cubic_triple_root():
    count, *got = cubic_roots(*(float(value) for value in np.poly([0.7, 0.7, 0.7])))
    np.testing.assert_allclose(got[:count], 0.7, atol=1e-4)


def test_line_pair_is_what_was_multiplied():
    rng = np.random.default_rng(3)
    for _ in range(300):
        wanted = of_lines(*rng.normal(size=(2, 3)))
        real, *lines = line_pair(conic(wanted))
        assert real
        got = of_lines(*lines)
        scale = np.sum(got * wanted) / np.sum(got * got)
        np.testing.assert_allclose(scale * got, wanted, atol=1e-9 * np.abs(wanted).max())


def test_a_pair_of_imaginary_lines_is_not_real():
    real, _, _ = line_pair(conic(np.diag([1.0, 1.0, 0.0])))
    assert not real


def test_degenerate_member_is_degenerate_and_real():
    """Of the pencil of two conics through four known points: three line pairs, one is found."""
    rng = np.random.default_rng(4)
    for _ in range(300):
        points = np.column_stack([rng.normal(size=(4, 2)), np.ones(4)])
        pairs = [
            of_lines(np.cross(points[i], points[j]), np.cross(points[k], points[m]))
            for i, j, k, m in ((0, 1, 2, 3), (0, 2, 1, 3))
        ]
        c1, c2 = pairs[0] + 0.3 * pairs[1], pairs[1] - 0.7 * pairs[0]
        member, _ = degenerate_member(conic(c1), conic(c2))
        M = matrix(member)
        assert abs(np.linalg.det(M)) < 1e-9 * np.abs(M).max() ** 3
        for point in points:
            assert abs(point @ M @ point) < 1e-8 * np.abs(M).max() * (point @ point)
        real, *lines = line_pair(member)
        assert real
        for point in points:
            assert min(abs(np.dot(line, point)) / np.linalg.norm(line) for line in lines) < 1e-6


def test_meet_lies_on_both():
    rng = np.random.default_rng(5)
    met = 0
    for _ in range(300):
        line, m = rng.normal(size=3), rng.normal(size=(3, 3))
        m = m + m.T
        count, *xy = meet(tuple(float(value) for value in line), conic(m))
        if count == 2:
            met += 1
            for point in (np.array([*xy[:2], 1.0]), np.array([*xy[2:], 1.0])):
                assert abs(line @ point) < 1e-9 * np.linalg.norm(point)
                assert abs(point @ m @ point) < 1e-8 * np.abs(m).max() * (point @ point)
    assert met > 100


def test_meet_of_complex_points_is_their_real_part():
    """Y = 1 and the unit circle scaled by 0.8: x = +-0.6 i."""
    count, x, y, *_ = meet((0.0, 1.0, -1.0), conic(np.diag([1.0, 1.0, -0.64])))
    assert (count, x, y) == (1, pytest.approx(0.0), pytest.approx(1.0))


def test_the_line_at_infinity_meets_nowhere():
    assert meet((0.0, 0.0, 1.0), conic(np.eye(3)))[0] == 0
