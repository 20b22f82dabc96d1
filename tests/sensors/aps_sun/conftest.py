"""The shipped sensor, variants of it, and directions written here with plain numpy."""

from dataclasses import replace

import numpy as np
import pytest

import relnav

FLAT = {
    "glass_tilt_rad": (0.0, 0.0),
    "detector_tilt_rad": (0.0, 0.0),
    "detector_rotation_rad": 0.0,
    "misalignment_rad": (0.0, 0.0, 0.0),
}


@pytest.fixture(scope="session")
def model():
    """The shipped sensor, with its assembly errors: truth of these tests."""
    return relnav.load_model("aps_sun")


@pytest.fixture(scope="session")
def thin(model):
    """The same with a cover glass of 1 mm."""
    return replace(model, sensor=replace(model.sensor, glass_thickness_m=1e-3, glass_depth_m=1.6e-3))


@pytest.fixture(scope="session")
def aligned(model):
    """The same without assembly errors and without a dome."""
    return replace(model, sensor=replace(model.sensor, **FLAT), dome=replace(model.dome, thickness_m=0.0))


@pytest.fixture(scope="session")
def unit():
    """unit(angles (N, 2) deg) -> unit vectors (N, 3)."""

    def of(angles):
        t = np.tan(np.radians(np.asarray(angles, dtype=float)))
        s = np.concatenate([t, np.ones((len(t), 1))], axis=1)
        return s / np.linalg.norm(s, axis=1, keepdims=True)

    return of


@pytest.fixture(scope="session")
def grid():
    """grid(side) -> angles (side^2, 2) deg over +-60 deg."""

    def of(side):
        along = np.linspace(-60.0, 60.0, side)
        return np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)

    return of
