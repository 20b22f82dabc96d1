"""Central projection, its derivative and its inverse ray."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from relnav.geometry.pinhole import project, project_jacobian_row, unit_ray

SIDE, DEPTH = st.floats(-20.0, 20.0), st.floats(0.5, 50.0)


def image(c: np.ndarray, f: float = 0.05) -> np.ndarray:
    out = np.empty(2)
    assert project(c, f, out)
    return out


def test_projection_by_similar_triangles() -> None:
    np.testing.assert_allclose(image(np.array([1.0, -2.0, 10.0])), [0.005, -0.01], rtol=1e-15)


@settings(derandomize=True, max_examples=50, deadline=None)
@given(SIDE, SIDE, DEPTH)
def test_jacobian_row(truth, x: float, y: float, depth: float) -> None:
    c = np.array([x, y, depth])
    got = np.empty((2, 3))
    for axis in range(2):
        project_jacobian_row(c, 0.05, axis, got[axis])
    expected = truth.derivative(lambda v: 0.05 * v[:2] / v[2], c, 1e-3 * depth)
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


@settings(derandomize=True, max_examples=50, deadline=None)
@given(SIDE, SIDE, DEPTH)
def test_the_ray_of_a_spot_points_at_its_beacon(x: float, y: float, depth: float) -> None:
    c = np.array([x, y, depth])
    spot, ray = image(c), np.empty(3)
    unit_ray(spot[0], spot[1], 0.05, ray)
    np.testing.assert_allclose(ray, c / np.linalg.norm(c), rtol=0.0, atol=5e-16)


@pytest.mark.parametrize("depth", [0.0, -0.0, -1.0, math.nan])
def test_nothing_behind_the_lens_has_an_image(depth: float) -> None:
    out = np.array([7.0, 7.0])
    assert not project(np.array([0.1, 0.1, depth]), 0.05, out)
    np.testing.assert_array_equal(out, [7.0, 7.0])
