"""For small separations the integrated orbits move as Clohessy-Wiltshire and Yamanaka-Ankersen say."""

import math

import numpy as np
import pytest

from relnav.dynamics import clohessy_wiltshire, yamanaka_ankersen
from relnav.simulation.orbits import place_chaser, relative_state, runge_kutta_step

MU = 3.986004418e14


def flown(state: np.ndarray, n: float, e: float, theta: float, duration: int) -> np.ndarray:
    """Relative state after free flight in 1 s steps, from two integrated orbits."""
    p = (MU / n**2) ** (1.0 / 3.0) * (1.0 - e * e)
    cos, sin = math.cos(theta), math.sin(theta)
    y = np.zeros((4, 3))
    y[0] = p / (1.0 + e * cos) * np.array([cos, 0.6 * sin, 0.8 * sin])
    y[1] = math.sqrt(MU / p) * np.array([-sin, 0.6 * (e + cos), 0.8 * (e + cos)])
    place_chaser(y, state, np.empty((3, 3)))
    for _ in range(duration):
        runge_kutta_step(y, np.zeros(3), np.array([MU, 0.0, 0.0, 0.0, 0.0]), 1.0, np.empty((23, 3)))
    out = np.empty(6)
    relative_state(y, np.empty((3, 3)), out)
    return out


def test_the_difference_is_of_second_order_in_the_separation(truth) -> None:
    unit = np.array([1.0, -0.5, 0.7, 1e-3, 5e-4, -8e-4])
    phi = clohessy_wiltshire.transition(truth.n, 900.0)
    errors = []
    for size in (4000.0, 2000.0, 1000.0):
        end = flown(size * unit, truth.n, 0.0, 0.3, 900)
        errors.append(np.linalg.norm(end[:3] - (phi @ (size * unit))[:3]))
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, abs=0.1)


def test_a_metre_apart_on_a_circular_orbit(truth) -> None:
    """Second order is 1e-7 of the separation, rounding of the orbits 1e-9 m grown over 900 s."""
    state = np.array([1.0, -0.5, 0.7, 1e-3, 5e-4, -8e-4])
    expected = clohessy_wiltshire.propagate(state, truth.n, 900.0)
    np.testing.assert_allclose(flown(state, truth.n, 0.0, 0.3, 900), expected, rtol=0.0, atol=3e-6)


@pytest.mark.parametrize(("e", "theta"), [(0.008, 0.0), (0.008, 2.0), (0.1, 1.0)])
def test_ten_metres_apart_on_an_eccentric_orbit(truth, e: float, theta: float) -> None:
    state = np.array([10.0, -5.0, 7.0, 1e-2, 5e-3, -8e-3])
    end = flown(state, truth.n, e, theta, 900)
    expected = yamanaka_ankersen.transition(truth.n, e, theta, 900.0) @ state
    np.testing.assert_allclose(end, expected, rtol=0.0, atol=2e-4)
    circular = clohessy_wiltshire.propagate(state, truth.n, 900.0)
    assert np.linalg.norm(circular - end) > 100.0 * np.linalg.norm(expected - end)
