"""Phi(dt) of Clohessy-Wiltshire against the matrix exponential, 50-digit arithmetic and what it must conserve."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from relnav.dynamics.clohessy_wiltshire import propagate, theta_minus_sin, transition

N = 1.1313666536110223e-3
STEPS = [1e-3, 0.02, 0.1, 1.0, 10.0, 300.0, 1800.0, 5553.6, 20000.0, -0.1, -700.0]
PER_ORBIT = np.diag([1.0, 1.0, 1.0, 1.0 / N, 1.0 / N, 1.0 / N])  # velocities in units of n times a metre


def in_orbit_units(phi: np.ndarray) -> np.ndarray:
    return PER_ORBIT @ phi @ np.linalg.inv(PER_ORBIT)


def textbook(n: float, dt: float) -> np.ndarray:
    """Fehse (2003), eq. (3.24), as printed, in 50 digits; axes lvlh_ccsds."""
    with mpmath.workdps(50):
        n, t = mpmath.mpf(n), mpmath.mpf(dt)
        s, c = mpmath.sin(n * t), mpmath.cos(n * t)
        rows = [
            [1, 0, 6 * (n * t - s), (4 * s - 3 * n * t) / n, 0, 2 * (1 - c) / n],
            [0, c, 0, 0, s / n, 0],
            [0, 0, 4 - 3 * c, -2 * (1 - c) / n, 0, s / n],
            [0, 0, 6 * n * (1 - c), 4 * c - 3, 0, 2 * s],
            [0, -n * s, 0, 0, c, 0],
            [0, 0, 3 * n * s, -2 * s, 0, c],
        ]
        return np.array([[float(x) for x in row] for row in rows])


@pytest.mark.parametrize("dt", STEPS)
def test_every_element_of_phi_in_50_digits(dt: float) -> None:
    """Short steps relative to each element: the textbook's own form, in double, loses 6e-5 at a millisecond."""
    expected, got = textbook(N, dt), transition(N, dt)
    np.testing.assert_array_equal(got == 0.0, expected == 0.0)
    if abs(N * dt) < 0.4:
        np.testing.assert_allclose(got, expected, rtol=1e-15)
    # Past a fraction of an orbit elements pass through zero, and the rounding of n dt (2^-53 of it) shows there.
    tolerance = 4e-15 * (1.0 + abs(N * dt))
    np.testing.assert_allclose(in_orbit_units(got), in_orbit_units(expected), rtol=1e-15, atol=tolerance)


def test_the_textbook_form_would_fail_at_a_millisecond() -> None:
    theta = N * 1e-3
    assert abs(6.0 * (theta - math.sin(theta)) / textbook(N, 1e-3)[0, 2] - 1.0) > 1e-6


@pytest.mark.parametrize("dt", STEPS)
def test_phi_is_the_exponential_of_the_equations_of_motion(dt: float, truth) -> None:
    expected = in_orbit_units(expm(truth.hill_matrix(N) * dt))
    got = in_orbit_units(transition(N, dt))
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=2e-13 * np.abs(expected).max())


@pytest.mark.parametrize("dt", STEPS)
def test_phi_in_rsw_is_the_exponential_of_the_hill_equations(dt: float) -> None:
    """As textbooks print them: x'' = 3 n^2 x + 2 n y', y'' = -2 n x', z'' = -n^2 z."""
    system = np.zeros((6, 6))
    system[:3, 3:] = np.eye(3)
    system[3, 0], system[3, 4], system[4, 3], system[5, 2] = 3.0 * N * N, 2.0 * N, -2.0 * N, -N * N
    expected = in_orbit_units(expm(system * dt))
    got = in_orbit_units(transition(N, dt, frame="rsw"))
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=2e-13 * np.abs(expected).max())


@settings(derandomize=True, max_examples=100, deadline=None)
@given(st.floats(-6000.0, 6000.0), st.floats(-6000.0, 6000.0))
def test_group_determinant_and_inverse(s: float, t: float) -> None:
    a, b, ab = (in_orbit_units(transition(N, dt)) for dt in (s, t, s + t))
    size = np.linalg.norm(a) * np.linalg.norm(b)
    np.testing.assert_allclose(a @ b, ab, rtol=0.0, atol=1e-15 * size + 1e-14)
    assert np.linalg.det(a) == pytest.approx(1.0, abs=1e-15 * np.linalg.norm(a) ** 2 + 1e-14)
    back = in_orbit_units(transition(N, -s))
    np.testing.assert_allclose(a @ back, np.eye(6), rtol=0.0, atol=1e-15 * np.linalg.norm(a) ** 2 + 1e-14)


@pytest.mark.parametrize("dt", STEPS)
def test_symplectic_in_inertial_velocity(dt: float) -> None:
    """With v + omega x r as momentum the motion is Hamiltonian: Psi^T J Psi = J. omega = -n y in lvlh_ccsds."""
    to_momentum = np.eye(6)
    to_momentum[3, 2], to_momentum[5, 0] = -1.0, 1.0  # (-y) x r = (-z, 0, x), in units of n
    psi = to_momentum @ in_orbit_units(transition(N, dt)) @ np.linalg.inv(to_momentum)
    j = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
    np.testing.assert_allclose(psi.T @ j @ psi, j, rtol=0.0, atol=3e-13)


@pytest.mark.parametrize("theta", [1e-9, 1e-4, 0.1, 0.3, 0.4999, 0.5, 0.5001, 1.0, 3.0, -0.2, -2.0])
def test_theta_minus_sin(theta: float) -> None:
    with mpmath.workdps(50):
        expected = float(mpmath.mpf(theta) - mpmath.sin(mpmath.mpf(theta)))
    assert theta_minus_sin(theta) == pytest.approx(expected, rel=4e-15)


def test_zero_step_is_the_identity() -> None:
    np.testing.assert_array_equal(transition(N, 0.0), np.eye(6))


@pytest.mark.parametrize(
    ("n", "dt", "frame", "words"),
    [
        (0.0, 1.0, "lvlh_ccsds", "mean_motion_rad_s must be positive"),
        (-1e-3, 1.0, "lvlh_ccsds", "mean_motion_rad_s must be positive"),
        (math.nan, 1.0, "lvlh_ccsds", "mean_motion_rad_s must be positive"),
        (math.inf, 1.0, "lvlh_ccsds", "mean_motion_rad_s must be positive"),
        (N, math.nan, "lvlh_ccsds", "dt_s must be finite"),
        (N, math.inf, "lvlh_ccsds", "dt_s must be finite"),
        (N, 1.0, "lvlh", 'frame must be "lvlh_ccsds" or "rsw"; got \'lvlh\''),
    ],
)
def test_wrong_use(n: float, dt: float, frame: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        transition(n, dt, frame=frame)
    if frame == "lvlh_ccsds":
        with pytest.raises(ValueError, match=words):
            propagate(np.zeros(6), n, dt)
