"""Motion about an eccentric target: the paper's matrices in 50 digits, integrated Kepler orbits, the circular limit."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from relnav.dynamics import clohessy_wiltshire
from relnav.dynamics.yamanaka_ankersen import (
    PHI_PATTERN,
    mean_from_true_anomaly,
    transition,
    true_from_mean_anomaly,
)

MU = 3.986004418e14
N = 1.1313666536110223e-3
ORBIT_UNITS = np.repeat([1.0, 1.0 / N], 3)


def printed_matrix(e, theta, integral):
    """M of the paper, rows and columns (x~, z~, x~', z~')."""
    rho = 1 + e * mpmath.cos(theta)
    s, c = rho * mpmath.sin(theta), rho * mpmath.cos(theta)
    ds, dc = mpmath.cos(theta) + e * mpmath.cos(2 * theta), -(mpmath.sin(theta) + e * mpmath.sin(2 * theta))
    return mpmath.matrix(
        [
            [1, -c * (1 + 1 / rho), s * (1 + 1 / rho), 3 * rho**2 * integral],
            [0, s, c, 2 - 3 * e * s * integral],
            [0, 2 * s, 2 * c - e, 3 * (1 - 2 * e * s * integral)],
            [0, ds, dc, -3 * e * (ds * integral + s / rho**2)],
        ]
    )


def as_printed(e: float, theta: float, dt: float) -> np.ndarray:
    """Phi by the paper: its transformation, M(theta1) times the inverse of M(theta0), and back; Kepler by bisection."""
    n, e, theta0, t = (mpmath.mpf(value) for value in (N, e, theta, dt))
    q = 1 - e * e
    k2 = n / q ** mpmath.mpf(1.5)
    start = 2 * mpmath.atan(mpmath.tan(theta0 / 2) * mpmath.sqrt((1 - e) / (1 + e)))
    mean = start - e * mpmath.sin(start) + n * t
    low, high = mean - e, mean + e
    for _ in range(mpmath.mp.prec):
        middle = (low + high) / 2
        low, high = (middle, high) if middle - e * mpmath.sin(middle) < mean else (low, middle)
    theta1 = mpmath.atan2(mpmath.sqrt(q) * mpmath.sin(low), mpmath.cos(low) - e)
    plane = printed_matrix(e, theta1, k2 * t) * printed_matrix(e, theta0, 0) ** -1
    turn, d = mpmath.zeros(6), theta1 - theta0
    for i, row in enumerate((0, 2, 3, 5)):
        for j, column in enumerate((0, 2, 3, 5)):
            turn[row, column] = plane[i, j]
    turn[1, 1], turn[1, 4], turn[4, 1], turn[4, 4] = mpmath.cos(d), mpmath.sin(d), -mpmath.sin(d), mpmath.cos(d)
    transforms = []
    for at in (theta0, theta1):
        rho, transform = 1 + e * mpmath.cos(at), mpmath.zeros(6)
        for i in range(3):
            transform[i, i], transform[3 + i, i], transform[3 + i, 3 + i] = rho, -e * mpmath.sin(at), 1 / (k2 * rho)
        transforms.append(transform)
    phi = transforms[1] ** -1 * turn * transforms[0]
    return np.array([[float(phi[i, j]) for j in range(6)] for i in range(6)])


# What is zero is so to some 1e-50 in the truth too: the columns' zeros are those of PHI_PATTERN.
ZERO = np.array([[mark == "0" for mark in row] for row in PHI_PATTERN])


@pytest.mark.parametrize("e", [0.0, 1e-9, 0.001, 0.02, 0.1, 0.4, 0.7])
@pytest.mark.parametrize("theta", [0.0, 0.7, 2.0, 3.1, -1.2])
def test_every_element_of_phi_in_50_digits(e: float, theta: float) -> None:
    """Short steps relative to each element, as for Clohessy-Wiltshire."""
    for dt in (1e-3, 0.1, 10.0, -10.0):
        with mpmath.workdps(50):
            expected = as_printed(e, theta, dt)
        got = transition(N, e, theta, dt)
        np.testing.assert_array_equal(got[ZERO], 0.0)
        np.testing.assert_allclose(got, expected, rtol=1e-14, atol=1e-40)
    for dt in (-300.0, 1800.0, 6000.0, -20000.0):
        with mpmath.workdps(50):
            expected = as_printed(e, theta, dt) * ORBIT_UNITS[:, None] / ORBIT_UNITS
        got = transition(N, e, theta, dt) * ORBIT_UNITS[:, None] / ORBIT_UNITS
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=4e-15 * (1.0 + abs(N * dt)) * np.abs(expected).max())


def test_the_printed_form_would_fail_at_a_millisecond() -> None:
    """In double: the drift along x from a height is lost, and what white noise does is known to 9 digits."""
    with mpmath.workdps(50):
        expected = as_printed(0.1, 0.7, 1e-3)
    with mpmath.workprec(53):
        printed = as_printed(0.1, 0.7, 1e-3)
    error = np.abs(printed - expected)
    assert error[0, 5] / abs(expected[0, 5]) > 1e-6
    assert error[0, 3] / abs(expected[0, 3]) > 1e-11


def test_the_pattern_of_zeros() -> None:
    phi = transition(N, 0.1, 0.7, 500.0)
    assert ["".join("0" if value == 0.0 else "*" for value in row) for row in phi] == list(PHI_PATTERN)


@pytest.mark.parametrize("e", [0.0, 0.3, 0.7])
def test_zero_step_is_the_identity(e: float) -> None:
    np.testing.assert_array_equal(transition(N, e, 1.3, 0.0), np.eye(6))


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
        transition(n, e, 0.0, 1.0)


@pytest.mark.parametrize(("theta", "dt"), [(math.nan, 1.0), (0.0, math.inf)])
def test_times_and_places_are_finite(theta: float, dt: float) -> None:
    with pytest.raises(ValueError, match="must be finite"):
        transition(N, 0.1, theta, dt)


@pytest.mark.parametrize("e", [0.1, 0.7, 0.97])
def test_keplers_equation_of_a_step_from_anywhere(e):
    """Where Newton's method leaves its bounds the middle is taken, and it ends."""
    from relnav.dynamics.yamanaka_ankersen import eccentric_anomaly_step

    rng = np.random.default_rng(0)
    for e0, dm in rng.uniform(-np.pi, np.pi, (3000, 2)).tolist():
        x = eccentric_anomaly_step(e, math.sin(e0), math.cos(e0), dm)
        assert abs((e0 + x - e * math.sin(e0 + x)) - (e0 - e * math.sin(e0)) - dm) < 1e-12
