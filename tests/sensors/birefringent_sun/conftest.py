"""The shipped sensor and random crystals and directions."""

from dataclasses import replace

import numpy as np
import pytest

import relnav


@pytest.fixture(scope="session")
def model():
    return relnav.load_model("birefringent_sun")


@pytest.fixture(scope="session")
def sensor(model):
    return model.sensor


@pytest.fixture(scope="session")
def cone():
    """cone(half angle deg, count, seed) -> unit vectors (count, 3), even over the cone."""

    def of(half_angle_deg, count, seed=0):
        rng = np.random.default_rng(seed)
        z, turn = rng.uniform(np.cos(np.radians(half_angle_deg)), 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
        return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)

    return of


@pytest.fixture(scope="session")
def crystals(sensor):
    """crystals(count, seed) -> sensors with optic axes anywhere."""

    def of(count, seed=0):
        rng = np.random.default_rng(seed)
        return [
            replace(sensor, axis_polar_rad=float(np.arccos(rng.random())), axis_azimuth_rad=float(6.28 * rng.random()))
            for _ in range(count)
        ]

    return of
