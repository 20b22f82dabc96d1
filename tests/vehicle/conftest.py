"""The shipped vehicle, and a state in the middle of an approach with everything off a little."""

import numpy as np
import pytest

import relnav
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator


@pytest.fixture(scope="session")
def vehicle():
    return relnav.load_model("rendezvous_demo")


@pytest.fixture(scope="session")
def short_run(vehicle):
    """Twelve seconds at 5 m."""
    return simulate_rendezvous(vehicle, Rendezvous(start_m=5.6, final_m=5.0), seed=3)


@pytest.fixture
def navigator(vehicle):
    """One filter, without a second that watches."""
    return VehicleNavigator(vehicle, position_m=vehicle.start_position_m - [24.4, 0.0, 0.0], monitor=False)


@pytest.fixture
def odd_state(navigator):
    """Settled estimates of one filter with values that no symmetry hides."""
    rng = np.random.default_rng(11)
    navigator.observe("gyro", 0.0, rng.normal(size=3) * 1e-3)
    start = navigator._timeline.newest.estimates
    scale = np.minimum(np.sqrt(np.diagonal(start.covariance[0])), 0.02)
    for block in navigator.layout.blocks:
        if block.name.endswith(".mount"):  # values of turns add up to first order only, and start at zero
            scale[block.place] = 0.0
    return start.corrected(rng.normal(size=(1, scale.size)) * scale)
