"""Port from port to second order: against differences of the exact geometry, and against errors that are drawn."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.dynamics.docking_port import port_geometry_into
from relnav.dynamics.port_second_order import ERRORS, SECOND_ORDER, add_second_order
from relnav.estimation.consistency import chi_square_interval
from relnav.geometry.linear_algebra import cross_matrix

POSE = 12
STEP = 1e-3
"""Second differences of it are good to a millionth: its square, and rounding by its square."""
PARTS = {"all": slice(0, 12), "position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9)}
PARTS["rate"] = slice(9, 12)


class Geometry:
    """Two bodies with ports, everything off the axes; seen exactly, and as the package linearises it.

    Some `far` metres apart, and turning at `fast` rad/s.
    """

    def __init__(self, seed, far=1.0, fast=1.0):
        rng = np.random.default_rng(seed)
        self.C_TL, self.C_TB = Rotation.random(2, rng=rng).as_matrix()
        self.motion, self.rates = rng.normal(size=6) * far, rng.normal(size=(2, 3)) * fast
        self.motion[3:] *= fast
        self.d, self.turn = rng.normal(size=3), 0.7 * fast
        self.found, self.G, self.A = np.empty((3, 3)), np.empty((POSE, POSE)), np.empty((POSE, 3))
        told = self.C_TL, self.C_TB, self.motion, self.rates, self.turn, self.d
        port_geometry_into(*told, self.found, self.G, self.A, np.empty((4, 3)))
        self.rows = np.hstack([self.G, self.A, np.zeros((POSE, 3))])
        self.rows[3:6, 15:], self.rows[9:, 15:] = self.A[:3], -self.C_TB

    def share(self, P):
        """Of the chaser's turn that the path has, by the covariance of all errors."""
        turn = -cross_matrix(self.motion[:3]) @ self.C_TL.T @ self.C_TB
        return np.clip(np.trace(turn @ P[12:15, :3]) / np.trace(turn @ P[12:15, 12:15] @ turn.T), 0.0, 1.0)

    def seen(self, x, share):
        """Position from the target's centre, velocity, attitude error and rate with errors x (18,)."""
        back = Rotation.from_rotvec(-x[6:9]).as_matrix()
        C_TL, C_TB = back @ self.C_TL, back @ self.C_TB @ Rotation.from_rotvec(x[12:15]).as_matrix()
        turn = share * (self.C_TL.T @ self.C_TB @ x[12:15])
        place, speed = (
            Rotation.from_rotvec(turn).apply(known + off - np.cross(turn, known))
            for known, off in ((self.motion[:3], x[:3]), (self.motion[3:], x[3:6]))
        )
        w_T, w_B = self.rates[0] + x[9:12], self.rates[1] + x[15:]
        arm = C_TL @ place + C_TB @ self.d
        swing = C_TL @ (speed + np.cross([0.0, -self.turn, 0.0], place)) + C_TB @ np.cross(w_B, self.d)
        theta = Rotation.from_matrix(self.C_TB @ C_TB.T).as_rotvec()
        return np.concatenate([arm, swing - np.cross(w_T, arm), theta, w_T - C_TB @ w_B])

    def error(self, x, share):
        return self.seen(x, share) - self.seen(np.zeros(ERRORS), share)

    def second_order(self, P):
        added, told = np.zeros((POSE, POSE)), (self.C_TB, self.motion, self.rates, self.turn, self.d)
        add_second_order(*told, self.found, self.G, self.A, P, added, np.zeros((), SECOND_ORDER)[()])
        return added


@pytest.mark.parametrize("shared", [0.0, 0.4, 1.0])
def test_it_is_that_of_the_second_derivatives(shared):
    """E q q^T of q = x^T H x / 2 is tr(H_i P H_j P) / 2 + tr(H_i P) tr(H_j P) / 4."""
    port, step, rng = Geometry(3), STEP * np.eye(ERRORS), np.random.default_rng(4)
    own = np.eye(ERRORS)
    own[:3, 12:15] = -shared * cross_matrix(port.motion[:3]) @ port.C_TL.T @ port.C_TB
    root = own @ (np.eye(ERRORS) + 0.1 * rng.normal(size=(ERRORS, ERRORS)))
    P = root @ root.T
    share = port.share(P)
    assert abs(share - shared) < 0.2
    H = np.empty((POSE, ERRORS, ERRORS))
    for i, a in enumerate(step):
        for j, b in enumerate(step):
            ends = port.seen(a + b, share) + port.seen(-a - b, share)
            H[:, i, j] = (ends - port.seen(a - b, share) - port.seen(b - a, share)) / (4 * STEP**2)
    HP = H @ P
    mean = 0.5 * np.trace(HP, axis1=1, axis2=2)
    expected = 0.5 * np.einsum("ikl,jlk->ij", HP, HP) + np.outer(mean, mean)
    np.testing.assert_allclose(port.second_order(P), expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def drawn(port, own, sigma, runs=500):
    """Covariances of first and second order, and errors drawn; own: of what is known well, with these sigmas."""
    own[:6] = np.linalg.solve(port.rows[:6, :6], np.hstack([np.eye(6), -port.rows[:6, 6:] @ own[6:, 6:]]))
    P = own * sigma**2 @ own.T
    first, share = port.rows @ P @ port.rows.T, port.share(P)
    draws = np.random.default_rng(6).normal(size=(runs, ERRORS))
    return first, first + port.second_order(P), np.array([port.error(own @ (sigma * z), share) for z in draws])


def nees(errors, covariance):
    """Over the degrees of freedom, mean of errors (runs, n)."""
    return np.mean(errors * np.linalg.solve(covariance, errors.T).T)


def check(errors, covariance):
    for name, part in PARTS.items():
        low, high = chi_square_interval((part.stop - part.start) * len(errors), 0.9999)
        assert low < nees(errors[:, part], covariance[part, part]) < high, name


@pytest.mark.parametrize(("angle_deg", "first_is_above"), [(2.0, 10.0), (1.0, 1.5)])
def test_a_target_known_to_degrees(angle_deg, first_is_above):
    """With a port that is known to 3 mm and 3 mm/s at 17 m."""
    port = Geometry(5, far=10.0, fast=0.05)
    sigma = np.repeat([3e-3, 3e-3, np.radians(angle_deg), 1e-3, np.radians(0.3), 1e-4], 3)
    first, whole, errors = drawn(port, np.eye(ERRORS), sigma)
    assert nees(errors, first) > first_is_above
    check(errors, whole)


def test_a_turn_of_all_together_is_not_felt():
    """Known by a camera alone: target and path as the chaser's attitude, which is off by two degrees."""
    port, own = Geometry(5, far=10.0, fast=0.05), np.eye(ERRORS)
    own[6:9, 12:15] = port.C_TB
    sigma = np.repeat([3e-3, 3e-3, np.radians(0.1), 1e-3, np.radians(2.0), 1e-4], 3)
    first, whole, errors = drawn(port, own, sigma)
    check(errors, whole)
    np.testing.assert_allclose(np.diagonal(whole)[:3], np.diagonal(first)[:3], rtol=0.1)
