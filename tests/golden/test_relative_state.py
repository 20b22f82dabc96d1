"""Two inertial states to one relative state, against Basilisk's printed result."""

import tomllib
from pathlib import Path

import numpy as np

from relnav.geometry.frames import lvlh_ccsds_from_rsw, relative_state_rsw
from relnav.simulation.orbits import relative_state

CASE = tomllib.loads(Path(__file__).with_name("relative_state.toml").read_text())
INERTIAL = [np.array(CASE[key]) for key in ("target_position", "target_velocity", "chaser_position", "chaser_velocity")]


def test_relative_state_rsw(outside) -> None:
    state = relative_state_rsw(*INERTIAL)
    position = np.abs(state[:3] - CASE["relative_position"]).max()
    velocity = np.abs(state[3:] - CASE["relative_velocity"]).max()
    outside(CASE["authority"], "relative position (6 digits printed), km", position, CASE["position_tolerance"])
    outside(CASE["authority"], "relative velocity (9 digits printed), km/s", velocity, CASE["velocity_tolerance"])


def test_relative_state_of_the_simulator_in_lvlh_ccsds() -> None:
    state = np.empty(6)
    relative_state(np.array(INERTIAL), np.empty((3, 3)), state)
    x, y, z = CASE["relative_position"]
    u, v, w = CASE["relative_velocity"]
    np.testing.assert_allclose(state[:3], [y, -z, -x], rtol=0.0, atol=CASE["position_tolerance"])
    np.testing.assert_allclose(state[3:], [v, -w, -u], rtol=0.0, atol=CASE["velocity_tolerance"])
    np.testing.assert_allclose(state, lvlh_ccsds_from_rsw(relative_state_rsw(*INERTIAL)), rtol=1e-9, atol=1e-12)
