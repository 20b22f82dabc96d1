"""The truth integrator against scipy's DOP853 and the gradient of the potential; its relative state."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from relnav.geometry.frames import lvlh_ccsds_from_rsw, relative_state_rsw
from relnav.simulation.orbits import place_chaser, relative_state, runge_kutta_step

MU, RADIUS, J2 = 3.986004418e14, 6378136.6, 1.0826359e-3  # IERS Conventions (2010), table 1.1
TARGET = np.array([[6.7e6, 8.0e5, -4.0e5], [-400.0, 4700.0, 6050.0]])
COMMAND = np.array([2e-3, -1e-3, 3e-3])


def potential(r: np.ndarray, j2: float) -> complex:
    """mu/r (1 - J2 (R/r)^2 P2(z/r)), for real or complex positions."""
    distance = (r[0] ** 2 + r[1] ** 2 + r[2] ** 2) ** 0.5
    sine2 = (r[2] / distance) ** 2
    return MU / distance * (1.0 - j2 * (RADIUS / distance) ** 2 * 0.5 * (3.0 * sine2 - 1.0))


def gravity(r: np.ndarray, j2: float) -> np.ndarray:
    """Gradient of the potential by complex steps: no subtraction, so exact to rounding."""
    out = np.empty(3)
    for i in range(3):
        shifted = r.astype(complex)
        shifted[i] += 1e-10j
        out[i] = potential(shifted, j2).imag / 1e-10
    return out


def lvlh_axes_of(r: np.ndarray, v: np.ndarray) -> np.ndarray:
    z, y = -r / np.linalg.norm(r), -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    return np.array([np.cross(y, z), y, z])


def rate(y: np.ndarray, j2: float, air: float, ballistic: tuple[float, float], command: np.ndarray) -> np.ndarray:
    r1, v1, r2, v2 = y.reshape(4, 3)
    drag = [-0.5 * air * cd * np.linalg.norm(v) * v for cd, v in zip(ballistic, (v1, v2), strict=True)]
    thrust = lvlh_axes_of(r1, v1).T @ command
    return np.concatenate([v1, gravity(r1, j2) + drag[0], v2, gravity(r2, j2) + drag[1] + thrust])


def start(state: np.ndarray) -> np.ndarray:
    y = np.zeros((4, 3))
    y[:2] = TARGET
    place_chaser(y, state, np.empty((3, 3)))
    return y


def integrated(y: np.ndarray, environment: list[float], command: np.ndarray, dt: float, steps: int) -> np.ndarray:
    y, work = y.copy(), np.empty((23, 3))
    for _ in range(steps):
        runge_kutta_step(y, command, np.array(environment), dt, work)
    return y


@pytest.mark.parametrize(
    ("j2", "air", "ballistic"),
    [(0.0, 0.0, (0.0, 0.0)), (J2, 0.0, (0.0, 0.0)), (0.0, 4e-12, (0.01, 0.03)), (J2, 4e-9, (0.01, 0.03))],
    ids=["point mass", "J2", "drag", "J2 and heavy drag"],
)
def test_short_arc(j2: float, air: float, ballistic: tuple[float, float]) -> None:
    y = start(np.array([40.0, -20.0, 30.0, 0.05, -0.02, 0.03]))
    got = integrated(y, [MU, j2, air, *ballistic], COMMAND, 0.5, 400)
    solution = solve_ivp(
        lambda _t, x: rate(x, j2, air, ballistic, COMMAND),
        (0.0, 200.0),
        y.ravel(),
        method="DOP853",
        rtol=1e-13,
        atol=np.repeat([1e-7, 1e-10, 1e-7, 1e-10], 3),
    )
    expected = solution.y[:, -1].reshape(4, 3)
    np.testing.assert_allclose(got[[0, 2]], expected[[0, 2]], rtol=0.0, atol=2e-6)
    np.testing.assert_allclose(got[[1, 3]], expected[[1, 3]], rtol=0.0, atol=2e-8)
    # The difference of the two orbits is what matters here, and most rounding is common to both.
    np.testing.assert_allclose(got[2] - got[0], expected[2] - expected[0], rtol=0.0, atol=2e-7)


def test_the_forces_compared_are_large_enough_to_be_seen() -> None:
    y = start(np.array([40.0, -20.0, 30.0, 0.05, -0.02, 0.03]))
    none = np.zeros(3)
    plain = integrated(y, [MU, 0.0, 0.0, 0.01, 0.03], none, 0.5, 400)
    assert np.linalg.norm(integrated(y, [MU, J2, 0.0, 0.01, 0.03], none, 0.5, 400)[0] - plain[0]) > 100.0
    assert np.linalg.norm(integrated(y, [MU, 0.0, 4e-9, 0.01, 0.03], none, 0.5, 400)[2] - plain[2]) > 1.0
    assert np.linalg.norm(integrated(y, [MU, 0.0, 0.0, 0.01, 0.03], COMMAND, 0.5, 400)[2] - plain[2]) > 10.0


@pytest.mark.parametrize("steps", [16, 32])
def test_fourth_order(steps: int) -> None:
    """Half the step, a sixteenth of the error: over an orbit's third with steps of minutes."""
    y, environment = start(np.zeros(6)), [MU, J2, 0.0, 0.0, 0.0]
    exact = integrated(y, environment, np.zeros(3), 1.0, 1920)
    errors = [
        np.linalg.norm(integrated(y, environment, np.zeros(3), 1920.0 / n, n)[0] - exact[0]) for n in (steps, 2 * steps)
    ]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.5)


def test_energy_and_momentum_are_kept() -> None:
    y = start(np.array([10.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    end = integrated(y, [MU, 0.0, 0.0, 0.0, 0.0], np.zeros(3), 1.0, 3000)
    for row in (0, 2):
        energy = [0.5 * s[row + 1] @ s[row + 1] - MU / np.linalg.norm(s[row]) for s in (y, end)]
        assert energy[1] == pytest.approx(energy[0], rel=1e-11)
        np.testing.assert_allclose(np.cross(*end[row : row + 2]), np.cross(*y[row : row + 2]), rtol=1e-11, atol=1.0)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(st.lists(st.floats(-100.0, 100.0), min_size=6, max_size=6))
def test_there_and_back(values: list[float]) -> None:
    state = np.array(values)
    y, got = start(state), np.empty(6)
    relative_state(y, np.empty((3, 3)), got)
    np.testing.assert_allclose(got[:3], state[:3], rtol=0.0, atol=4e-9)  # 1e-16 of the orbit's radius
    np.testing.assert_allclose(got[3:], state[3:], rtol=0.0, atol=1e-11)
    other = lvlh_ccsds_from_rsw(relative_state_rsw(y[0], y[1], y[2], y[3]))
    np.testing.assert_allclose(got, other, rtol=0.0, atol=1e-9)


def test_velocity_is_the_rate_of_position_along_the_orbit() -> None:
    """Numerically, over a free arc: the sign of omega x rho cannot hide."""
    y = start(np.array([300.0, -200.0, 100.0, 0.5, -0.3, 0.2]))
    states = np.empty((5, 6))
    for row in range(5):
        relative_state(y, np.empty((3, 3)), states[row])
        y = integrated(y, [MU, 0.0, 0.0, 0.0, 0.0], np.zeros(3), 1.0, 1)
    slope = (states[0, :3] - 8.0 * states[1, :3] + 8.0 * states[3, :3] - states[4, :3]) / 12.0
    np.testing.assert_allclose(states[2, 3:], slope, rtol=0.0, atol=1e-8)
