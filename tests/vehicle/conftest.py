"""The shipped vehicle, and a state in the middle of an approach with everything off a little."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator

SLOW = {"gyro.rate_hz": 20.0, "sensor.star.rate_hz": 2.0, "sensor.psd.rate_hz": 2.5, "sensor.camera.rate_hz": 2.0,
        "sensor.sun_aps.rate_hz": 0.2, "sensor.sun_birefringent.rate_hz": 0.2}  # fmt: skip
"""Sampled slower than the shipped vehicle, so that many runs are quick."""


@pytest.fixture(scope="session")
def vehicle():
    return relnav.load_model("rendezvous_demo")


@pytest.fixture(scope="session")
def near(vehicle):
    """Handed over where its run begins, at 5.6 m."""
    hand_over = dataclasses.replace(vehicle.hand_over, port_distance_m=(5.6, 0.0, 0.0), position_sigma_m=0.1)
    return dataclasses.replace(vehicle, hand_over=hand_over)


@pytest.fixture(scope="session")
def short_run(vehicle):
    """Twelve seconds at 5 m."""
    return simulate_rendezvous(vehicle, Rendezvous(start_m=5.6, final_m=5.0), seed=3)


@pytest.fixture(scope="session")
def slow():
    """From 5.5 m; hand-over stands there too."""
    vehicle = relnav.load_model("rendezvous_demo", changes=SLOW)
    near = dataclasses.replace(vehicle.hand_over, port_distance_m=(5.5, 0.0, 0.0), position_sigma_m=0.1)
    return dataclasses.replace(vehicle, hand_over=near)


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
