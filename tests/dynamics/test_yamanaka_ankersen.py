"""Motion about an eccentric target against two integrated Kepler orbits, and its circular limit."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from relnav.dynamics import clohessy_wiltshire, yamanaka_ankersen
from relnav.dynamics.yamanaka_ankersen import mean_from_true_anomaly, transition, true_from_mean_anomaly

MU = 3.986004418e14
N = 1.1313666536110223e-3
ORBIT_UNITS = np.repeat([1.0, 1.0 / N], 3)


def lvlh_of(r: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (rows x, y, z) and angular velocity, from their definition: z nadir, y = -h, x completes."""
    h = np.cross(r, v)
    z, y = -r / np.linalg.norm(r), -h / np.linalg.norm(h)
    return np.array([np.cross(y, z), y, z]), h / (r @ r)


def gravity_gradient_motion(e: float, theta: float, dt: float) -> np.ndarray:
    """Phi by integrating the target's orbit and the linearised equation of the inertial difference, DOP853."""
    a = (MU / N**2) ** (1.0 / 3.0)
    p = a * (1.0 - e * e)
    radius = p / (1.0 + e * math.cos(theta))
    r = radius * np.array([math.cos(theta), math.sin(theta), 0.0])
    v = math.sqrt(MU / p) * np.array([-math.sin(theta), e + math.cos(theta), 0.0])

    def rate(_t: float, y: np.ndarray) -> np.ndarray:
        position, differences = y[:3], y[6:].reshape(6, 6)
        d = np.linalg.norm(position)
        gradient = MU / d**3 * (3.0 * np.outer(position, position) / d**2 - np.eye(3))
        out = np.concatenate([y[3:6], -MU / d**3 * position])
        return np.concatenate([out, np.vstack([differences[3:], gradient @ differences[:3]]).ravel()])

    def inertial_from_lvlh(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        axes, omega = lvlh_of(position, velocity)
        spin = np.array([[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]])
        return np.block([[axes.T, np.zeros((3, 3))], [spin @ axes.T, axes.T]])

    start = np.concatenate([r, v, inertial_from_lvlh(r, v).ravel()])
    scale = np.concatenate([np.full(3, a), np.full(3, a * N), np.repeat(np.repeat([1.0, N], 3), 6)])
    scale[6:] *= np.tile(np.repeat([1.0, 1.0 / N], 3), 6)
    end = solve_ivp(rate, (0.0, dt), start, method="DOP853", rtol=1e-12, atol=1e-13 * scale).y[:, -1]
    return np.linalg.solve(inertial_from_lvlh(end[:3], end[3:6]), end[6:].reshape(6, 6))


@pytest.mark.parametrize(
    ("e", "theta_deg", "dt"),
    [(0.0, 0.0, 900.0), (0.008, 40.0, 1200.0), (0.1, 200.0, 3000.0), (0.1, -30.0, -2000.0), (0.7, 15.0, 6500.0)],
)
def test_against_integration(e: float, theta_deg: float, dt: float) -> None:
    expected = gravity_gradient_motion(e, math.radians(theta_deg), dt) * ORBIT_UNITS[:, None] / ORBIT_UNITS
    got = transition(N, e, math.radians(theta_deg), dt) * ORBIT_UNITS[:, None] / ORBIT_UNITS
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("dt", [1e-3, 10.0, 1800.0, 12000.0, -500.0])
@pytest.mark.parametrize("theta", [0.0, 2.0, -3.0, 40.0])
def test_circular_limit_is_clohessy_wiltshire(theta: float, dt: float) -> None:
    got = transition(N, 0.0, theta, dt) * ORBIT_UNITS[:, None] / ORBIT_UNITS
    expected = clohessy_wiltshire.transition(N, dt) * ORBIT_UNITS[:, None] / ORBIT_UNITS
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=2e-13 * np.abs(expected).max())


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.floats(0.0, 0.8), st.floats(-math.pi, math.pi), st.floats(-6000.0, 6000.0), st.floats(-6000.0, 6000.0))
def test_two_steps_make_one(e: float, theta: float, s: float, t: float) -> None:
    middle = true_from_mean_anomaly(e, mean_from_true_anomaly(e, theta) + N * s)
    size = ORBIT_UNITS[:, None] / ORBIT_UNITS
    first, second = transition(N, e, theta, s) * size, transition(N, e, middle, t) * size
    whole = transition(N, e, theta, s + t) * size
    tolerance = 1e-11 / (1.0 - e) ** 4 * max(1.0, np.abs(first).max() * np.abs(second).max())
    np.testing.assert_allclose(second @ first, whole, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("e", [0.0, 1e-3, 0.3, 0.8, 0.97])
def test_keplers_equation(e: float) -> None:
    """M = E - e sin E with E by bisection; Newton must find the same on any revolution."""
    for mean in np.linspace(-20.0, 20.0, 81):
        low, high = mean - 1.0, mean + 1.0
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if middle - e * math.sin(middle) < mean else (low, middle)
        theta = true_from_mean_anomaly(e, float(mean))
        assert math.cos(theta) == pytest.approx((math.cos(low) - e) / (1.0 - e * math.cos(low)), abs=1e-11)
        assert abs(theta - low) < 0.5 * math.pi + 0.6  # the same revolution
        assert mean_from_true_anomaly(e, theta) == pytest.approx(mean, abs=1e-11)


@pytest.mark.parametrize(("n", "e"), [(0.0, 0.1), (-1e-3, 0.1), (N, 1.0), (N, -0.1), (N, math.nan)])
def test_wrong_use(n: float, e: float) -> None:
    with pytest.raises(ValueError, match="mean_motion_rad_s > 0 and 0 <= eccentricity < 1"):
        yamanaka_ankersen.transition(n, e, 0.0, 1.0)
