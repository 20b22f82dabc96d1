"""The relative motion's process model: circular to the bit, eccentric against the equations of motion, integrated."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from relnav.dynamics.clohessy_wiltshire import acceleration_effect_into
from relnav.dynamics.clohessy_wiltshire import transition_into as circular
from relnav.dynamics.process_noise import acceleration_noise_into
from relnav.dynamics.relative_motion import (
    PHI_PATTERN,
    WORK_ROWS,
    depends_on_dt_alone,
    propagate_into,
    transition_into,
    turn_rate,
)

N = 1.1313666536110223e-3
UNITS = np.repeat([1.0, N], 3)
PUSH = np.array([3e-4, -2e-4, 1e-4])
DENSITY = np.array([[2e-8, 1e-9, 0.0], [1e-9, 1e-8, -2e-9], [0.0, -2e-9, 3e-8]])


def propagated(e, mean, t, dt):
    phi, q, effect = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    assert propagate_into(np.array([N, e, mean]), t, dt, PUSH, DENSITY, phi, q, effect, np.zeros((WORK_ROWS, 6)))
    return phi, q, effect


def true_anomaly(e, mean):
    low, high = mean - 1.1, mean + 1.1
    for _ in range(90):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle - e * math.sin(middle) < mean else (low, middle)
    return 2.0 * math.atan(math.sqrt((1.0 + e) / (1.0 - e)) * math.tan(0.5 * low))


def equations(e, mean, t):
    """System matrix in lvlh_ccsds about an eccentric target, g = mu / r^3.

    x'' = 2 w z' + w' z + (w^2 - g) x, y'' = -g y, z'' = -2 w x' - w' x + (w^2 + 2 g) z.
    """
    theta = true_anomaly(e, mean + N * t)
    rho = 1.0 + e * math.cos(theta)
    g, w = N**2 * (rho / (1.0 - e * e)) ** 3, N * rho**2 / (1.0 - e * e) ** 1.5
    slower = -2.0 * e * math.sin(theta) * w * w / rho
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 2], a[3, 5] = w * w - g, slower, 2.0 * w
    a[4, 1] = -g
    a[5, 0], a[5, 2], a[5, 3] = -slower, w * w + 2.0 * g, -2.0 * w
    return a


def integrated(e, mean, t, dt):
    def rate(s, y):
        a = equations(e, mean, t + s)
        phi, q, effect = y[:36].reshape(6, 6), y[36:72].reshape(6, 6), y[72:]
        push, noise = np.concatenate([np.zeros(3), PUSH]), np.zeros((6, 6))
        noise[3:, 3:] = DENSITY
        return np.concatenate([(a @ phi).ravel(), (a @ q + q @ a.T + noise).ravel(), a @ effect + push])

    start = np.concatenate([np.eye(6).ravel(), np.zeros(42)])
    scale = np.concatenate([np.outer(1.0 / UNITS, UNITS).ravel() * 1e-3, np.full(36, 1e-12), np.full(6, 1e-6)])
    end = solve_ivp(rate, (0.0, dt), start, method="DOP853", rtol=1e-12, atol=1e-12 * scale).y[:, -1]
    return end[:36].reshape(6, 6), end[36:72].reshape(6, 6), end[72:]


@pytest.mark.parametrize("dt", [1e-3, 0.1, 30.0, 900.0, 9000.0])
def test_circular_it_is_clohessy_wiltshire_bit_for_bit(dt):
    phi, q, effect = propagated(0.0, 1.0, 77.0, dt)
    expected, noise, added = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    acceleration_noise_into(N, dt, DENSITY, noise, expected, np.empty((6, 6)))
    circular(N, dt, expected)
    acceleration_effect_into(N, dt, PUSH, added)
    for one, other in ((phi, expected), (q, noise), (effect, added)):
        np.testing.assert_array_equal(one, other)
    assert depends_on_dt_alone(np.array([N, 0.0, 1.0]))
    assert not depends_on_dt_alone(np.array([N, 1e-4, 1.0]))


@pytest.mark.parametrize(
    ("e", "mean", "t", "dt"),
    [(0.02, 0.3, 100.0, 0.5), (0.1, -2.0, 0.0, 60.0), (0.1, 1.0, 5000.0, 1500.0), (0.7, -0.2, 0.0, 800.0)],
)
def test_eccentric_against_integration(e, mean, t, dt):
    (phi, q, effect), (phi_true, q_true, effect_true) = propagated(e, mean, t, dt), integrated(e, mean, t, dt)
    size = np.outer(1.0 / UNITS, UNITS)
    np.testing.assert_allclose(phi * size, phi_true * size, rtol=0.0, atol=2e-9 * np.abs(phi_true * size).max())
    sigma = np.sqrt(np.diag(q_true))
    np.testing.assert_allclose(q / np.outer(sigma, sigma), q_true / np.outer(sigma, sigma), rtol=0.0, atol=2e-9)
    for part in (slice(0, 3), slice(3, 6)):
        most = np.abs(effect_true[part]).max()
        np.testing.assert_allclose(effect[part], effect_true[part], rtol=0.0, atol=2e-9 * most)


def test_there_and_back_and_where_phi_is_zero():
    orbit, work = np.array([N, 0.2, 0.5]), np.zeros((WORK_ROWS, 6))
    there, back = np.empty((6, 6)), np.empty((6, 6))
    transition_into(orbit, 40.0, 300.0, there, work)
    transition_into(orbit, 340.0, -300.0, back, work)
    np.testing.assert_allclose(back @ there * np.outer(1.0 / UNITS, UNITS), np.eye(6), atol=1e-11)
    zero = np.array([list(row) for row in PHI_PATTERN]) == "0"
    assert (there[zero] == 0.0).all()
    assert (there[~zero] != 0.0).all()


def test_short_steps_keep_their_digits():
    """At a millisecond Phi is exp(dt A) of the middle: the closed form subtracts numbers of the size of 1."""
    phi, _, _ = propagated(0.1, 0.4, 10.0, 1e-3)
    expected = expm(1e-3 * equations(0.1, 0.4, 10.0005))
    np.testing.assert_allclose(phi[:3, 3:], expected[:3, 3:], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(phi[3:, 3:], expected[3:, 3:], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(phi[3:, :3], expected[3:, :3], rtol=0.0, atol=1e-14)


def test_a_drift_of_hundred_metres():
    """1000 s at e = 0.1 on two Kepler orbits: right to first order, where the circular model is metres off."""
    mu, e = 3.986004418e14, 0.1
    a = (mu / N**2) ** (1.0 / 3.0)

    def place(theta):
        p = a * (1.0 - e * e)
        r = p / (1.0 + e * math.cos(theta)) * np.array([math.cos(theta), math.sin(theta), 0.0])
        return r, math.sqrt(mu / p) * np.array([-math.sin(theta), e + math.cos(theta), 0.0])

    def axes_of(r, v):
        h = np.cross(r, v)
        z, y = -r / np.linalg.norm(r), -h / np.linalg.norm(h)
        return np.array([np.cross(y, z), y, z]), h / (r @ r)

    def fall(y):
        return np.concatenate([y[3:6], -mu / np.linalg.norm(y[:3]) ** 3 * y[:3]])

    r, v = place(true_anomaly(e, 0.6))
    axes, w = axes_of(r, v)
    state = np.array([100.0, 20.0, -30.0, 0.01, -0.02, 0.03])
    chaser = np.concatenate([r + axes.T @ state[:3], v + axes.T @ state[3:] + np.cross(w, axes.T @ state[:3])])
    end = [
        solve_ivp(lambda _, y: fall(y), (0.0, 1000.0), start, method="DOP853", rtol=1e-13, atol=1e-7).y[:, -1]
        for start in (np.concatenate([r, v]), chaser)
    ]
    axes, w = axes_of(end[0][:3], end[0][3:])
    truth = axes @ (end[1][:3] - end[0][:3])
    phi, _, _ = propagated(e, 0.6, 0.0, 1000.0)
    still = np.empty((6, 6))
    circular(N, 1000.0, still)
    assert np.linalg.norm((phi @ state)[:3] - truth) < 0.02  # of second order: 200 m^2 over an orbit's radius
    assert np.linalg.norm((still @ state)[:3] - truth) > 2.0


def test_the_frames_turn_rate():
    orbit = np.array([N, 0.3, 0.2])
    angle = [true_anomaly(0.3, 0.2 + N * t) for t in (499.5, 500.5)]
    assert turn_rate(orbit, 500.0) == pytest.approx(angle[1] - angle[0], rel=1e-6)
    assert turn_rate(np.array([N, 0.0, 0.2]), 500.0) == N


def test_a_step_beyond_all_bounds_is_refused():
    phi, q, effect, work = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.zeros((WORK_ROWS, 6))
    assert not propagate_into(np.array([N, 0.1, 0.0]), 0.0, 1e12, PUSH, DENSITY, phi, q, effect, work)
    assert not propagate_into(np.array([N, 0.0, 0.0]), 0.0, 1e300, PUSH, DENSITY, phi, q, effect, work)
