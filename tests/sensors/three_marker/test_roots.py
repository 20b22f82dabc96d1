"""The compiled roots against numpy: which triples, what a score is, and the least certain axis."""

import itertools
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.sensors.three_marker.pose import Pose, belief_of, rank_roots, roots_of
from relnav.sensors.three_marker.roots import BELIEF, WORK, least_certain_axis, widest_triples
from relnav.sensors.three_marker.sensor import View


def spread(rng, n):
    q = rng.normal(size=(n, n))
    return q @ q.T + 0.1 * np.eye(n)


def test_widest_triples():
    rng = np.random.default_rng(1)
    for n in (3, 4, 5, 9):
        points, chosen = rng.normal(size=(n, 3)), np.empty((4, 4))
        count = widest_triples(points, chosen)

        def area(triple, points=points):
            a, b, c = points[list(triple)]
            return np.linalg.norm(np.cross(b - a, c - a))

        expected = sorted(itertools.combinations(range(n), 3), key=area, reverse=True)[:4]
        assert [tuple(row) for row in chosen[:count, :3].astype(int).tolist()] == expected


@pytest.mark.parametrize("whole", [True, False])
def test_score_is_the_evidence(whole):
    """Score = misfit + d^T S^-1 d + ln |S| - ln |R|, computed by numpy; the roots come in its order."""
    rng = np.random.default_rng(2)
    held, place, own = Rotation.random(random_state=3).as_matrix(), rng.normal(size=3), 0.01 * spread(rng, 6)
    quaternion = tuple(Rotation.from_matrix(held).as_quat())
    prior = Pose(place, held, own) if whole else View(quaternion, 0.1)
    assert belief_of(prior).shape == (BELIEF,)
    found, expected = [], []
    for misfit in (3.0, 0.5, 1.0, 2.0):
        turn, off = 0.1 * rng.normal(size=3), rng.normal(size=3)
        dcm, R = held @ Rotation.from_rotvec(turn).as_matrix(), 0.01 * spread(rng, 6)
        found.append((np.vstack([dcm, place + off]), np.linalg.inv(R), misfit))
        d, S, first = np.append(off, turn), R + own, 0
        if not whole:
            d, S, first = turn, R[3:, 3:] + 0.01 * np.eye(3), 3
        assert len(d) == 6 - first
        score = misfit + d @ np.linalg.solve(S, d) + np.linalg.slogdet(S)[1] - np.linalg.slogdet(R)[1]
        expected.append((score, misfit, R))
    roots = rank_roots(found, prior)
    for root, (score, misfit, R) in zip(roots, sorted(expected, key=lambda entry: entry[0]), strict=True):
        assert root.score == pytest.approx(score, rel=1e-9)
        assert root.misfit == misfit
        np.testing.assert_allclose(root.pose.covariance, R, atol=1e-12)
        with pytest.raises(ValueError, match="read-only"):
            root.pose.covariance[0, 0] = 0.0
        with pytest.raises(FrozenInstanceError):
            root.misfit = 0.0


def test_least_certain_axis():
    rng = np.random.default_rng(4)
    for _ in range(50):
        covariance, axis = spread(rng, 6) * 10.0 ** rng.uniform(-12.0, 2.0), np.empty(3)
        work = np.empty((WORK, 6, 6))
        variance = least_certain_axis(covariance, axis, work[0], work[1])
        values, axes = np.linalg.eigh(covariance[3:, 3:])
        assert variance == pytest.approx(values[-1], rel=1e-12)
        assert abs(axis @ axes[:, -1]) == pytest.approx(1.0, abs=1e-9)


def test_rows_are_told_apart():
    """Nine numbers of C, three of r, 36 of their covariance, misfit and score."""
    rows = np.arange(100.0).reshape(2, 50)
    first, second = roots_of(rows)
    np.testing.assert_array_equal(first.pose.dcm_cam_from_target, np.arange(9.0).reshape(3, 3))
    np.testing.assert_array_equal(second.pose.position_m, [59.0, 60.0, 61.0])
    np.testing.assert_array_equal(second.pose.covariance, np.arange(62.0, 98.0).reshape(6, 6))
    assert (first.misfit, first.score, second.misfit, second.score) == (48.0, 49.0, 98.0, 99.0)
    assert not rows.flags.writeable
