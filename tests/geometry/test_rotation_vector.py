"""Rotation vectors against scipy's, from none to half a turn."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.geometry.rotation_vector import attitude_error, rotation_vector_between, turn_by_rotation_vector, turned

ANGLES = [0.0, 1e-12, 1e-9, 1e-6, 9.9e-5, 1.01e-4, 1e-3, 0.1, 1.0, 2.0, 3.0, 3.1, np.pi - 1e-6, np.pi - 1e-12]


@pytest.mark.parametrize("angle", ANGLES)
def test_turn_and_back(angle):
    rng = np.random.default_rng(1)
    for _ in range(50):
        axis = rng.normal(size=3)
        v = angle * axis / np.linalg.norm(axis)
        start, out = Rotation.random(random_state=rng).as_matrix(), np.empty((3, 3))
        turn_by_rotation_vector(start, v, out)
        np.testing.assert_allclose(out, start @ Rotation.from_rotvec(v).as_matrix(), atol=3e-15)
        np.testing.assert_allclose(rotation_vector_between(out, start), v, atol=1e-15 + 1e-7 * (angle > 3.14))


def test_small_vectors_keep_their_relative_accuracy():
    v = 1e-10 * np.array([1.0, -2.0, 0.5])
    out = np.empty((3, 3))
    turn_by_rotation_vector(np.eye(3), v, out)
    np.testing.assert_allclose(rotation_vector_between(out, np.eye(3)), v, rtol=1e-5)


def test_exactly_half_a_turn():
    for axis in np.vstack([np.eye(3), np.array([[1.0, 1.0, 0.0], [1.0, -2.0, 3.0]])]):
        unit = axis / np.linalg.norm(axis)
        half = 2.0 * np.outer(unit, unit) - np.eye(3)
        v = rotation_vector_between(half, np.eye(3))
        assert np.linalg.norm(v) == pytest.approx(np.pi, abs=1e-12)
        assert abs(v @ unit) == pytest.approx(np.pi, abs=1e-12)


@pytest.mark.parametrize("size", [1e-9, 1e-6, 0.5, 2.0])
def test_sign_of_the_error_of_an_attitude(size):
    """The true frame is the estimated one turned by the error, and sees vectors turned the other way."""
    theta = size * np.array([1.0, -2.0, 3.0]) / np.sqrt(14.0)
    estimated = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    true = Rotation.from_rotvec(-theta).as_matrix() @ estimated
    np.testing.assert_allclose(attitude_error(estimated, true), theta, atol=1e-15)
    np.testing.assert_allclose(turned(estimated.T, theta), true.T, atol=1e-15)
