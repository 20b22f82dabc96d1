"""One pass of the closed form for three beacons near by: the true pose stays, a near one comes nearer."""

import numpy as np
import pytest

from relnav.sensors.three_beacon.invariants import invariants, rays_from_position
from relnav.sensors.three_beacon.perspective import _closed_form_pass, settle

A, B = 0.3, 0.5


def seen_from(p, truth_turn):
    """Unit vectors (3, 3) to the beacons and (3,) to O, in the axes of a camera at p."""
    beacons = np.array([[0.0, A, 0.0], [0.0, -A, 0.0], [B, 0.0, 0.0], [0.0, 0.0, 0.0]]) - p
    rays = beacons / np.linalg.norm(beacons, axis=1)[:, None] @ truth_turn.T
    return rays[:3].copy(), rays[3].copy()


@pytest.mark.parametrize("p", [(4.0, 1.0, -0.5), (2.0, -0.3, 0.8), (1.5, 0.2, 0.1), (9.0, -3.0, 2.0)])
def test_the_true_pose_stays(p):
    p = np.array(p)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    u, w = seen_from(p, turn)
    guess, line = p.copy(), w.copy()
    assert _closed_form_pass(u, A, B, line, guess, np.zeros((6, 3)))
    np.testing.assert_allclose(guess, p, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(line, w, rtol=0.0, atol=1e-12)
    near, line = 1.05 * p, w.copy()
    assert _closed_form_pass(u, A, B, line, near, np.zeros((6, 3)))
    assert np.linalg.norm(near - p) < 0.05 * np.linalg.norm(p)


def test_a_beacon_behind_is_refused():
    u, w = seen_from(np.array([4.0, 1.0, -0.5]), np.eye(3))
    u[2] = -u[2]
    assert not _closed_form_pass(u, A, B, w, np.array([4.0, 1.0, -0.5]), np.zeros((6, 3)))


def test_newton_ends_at_the_position_or_says_that_it_does_not():
    """From 300 places, some of them far off or behind: where it settles, the invariants are those that were seen."""
    rng, ended = np.random.default_rng(5), []
    for _ in range(300):
        p = np.array([rng.uniform(1.0, 9.0), rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)])
        g, u, distance = np.empty(3), np.empty((3, 3)), np.empty(3)
        rays_from_position(p, A, B, u, distance)
        invariants(u, g)
        q = p * rng.uniform(0.2, 5.0) + rng.normal(size=3) * rng.choice([0.01, 1.0, 3.0])
        if settle(g, A, B, q, np.empty((3, 3))):
            got = np.empty(3)
            rays_from_position(q, A, B, u, distance)
            invariants(u, got)
            assert np.abs(got - g).max() < 1e-13
            ended.append(np.linalg.norm(q - p) < 1e-9 * np.linalg.norm(p))
    assert len(ended) > 40
    assert sum(ended) > 0.8 * len(ended)
