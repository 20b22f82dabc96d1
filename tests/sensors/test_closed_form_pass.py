"""One pass of the closed form for three beacons near by: the true pose stays, a near one comes nearer."""

import numpy as np
import pytest

from relnav.sensors.three_beacon.perspective import _closed_form_pass

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
