"""The two orbital frames: axis equations, round trips, and the relative state of two inertial ones."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.geometry.frames import (
    DCM_LVLH_CCSDS_FROM_RSW,
    lvlh_ccsds_from_rsw,
    relative_state_rsw,
    rsw_from_lvlh_ccsds,
)

NUMBER = st.floats(-1e6, 1e6)


def test_axis_equations() -> None:
    """x_l = y_rsw (V-bar), y_l = -z_rsw (-h), z_l = -x_rsw (nadir), of position and velocity alike."""
    state = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    np.testing.assert_array_equal(lvlh_ccsds_from_rsw(state), [2.0, -3.0, -1.0, 5.0, -6.0, -4.0])


@settings(derandomize=True, max_examples=50, deadline=None)
@given(st.lists(NUMBER, min_size=6, max_size=6))
def test_round_trip(values: list[float]) -> None:
    state = np.array(values)
    np.testing.assert_array_equal(rsw_from_lvlh_ccsds(lvlh_ccsds_from_rsw(state)), state)
    np.testing.assert_array_equal(lvlh_ccsds_from_rsw(rsw_from_lvlh_ccsds(state)), state)


def test_many_states_at_once() -> None:
    states = np.random.default_rng(0).normal(size=(4, 5, 6))
    turned = lvlh_ccsds_from_rsw(states)
    assert turned.shape == (4, 5, 6)
    np.testing.assert_array_equal(turned[2, 3], lvlh_ccsds_from_rsw(states[2, 3]))


def test_the_matrix_is_a_rotation_and_cannot_be_changed() -> None:
    np.testing.assert_array_equal(DCM_LVLH_CCSDS_FROM_RSW @ DCM_LVLH_CCSDS_FROM_RSW.T, np.eye(3))
    assert np.linalg.det(DCM_LVLH_CCSDS_FROM_RSW) == 1.0
    with pytest.raises(ValueError, match="read-only"):
        DCM_LVLH_CCSDS_FROM_RSW[0, 0] = 2.0


@pytest.mark.parametrize("shape", [(3,), (7,), (2, 3), (6, 2)])
@pytest.mark.parametrize("turn", [lvlh_ccsds_from_rsw, rsw_from_lvlh_ccsds])
def test_wrong_shape(turn, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"6 components in its last axis \(m, m/s\); got shape"):
        turn(np.zeros(shape))


def test_a_chaser_ahead_on_the_same_circular_orbit() -> None:
    """It stands still in the turning frame, a chord ahead and a little below: known without any formula of ours."""
    radius, n, ahead = 7.0e6, 1.1e-3, 1e-3
    target = np.array([radius, 0.0, 0.0]), np.array([0.0, radius * n, 0.0])
    chaser_r = radius * np.array([math.cos(ahead), math.sin(ahead), 0.0])
    chaser_v = radius * n * np.array([-math.sin(ahead), math.cos(ahead), 0.0])
    state = relative_state_rsw(*target, chaser_r, chaser_v)
    expected = [-2.0 * radius * math.sin(0.5 * ahead) ** 2, radius * math.sin(ahead), 0.0]
    np.testing.assert_allclose(state[:3], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(state[3:], 0.0, atol=1e-11 * radius * n)


def test_velocity_is_the_derivative_of_position_in_the_turning_frame() -> None:
    """Two inertial straight lines are enough: the frame's turn rate is h/r^2 whatever the force."""
    target_r, target_v = np.array([7.0e6, 1.0e5, -3.0e5]), np.array([-200.0, 5500.0, 5200.0])
    dr, dv = np.array([300.0, -500.0, 700.0]), np.array([0.3, -0.2, 0.7])

    def at(t: float) -> np.ndarray:
        return relative_state_rsw(target_r + t * target_v, target_v, target_r + dr + t * (target_v + dv), target_v + dv)

    h = 0.1
    slope = (at(h)[:3] - at(-h)[:3]) / (2.0 * h)
    np.testing.assert_allclose(at(0.0)[3:], slope, rtol=0.0, atol=1e-6)
    assert np.linalg.norm(at(0.0)[3:]) > 0.5  # the check above is not of a zero
