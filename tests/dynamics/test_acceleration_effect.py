"""What a constant acceleration adds, against scipy's quadrature of the matrix exponential and against an integrator."""

import numpy as np
import pytest
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm

from relnav.dynamics.clohessy_wiltshire import acceleration_effect_into, propagate

N = 1.1313666536110223e-3
ACCELERATION = np.array([1e-3, -2e-3, 5e-4])


def effect(dt: float, acceleration: np.ndarray = ACCELERATION) -> np.ndarray:
    out = np.empty(6)
    acceleration_effect_into(N, dt, acceleration, out)
    return out


@pytest.mark.parametrize("dt", [1e-3, 0.1, 10.0, 600.0, 6000.0, -30.0])
def test_integral_of_phi(dt: float, truth) -> None:
    system = truth.hill_matrix(N)
    push = np.concatenate([np.zeros(3), ACCELERATION])
    # Over the unit interval, scaled by dt in position and velocity alike, so that quad_vec's error is relative.
    scale = np.repeat([dt * dt, dt], 3) * np.linalg.norm(ACCELERATION)
    integral, _ = quad_vec(lambda s: expm(system * (dt * s)) @ push * dt / scale, 0.0, 1.0, epsabs=1e-13, epsrel=1e-13)
    np.testing.assert_allclose(effect(dt) / scale, integral, rtol=0.0, atol=1e-12 * max(1.0, np.abs(integral).max()))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_thrust_against_an_integrator(axis: int, truth) -> None:
    """One axis at a time, so that a coupling with a wrong sign cannot hide."""
    push = np.zeros(6)
    push[3 + axis] = 1e-3
    start = np.array([10.0, -3.0, 2.0, 0.01, 0.02, -0.03])
    system = truth.hill_matrix(N)
    solution = solve_ivp(lambda _t, x: system @ x + push, (0.0, 900.0), start, method="DOP853", rtol=1e-12, atol=1e-12)
    end = propagate(start, N, 900.0, acceleration_m_s2=push[3:])
    np.testing.assert_allclose(end, solution.y[:, -1], rtol=0.0, atol=1e-7)


def test_held_thrust_in_two_halves() -> None:
    start = np.array([10.0, -3.0, 2.0, 0.01, 0.02, -0.03])
    whole = propagate(start, N, 250.0, acceleration_m_s2=ACCELERATION)
    half = propagate(start, N, 100.0, acceleration_m_s2=ACCELERATION)
    np.testing.assert_allclose(propagate(half, N, 150.0, acceleration_m_s2=ACCELERATION), whole, rtol=1e-12)


def test_free_fall_at_a_millisecond() -> None:
    """At this step the orbit is out of sight: a t^2 / 2 and a t, to n t."""
    np.testing.assert_allclose(effect(1e-3)[:3], 0.5 * ACCELERATION * 1e-6, rtol=1e-5)
    np.testing.assert_allclose(effect(1e-3)[3:], ACCELERATION * 1e-3, rtol=1e-5)
