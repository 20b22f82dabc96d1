"""Clohessy-Wiltshire motion against published results; the data and their authorities stand in the .toml beside."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from relnav.dynamics.clohessy_wiltshire import propagate, transition

DATA = tomllib.loads(Path(__file__).with_name("clohessy_wiltshire.toml").read_text())

# Written out from the frames' definitions, not taken from the product: x_l = y_rsw, y_l = -z_rsw, z_l = -x_rsw.
LVLH_FROM_RSW = np.kron(np.eye(2), [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])


def mean_motion(case: dict) -> float:
    return math.sqrt(case["mu_m3_s2"] / case["radius_m"] ** 3)


def difference(got: np.ndarray, expected: list[float]) -> float:
    """Largest difference of a component, relative to the largest of position and of velocity."""
    parts = np.reshape(expected, (2, 3))
    return float((np.abs(np.reshape(got, (2, 3)) - parts).max(axis=1) / np.abs(parts).max(axis=1)).max())


@pytest.mark.parametrize("case", DATA["free_motion"], ids=lambda case: case["name"])
def test_free_motion_in_rsw(case: dict, outside) -> None:
    end = transition(mean_motion(case), case["dt_s"], frame=case["frame"]) @ np.array(case["start"])
    what = f"Clohessy-Wiltshire state after {case['dt_s']:g} s, relative"
    outside(case["authority"], what, difference(end, case["end"]), case["relative_tolerance"])


@pytest.mark.parametrize("case", DATA["free_motion"], ids=lambda case: case["name"])
def test_free_motion_in_lvlh_ccsds_is_the_same_motion_turned(case: dict) -> None:
    end = propagate(LVLH_FROM_RSW @ np.array(case["start"]), mean_motion(case), case["dt_s"])
    assert difference(end, LVLH_FROM_RSW @ np.array(case["end"])) <= case["relative_tolerance"]


@pytest.mark.parametrize("case", DATA["thrust"], ids=lambda case: case["name"])
def test_constant_thrust_in_lvlh_ccsds(case: dict, outside) -> None:
    end = propagate(
        np.array(case["start"]), mean_motion(case), case["dt_s"], acceleration_m_s2=np.array(case["acceleration"])
    )
    what = f"{case['name'].split(maxsplit=1)[1]}, state after {case['dt_s']:g} s, relative"
    outside(case["authority"], what, difference(end, case["end"]), case["relative_tolerance"])


def test_two_impulse_transfer_of_curtis(outside) -> None:
    case = DATA["transfer"]
    phi = transition(case["mean_motion_rad_s"], case["dt_s"], frame=case["frame"])
    r0, v0 = np.array(case["start_position"]), np.array(case["start_velocity"])
    needed = np.linalg.solve(phi[:3, 3:], -phi[:3, :3] @ r0)
    off = np.abs(needed / v0 - 1.0).max()
    outside(case["authority"], "velocity after the first burn, relative", off, case["relative_tolerance"])
    arrival = phi @ np.concatenate([r0, needed])
    np.testing.assert_allclose(arrival[:3], 0.0, atol=1e-7)  # of 20 km: rounding of the solve
    np.testing.assert_allclose(arrival[3:], case["end_velocity"], rtol=1e-11)


def test_an_impulse_acts_at_the_end_of_the_step() -> None:
    n, start, impulse = 1.1e-3, np.array([10.0, 1.0, -2.0, 0.01, 0.0, -0.02]), np.array([0.1, -0.2, 0.3])
    coasted = propagate(start, n, 50.0)
    kicked = propagate(start, n, 50.0, delta_v_m_s=impulse)
    np.testing.assert_array_equal(kicked[:3], coasted[:3])
    np.testing.assert_allclose(kicked[3:] - coasted[3:], impulse, rtol=1e-14)
