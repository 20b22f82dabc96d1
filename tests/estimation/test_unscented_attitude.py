"""Sigma points spread and gathered again: the covariance that they came from, with noise on top."""

import numpy as np

from relnav.estimation.attitude import ATTITUDE_TRACK, TURNING
from relnav.estimation.factored import compose, factorize
from relnav.estimation.unscented_attitude import SIGMA_POINTS, gather_points, spread_points


def track_of(P):
    track = np.zeros((), ATTITUDE_TRACK)[()]
    track["dcm"] = np.eye(3)[[1, 2, 0]]
    track["rate"] = [0.01, -0.02, 0.03]
    track["ld"] = factorize(P)
    return track


def test_spread_and_gathered():
    rng = np.random.default_rng(3)
    A, B = rng.normal(size=(TURNING, 9)), rng.normal(size=(TURNING, 9))
    P, Q = 1e-4 * A @ A.T / 9.0, 1e-6 * B @ B.T
    track, points, work = track_of(P), np.zeros((), SIGMA_POINTS)[()], np.empty((4, 3))
    spread_points(track, track["ld"], points, work)
    offsets = points["rate"] - track["rate"]
    np.testing.assert_allclose(offsets.T @ offsets / 12.0, P[3:, 3:], rtol=0.0, atol=1e-18)
    np.testing.assert_allclose(offsets[0::2], -offsets[1::2], rtol=0.0, atol=1e-17)
    gather_points(track, points, Q, work)
    np.testing.assert_allclose(compose(track["ld"]), P + Q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(track["dcm"], np.eye(3)[[1, 2, 0]], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(track["rate"], [0.01, -0.02, 0.03], rtol=0.0, atol=1e-16)
