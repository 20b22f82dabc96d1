"""Q(dt) of white acceleration against Van Loan's method, quadrature, and a random walk that can be summed by hand."""

import math

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.process_noise import acceleration_noise, add_execution_error

N = 1.1313666536110223e-3
STEPS = [1e-3, 0.02, 0.1, 1.0, 30.0, 220.9, 221.1, 442.0, 900.0, 2700.0, 6000.0]  # n h = 0.25 at 220.97 s
FULL = np.array([[4.0, 1.0, -0.5], [1.0, 2.0, 0.3], [-0.5, 0.3, 1.0]]) * 1e-9


def assert_covariance(got: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Difference in units of the sigmas: 1e-12 here means 1e-12 of every element's natural size."""
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(got / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=tolerance)


@pytest.mark.parametrize("dt", STEPS)
@pytest.mark.parametrize("density", [np.eye(3) * 1e-10, FULL], ids=["white", "correlated"])
def test_against_van_loan(dt: float, density: np.ndarray, truth, outside) -> None:
    from filterpy.common import van_loan_discretization

    # In time units of dt (velocity times dt), or the exponential of the 12 x 12 matrix is badly scaled.
    unit = np.diag(np.repeat([1.0, dt], 3))
    system = unit @ truth.hill_matrix(N) @ np.linalg.inv(unit) * dt
    push = np.vstack([np.zeros((3, 3)), np.linalg.cholesky(density) * dt**1.5])
    _, scaled = van_loan_discretization(system, push, 1.0)
    back = np.linalg.inv(unit)
    expected = back @ scaled @ back
    sigma = np.sqrt(np.diag(expected))
    off = np.abs((acceleration_noise(N, dt, density) - expected) / np.outer(sigma, sigma)).max()
    step = "to 900 s" if dt < 1000.0 else "beyond"
    outside(
        "filterpy van_loan_discretization",
        f"process noise of a step, {step}, relative",
        off,
        3e-13 if dt < 1000.0 else 1e-10,
    )


@pytest.mark.parametrize("dt", STEPS)
def test_against_quadrature(dt: float, truth) -> None:
    system = truth.hill_matrix(N)
    unit = np.repeat([dt, 1.0], 3) * math.sqrt(dt)

    def integrand(s: float) -> np.ndarray:
        b = expm(system * (dt * s))[:, 3:]
        return b @ FULL @ b.T * dt / np.outer(unit, unit) / 1e-9

    expected, _ = quad_vec(integrand, 0.0, 1.0, epsabs=1e-11, epsrel=1e-12)
    assert_covariance(acceleration_noise(N, dt, FULL), expected * np.outer(unit, unit) * 1e-9, 1e-11)


@pytest.mark.parametrize("dt", STEPS)
def test_symmetric_and_positive_definite(dt: float) -> None:
    q = acceleration_noise(N, dt, 1e-10)
    np.testing.assert_array_equal(q, q.T)
    sigma = np.sqrt(np.diag(q))
    assert np.linalg.eigvalsh(q / np.outer(sigma, sigma)).min() > 1e-3


@pytest.mark.parametrize(("s", "t"), [(0.1, 0.3), (100.0, 150.0), (700.0, 1900.0)])
def test_two_steps_make_one(s: float, t: float) -> None:
    phi = transition(N, t)
    joined = phi @ acceleration_noise(N, s, FULL) @ phi.T + acceleration_noise(N, t, FULL)
    assert_covariance(acceleration_noise(N, s + t, FULL), joined, 1e-12)


def test_short_step_is_the_double_integrator() -> None:
    """Bar-Shalom, Li, Kirubarajan (2001), eq. (6.2.2-12): q [[t^3/3, t^2/2], [t^2/2, t]]."""
    t = 1e-2
    expected = np.kron([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]], np.eye(3)) * 1e-10
    assert_covariance(acceleration_noise(N, t, 1e-10), expected, 3e-5)


def test_a_number_is_that_number_in_each_axis() -> None:
    np.testing.assert_array_equal(acceleration_noise(N, 3.0, 2e-9), acceleration_noise(N, 3.0, 2e-9 * np.eye(3)))


def test_one_noisy_axis_leaves_the_other_plane_at_rest() -> None:
    q = acceleration_noise(N, 100.0, np.diag([0.0, 1e-10, 0.0]))
    assert np.count_nonzero(q) == 4
    assert (q[np.ix_([1, 4], [1, 4])] != 0.0).all()


def test_nothing_happens_in_no_time_and_without_noise() -> None:
    np.testing.assert_array_equal(acceleration_noise(N, 0.0, 1e-10), np.zeros((6, 6)))
    np.testing.assert_array_equal(acceleration_noise(N, 50.0, 0.0), np.zeros((6, 6)))


def test_against_a_random_walk() -> None:
    """White acceleration as many small kicks, 4000 flights of 400 s: 4 sigma of a sample covariance is 9 %."""
    rng = np.random.default_rng(3)
    steps, h, density = 200, 2.0, 1e-8
    phi = transition(N, h)
    x = np.zeros((4000, 6))
    for _ in range(steps):
        x[:, 3:] += rng.normal(size=(4000, 3)) * math.sqrt(density * h)
        x = x @ phi.T
    # Kicks at the start of each step instead of spread over it: 2 s of 400.
    assert_covariance(x.T @ x / 4000, acceleration_noise(N, steps * h, density), 0.1)


@pytest.mark.parametrize(
    ("n", "dt", "words"),
    [
        (0.0, 1.0, "mean_motion_rad_s"),
        (math.nan, 1.0, "mean_motion_rad_s"),
        (N, -1e-9, "dt_s must be >= 0"),
        (N, math.nan, "dt_s must be >= 0 and finite"),
        (N, math.inf, "dt_s must be >= 0 and finite"),
    ],
)
def test_wrong_use(n: float, dt: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        acceleration_noise(n, dt, 1e-10)


def test_execution_error_is_that_of_size_and_direction():
    """By hand along an axis: 10 % of 2 along it, 0.02 rad of 2 across."""
    spread = np.zeros((3, 3))
    add_execution_error(np.array([0.0, 2.0, 0.0]), 0.1, 0.02, spread)
    np.testing.assert_allclose(spread, np.diag([0.04**2, 0.2**2, 0.04**2]), atol=1e-15)


def test_execution_error_is_the_covariance_of_what_is_executed():
    """Against draws: the size 10 % wrong, then turned by a small rotation vector; it is added to what is there."""
    rng, u, runs = np.random.default_rng(8), np.array([0.3, -0.5, 0.7]), 200_000
    executed = (1.0 + 0.1 * rng.normal(size=(runs, 1))) * u + np.cross(0.02 * rng.normal(size=(runs, 3)), u)
    whole = np.ones((6, 6))
    add_execution_error(u, 0.1, 0.02, whole[3:6, 3:6])
    np.testing.assert_allclose(whole[3:6, 3:6] - 1.0, np.cov(executed.T), rtol=0.0, atol=5e-3 * 0.1**2)
    assert (whole[:3] == 1.0).all()
    assert (whole[3:, :3] == 1.0).all()


def test_no_control_adds_nothing():
    spread = np.eye(3)
    add_execution_error(np.zeros(3), 0.1, 0.02, spread)
    assert (spread == np.eye(3)).all()
