"""A plain extended Kalman filter as a textbook writes it, in numpy with Joseph's form, agrees with the product.

It shares no line with the product: Phi and Q by Van Loan's matrix exponential, h and its derivative by projection
written out, the update as one block. Compared to a millionth of a sigma, on the product's own start.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import relnav
from relnav.navigation.status import STARTED

N = 600


def clohessy_wiltshire(n):
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 5], a[4, 1], a[5, 2], a[5, 3] = 2 * n, -n * n, 3 * n * n, -2 * n
    return a


def van_loan(a, noise, dt):
    """Phi and Q of dx = A x dt + w, w of density `noise` (6, 6)."""
    m = np.zeros((12, 12))
    m[:6, :6], m[:6, 6:], m[6:, 6:] = -a, noise, a.T
    e = expm(m * dt)
    phi = e[6:, 6:].T
    return phi, phi @ e[:6, 6:]


class Textbook:
    """predict, update; `spots` with a known attitude."""

    def __init__(self, model, x, p):
        self.model, self.x, self.p = model, x, p
        self.a = clohessy_wiltshire(model.orbit.mean_motion_rad_s)
        self.beacons = model.beacons_lvlh_m
        self.c = model.dcm_cam_from_lvlh

    def predict(self, dt, acceleration):
        noise = self.model.process_noise
        density = noise.acceleration_noise_density_m2_s3 * np.eye(3)
        outer = np.outer(acceleration, acceleration)
        along, across = noise.control_magnitude_sigma**2, noise.control_direction_sigma_rad**2
        executed = along * outer + across * (acceleration @ acceleration * np.eye(3) - outer)
        full = np.zeros((6, 6))
        full[3:, 3:] = density + noise.control_correlation_time_s * executed
        phi, q = van_loan(self.a, full, dt)
        held = np.zeros((9, 9))
        held[:6, :6], held[3:6, 6:] = self.a, np.eye(3)
        self.x = phi @ self.x + expm(held * dt)[:6, 6:] @ acceleration
        self.p = phi @ self.p @ phi.T + q

    def update(self, spots):
        z, h, rows = [], [], []
        f = self.model.sensor.focal_length_m
        for i in range(3):
            c = self.c @ (self.beacons[i] - self.x[:3])
            for k in range(2):
                if np.isfinite(spots[i, k]):
                    z.append(spots[i, k])
                    h.append(f * c[k] / c[2])
                    gradient = f / c[2] * (np.eye(3)[k] - c[k] / c[2] * np.eye(3)[2])
                    rows.append(np.concatenate([-gradient @ self.c, np.zeros(3)]))
        if not z:
            return np.nan
        y, hh = np.array(z) - h, np.array(rows)
        r = self.model.sensor.spot_noise_m**2 * np.eye(len(y))
        s = hh @ self.p @ hh.T + r
        gain = np.linalg.solve(s, hh @ self.p).T
        self.x = self.x + gain @ y
        rest = np.eye(6) - gain @ hh
        self.p = rest @ self.p @ rest.T + gain @ r @ gain.T
        return y @ np.linalg.solve(s, y)


@pytest.mark.parametrize("axis", ["vbar", "rbar"])
def test_the_product_is_the_textbook_filter(request, drift, look, axis):
    model = request.getfixturevalue(axis)
    model = replace(model, filter=replace(model.filter, gate_probability=1.0 - 1e-13))  # gate open
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.05, 0.15, size=N))
    acceleration = 1e-3 * rng.normal(size=(N, 3))
    start = np.concatenate([model.dcm_dock_from_lvlh.T @ [6.5, 0.05, -0.1], [0.0, 0.001, 0.0]])
    truth = drift(model, t, start, acceleration)
    spots = look(model, truth, seed=4)
    spots[rng.uniform(size=(N, 3, 2)) < 0.05] = np.nan
    spots[:5] = look(model, truth[:5], seed=4)
    solution = relnav.filter_epochs(model, t, spots, acceleration_m_s2=acceleration, method="spots")
    first = int(np.flatnonzero(solution.status == STARTED)[0])
    textbook = Textbook(model, solution.state[first].copy(), solution.covariance[first].copy())
    for k in range(first + 1, N):
        textbook.predict(t[k] - t[k - 1], acceleration[k])
        nis = textbook.update(spots[k])
        sigma = np.sqrt(np.diag(textbook.p))
        assert np.max(np.abs(textbook.x - solution.state[k]) / sigma) < 1e-6, k
        scaled = (textbook.p - solution.covariance[k]) / np.outer(sigma, sigma)
        assert np.max(np.abs(scaled)) < 1e-6, k
        if np.isfinite(nis):
            assert solution.nis[k] == pytest.approx(nis, rel=1e-6, abs=1e-6)
