"""Models, and independent truth: images made here with plain numpy and scipy's rotations."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav

SQUARE_AND_RAISED = ((0.0, 0.3, 0.3), (0.0, -0.3, 0.3), (0.0, -0.3, -0.3), (0.0, 0.3, -0.3), (0.3, 0.0, 0.0))
# Axes of the paper (x right, y boresight, z up) seen from the camera (x right, y down, z boresight)
CAM_FROM_PAPER = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
LENS = (-0.12, 0.03, 8e-4, -5e-4, 0.0)


def pinhole(points, dcm, position, camera):
    """Pixels of points, without distortion."""
    p = points @ np.asarray(dcm).T + position
    return p[:, :2] / p[:, 2:] * np.array(camera.focal_length_px) + np.array(camera.principal_point_px)


def tilt(rng, largest_deg):
    """Rotation matrix about a random axis."""
    axis = rng.normal(size=3)
    return Rotation.from_rotvec(np.radians(largest_deg) * axis / np.linalg.norm(axis)).as_matrix()


def attitude_error(dcm, dcm_true):
    """Angle between two attitudes, rad."""
    return Rotation.from_matrix(dcm_true.T @ dcm).magnitude()


@pytest.fixture(scope="session")
def model():
    return relnav.load_model("three_marker_vision")


@pytest.fixture(scope="session")
def flat():
    return relnav.load_model("three_marker_vision_flat")


@pytest.fixture(scope="session")
def five(model):
    """A square with a raised middle."""
    return dataclasses.replace(model, markers=dataclasses.replace(model.markers, positions_m=SQUARE_AND_RAISED))


@pytest.fixture(scope="session")
def with_lens(model):
    return dataclasses.replace(model, camera=dataclasses.replace(model.camera, distortion=LENS))


@pytest.fixture(scope="session")
def own():
    """The functions and constants of this file."""
    return SimpleNamespace(pinhole=pinhole, tilt=tilt, attitude_error=attitude_error, cam_from_paper=CAM_FROM_PAPER)
