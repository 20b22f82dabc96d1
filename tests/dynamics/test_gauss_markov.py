"""States that are remembered for a while, against Van Loan's method, 50 digits and the settled state."""

import math

import mpmath
import numpy as np
import pytest

from relnav.dynamics.gauss_markov import propagate

SIGMA = np.array([3.0, 0.2, 1e-4])
TIME = np.array([100.0, 5.0, 2000.0])


@pytest.mark.parametrize("dt", [1e-3, 0.1, 4.0, 90.0])
def test_against_van_loan(dt: float) -> None:
    from filterpy.common import van_loan_discretization

    phi, q = propagate(SIGMA, TIME, dt)
    expected_phi, expected_q = van_loan_discretization(np.diag(-1.0 / TIME), np.diag(SIGMA * np.sqrt(2.0 / TIME)), dt)
    np.testing.assert_allclose(phi, expected_phi, rtol=1e-12)
    np.testing.assert_allclose(q, expected_q, rtol=1e-11)


def test_a_random_walk_is_its_limit() -> None:
    """A growth of s per root second: as a state of time tau that settles at s sqrt(tau / 2)."""
    phi, q = propagate(np.array([0.3, 0.0]), np.array([math.inf, math.inf]), 7.0)
    np.testing.assert_array_equal(phi, np.eye(2))
    np.testing.assert_allclose(q, np.diag([0.3**2 * 7.0, 0.0]), rtol=1e-15)
    tau = 1e12
    slow_phi, slow_q = propagate(np.array([0.3 * math.sqrt(tau / 2.0)]), np.array([tau]), 7.0)
    np.testing.assert_allclose(slow_q[0, 0], q[0, 0], rtol=1e-11)
    np.testing.assert_allclose(slow_phi[0, 0], 1.0, rtol=1e-11)


@pytest.mark.parametrize("dt", [1e-9, 1e-3, 10.0])
def test_no_digit_is_lost_far_below_the_correlation_time(dt: float) -> None:
    _, q = propagate(np.array([2.0]), np.array([1e6]), dt)
    with mpmath.workdps(50):
        expected = float(4 * (1 - mpmath.exp(-2 * mpmath.mpf(dt) / mpmath.mpf(10) ** 6)))
    assert q[0, 0] == pytest.approx(expected, rel=1e-15)


def test_what_is_settled_stays_so() -> None:
    phi, q = propagate(SIGMA, TIME, 37.0)
    settled = np.diag(SIGMA**2)
    np.testing.assert_allclose(phi @ settled @ phi.T + q, settled, rtol=1e-14)


def test_no_time_and_all_time() -> None:
    phi, q = propagate(SIGMA, TIME, 0.0)
    np.testing.assert_array_equal(phi, np.eye(3))
    np.testing.assert_array_equal(q, np.zeros((3, 3)))
    phi, q = propagate(SIGMA, TIME, 1e9)
    np.testing.assert_array_equal(phi, np.zeros((3, 3)))
    np.testing.assert_allclose(q, np.diag(SIGMA**2), rtol=1e-15)


@pytest.mark.parametrize(
    ("sigma", "time", "dt", "words"),
    [
        ([1.0, 2.0], [1.0], 1.0, "one value a state"),
        ([-1.0], [1.0], 1.0, "sigma must be >= 0"),
        ([1.0], [0.0], 1.0, "correlation_time_s must be positive"),
        ([1.0], [math.nan], 1.0, "correlation_time_s must be positive"),
        ([1.0], [1.0], -1.0, "dt_s must be >= 0"),
    ],
)
def test_wrong_use(sigma: list, time: list, dt: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        propagate(np.array(sigma), np.array(time), dt)
