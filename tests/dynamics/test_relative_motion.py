"""One step of a filter's motion: against integrated equations of motion and covariance, and against flown orbits."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from relnav.dynamics import clohessy_wiltshire, process_noise
from relnav.dynamics.process_noise import NODES
from relnav.dynamics.relative_motion import (
    depends_on_dt_alone,
    frame_and_gradient,
    frame_rate,
    orbit_vector,
    propagate_into,
    transition_into,
    true_anomaly_at,
)
from relnav.simulation.orbits import place_chaser, relative_state, runge_kutta_step

MU = 3.986004418e14
N = 1.1313666536110223e-3
ACCELERATION = np.array([1e-3, -2e-3, 5e-4])
FULL = np.array([[4.0, 1.0, -0.5], [1.0, 2.0, 0.3], [-0.5, 0.3, 1.0]]) * 1e-9


def step(orbit, t, dt, acceleration=ACCELERATION, density=FULL):
    phi, q, effect = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    assert propagate_into(
        orbit, t, dt, acceleration, density, phi, q, effect, np.empty((NODES, 6, 6)), np.empty((6, 6))
    )
    return phi, q, effect


def phi_over(orbit, t, dt):
    phi = np.empty((6, 6))
    transition_into(orbit, t, dt, phi)
    return phi


def target(n, e, theta):
    """Distance, its rate and the momentum of the target at a true anomaly."""
    p = (MU / n**2) ** (1.0 / 3.0) * (1.0 - e * e)
    return p / (1.0 + e * math.cos(theta)), math.sqrt(MU / p) * e * math.sin(theta), math.sqrt(MU * p)


def equations(r, rdot, h):
    """System matrix (6, 6) in lvlh_ccsds, which turns at w = h / r^2 about -y, from Newton's laws in that frame."""
    w, wdot, g = h / r**2, -2.0 * h * rdot / r**3, MU / r**3
    system = np.zeros((6, 6))
    system[:3, 3:] = np.eye(3)
    system[3] = [w * w - g, 0.0, wdot, 0.0, 0.0, 2.0 * w]
    system[4, 1] = -g
    system[5] = [-wdot, 0.0, w * w + 2.0 * g, -2.0 * w, 0.0, 0.0]
    return system


def integrated(e, theta, dt):
    """(Phi, Q, effect) by DOP853: the target's distance and the three differential equations together.

    In units of dt: velocities times dt, so that short and long steps are integrated alike.
    """
    r, rdot, h = target(N, e, theta)
    unit = np.repeat([1.0, dt], 3)
    push, noise = np.zeros(6), np.zeros((6, 6))
    push[3:], noise[3:, 3:] = ACCELERATION / 1e-3, FULL / 1e-9

    def rate(_s, y):
        distance, climb = y[0] * r, y[1] * r / dt
        system = equations(distance, climb, h) * dt * unit[:, None] / unit
        phi, q, effect = y[2:38].reshape(6, 6), y[38:74].reshape(6, 6), y[74:]
        gravity = (h * h / distance**3 - MU / distance**2) * dt * dt / r
        grown = system @ q + q @ system.T + noise
        return np.concatenate([[y[1], gravity], (system @ phi).ravel(), grown.ravel(), system @ effect + push])

    start = np.concatenate([[1.0, rdot * dt / r], np.eye(6).ravel(), np.zeros(42)])
    y = solve_ivp(rate, (0.0, 1.0), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    phi = y[2:38].reshape(6, 6) / unit[:, None] * unit
    q = y[38:74].reshape(6, 6) * dt**3 * 1e-9 / np.outer(unit, unit)
    return phi, q, y[74:] * dt**2 * 1e-3 / unit


@pytest.mark.parametrize(("e", "theta"), [(0.001, 1.0), (0.02, -2.0), (0.1, 0.5), (0.4, 3.0), (0.7, -0.4)])
@pytest.mark.parametrize("dt", [1e-3, 0.1, 10.0, 200.0, 1000.0, 9000.0])
def test_against_the_integrated_equations(e: float, theta: float, dt: float) -> None:
    """The clock is not zero at the start of the step."""
    orbit = orbit_vector(N, e, theta)
    clock = 1234.5
    orbit[2] -= N * clock
    phi, q, effect = step(orbit, clock, dt)
    expected_phi, expected_q, expected_effect = integrated(e, theta, dt)
    unit = np.repeat([1.0, dt], 3)
    tolerance = 1e-12 if dt < 2000.0 else 1e-9  # of the integrator, over an orbit and a half
    ours, theirs = (matrix * unit[:, None] / unit for matrix in (phi, expected_phi))
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=tolerance * np.abs(theirs).max())
    sigma = np.sqrt(np.diag(expected_q))
    pair = np.outer(sigma, sigma)
    np.testing.assert_allclose(q / pair, expected_q / pair, rtol=0.0, atol=tolerance)
    np.testing.assert_array_equal(q, q.T)
    scale = np.abs(expected_effect * unit).max() / unit
    np.testing.assert_allclose(effect / scale, expected_effect / scale, rtol=0.0, atol=tolerance)
    assert not depends_on_dt_alone(orbit)


@pytest.mark.parametrize("dt", [0.0, 1e-3, 0.1, 30.0, 300.0, 6000.0, 1e6])
def test_a_circular_orbit_is_clohessy_wiltshire_bit_for_bit(dt: float) -> None:
    orbit = orbit_vector(N, 0.0, 2.0)
    phi, q, effect = step(orbit, 77.0, dt)
    expected = np.empty(6)
    clohessy_wiltshire.acceleration_effect_into(N, dt, ACCELERATION, expected)
    np.testing.assert_array_equal(phi, clohessy_wiltshire.transition(N, dt))
    np.testing.assert_array_equal(q, process_noise.acceleration_noise(N, dt, FULL))
    np.testing.assert_array_equal(effect, expected)
    np.testing.assert_array_equal(phi_over(orbit, 3.0, -dt), clohessy_wiltshire.transition(N, -dt))
    assert depends_on_dt_alone(orbit)


@pytest.mark.parametrize("dt", [1e-3, 0.1, 30.0, 300.0, 6000.0])
def test_a_hardly_eccentric_orbit_is_nearly_that(dt: float) -> None:
    """The two ways join without a step: at e = 1e-12 they are 1e-12 apart, times what an orbit does to an error."""
    sizes = np.repeat([1.0, dt], 3)
    circular, other = step(orbit_vector(N), 0.0, dt), step(orbit_vector(N, 1e-12), 0.0, dt)
    ours, theirs = (result[0] * sizes[:, None] / sizes for result in (other, circular))
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=5e-11 * np.abs(theirs).max())
    pair = np.sqrt(np.outer(np.diag(circular[1]), np.diag(circular[1])))
    np.testing.assert_allclose(other[1] / pair, circular[1] / pair, rtol=0.0, atol=5e-11)
    size = np.abs(circular[2] * sizes).max()
    np.testing.assert_allclose(other[2] * sizes, circular[2] * sizes, rtol=0.0, atol=5e-11 * size)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.floats(0.001, 0.7), st.floats(-3e5, 3e5), st.floats(1e-3, 4000.0), st.floats(1e-3, 4000.0))
def test_two_steps_make_one_and_back(e: float, t: float, first: float, second: float) -> None:
    """On a clock far from zero, up to three days: the rounding of n t shows."""
    orbit = orbit_vector(N, e, 1.0)
    one, other, whole = step(orbit, t, first), step(orbit, t + first, second), step(orbit, t, first + second)
    unit = np.repeat([1.0, 1.0 / N], 3)
    size = unit[:, None] / unit
    large = max(1.0, np.abs(one[0] * size).max() * np.abs(other[0] * size).max())
    tolerance = 1e-11 / (1.0 - e) ** 3 * large
    np.testing.assert_allclose((other[0] @ one[0]) * size, whole[0] * size, rtol=0.0, atol=tolerance)
    q, sigma = other[0] @ one[1] @ other[0].T + other[1], np.sqrt(np.diag(whole[1]))
    np.testing.assert_allclose(q / np.outer(sigma, sigma), whole[1] / np.outer(sigma, sigma), rtol=0.0, atol=1e-9)
    back = phi_over(orbit, t + first, -first)
    np.testing.assert_allclose((back @ one[0]) * size, np.eye(6), rtol=0.0, atol=tolerance * large)


def flown(state, n, e, theta, duration):
    """Relative state after free flight in 1 s steps, from two integrated orbits."""
    r, rdot, h = target(n, e, theta)
    cos, sin = math.cos(theta), math.sin(theta)
    y = np.zeros((4, 3))
    y[0] = r * np.array([cos, 0.6 * sin, 0.8 * sin])
    y[1] = rdot / r * y[0] + h / r * np.array([-sin, 0.6 * cos, 0.8 * cos])
    place_chaser(y, state, np.empty((3, 3)))
    for _ in range(duration):
        runge_kutta_step(y, np.zeros(3), np.array([MU, 0.0, 0.0, 0.0, 0.0]), 1.0, np.empty((23, 3)))
    out = np.empty(6)
    relative_state(y, np.empty((3, 3)), out)
    return out


def test_a_free_drift_of_a_hundred_metres() -> None:
    """Phi leaves what is of second order in the separation (2 mm); Clohessy-Wiltshire is 30 m off."""
    e, theta = 0.1, 0.6
    unit, errors = np.array([0.8, -0.4, 0.45, 1e-4, 5e-5, -2e-4]), []
    for size in (100.0, 50.0):
        end = flown(size * unit, N, e, theta, 1000)
        errors.append(np.linalg.norm((phi_over(orbit_vector(N, e, theta), 0.0, 1000.0) @ (size * unit) - end)[:3]))
    assert errors[0] < 0.005
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)
    circular = clohessy_wiltshire.propagate(100.0 * unit, N, 1000.0) - flown(100.0 * unit, N, e, theta, 1000)
    assert np.linalg.norm(circular[:3]) > 20.0


@pytest.mark.parametrize(("e", "theta"), [(0.0, 0.3), (0.1, -2.0), (0.7, 0.5)])
@pytest.mark.parametrize("t", [-400.0, 0.0, 900.0, 20000.0])
def test_the_targets_place_and_the_turn_of_the_frame(e: float, theta: float, t: float) -> None:
    """Against the target's own integrated orbit; the clock of a log may be before zero."""
    r, rdot, h = target(N, e, theta)

    def rate(_s, y):
        d = y[0] * r
        return np.array([y[1], (h * h / d**3 - MU / d**2) * t * t / r, h / d**2 * t])

    start = np.array([1.0, rdot * t / r, theta])
    place = solve_ivp(rate, (0.0, 1.0), start, method="DOP853", rtol=1e-13, atol=1e-13).y[2, -1]
    orbit = orbit_vector(N, e, theta)
    np.testing.assert_allclose(true_anomaly_at(orbit, t), [math.sin(place), math.cos(place)], rtol=0.0, atol=1e-8)
    assert frame_rate(orbit, t) == pytest.approx(h / target(N, e, place)[0] ** 2, rel=1e-8)
    assert frame_and_gradient(orbit, t)[1] == pytest.approx(3.0 * MU / target(N, e, place)[0] ** 3, rel=1e-8)


@pytest.mark.parametrize("dt", [0.1, 2.0, 400.0, 3000.0])
def test_what_a_step_as_long_has_left_gives_the_same_bits(dt: float) -> None:
    """With three points, five, and doublings; another push and another density."""
    orbit, work = orbit_vector(N), np.empty((6, 6))
    phi, q, effect, nodes = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty((NODES, 6, 6))
    assert propagate_into(orbit, 0.0, dt, np.array([1.0, -2.0, 0.5]), np.eye(3), phi, q, effect, nodes, work)
    before = q.copy()
    assert propagate_into(orbit, 7.0, dt, ACCELERATION, FULL, phi, q, effect, nodes, work, True)
    for got, fresh in zip((phi, q, effect), step(orbit, 7.0, dt), strict=True):
        np.testing.assert_array_equal(got, fresh)
    assert not np.allclose(q, before)


@pytest.mark.parametrize(("e", "dt"), [(0.0, 1e16), (0.0, math.nan), (0.1, 1e8), (0.7, 1e6), (0.1, math.inf)])
def test_steps_beyond_all_knowledge(e: float, dt: float) -> None:
    rows, nodes = [np.empty((6, 6)) for _ in range(3)], np.empty((NODES, 6, 6))
    assert not propagate_into(
        orbit_vector(N, e), 0.0, dt, np.zeros(3), FULL, rows[0], rows[1], np.empty(6), nodes, rows[2]
    )


@pytest.mark.parametrize(("n", "e", "theta"), [(0.0, 0.1, 0.0), (N, 1.0, 0.0), (N, math.nan, 0.0), (N, 0.1, math.inf)])
def test_wrong_use(n: float, e: float, theta: float) -> None:
    with pytest.raises(ValueError, match=r"are expected; got|must be finite; got"):
        orbit_vector(n, e, theta)
