"""Central projection by hand, its derivative against differences, and what lies behind."""

import numpy as np
import pytest

from relnav.geometry.pinhole import central_projection, central_projection_jacobian


def test_by_hand():
    np.testing.assert_array_equal(central_projection([[2.0, -3.0, 4.0], [0.0, 0.0, 0.1]]), [[0.5, -0.75], [0.0, 0.0]])


@pytest.mark.parametrize("shape", [(3,), (5, 3), (2, 4, 3)])
def test_jacobian_against_differences(truth, shape):
    points = np.random.default_rng(1).normal(size=shape)
    points[..., 2] = np.abs(points[..., 2]) + 0.5
    image, jacobian = central_projection(points), central_projection_jacobian(points)
    assert image.shape == (*shape[:-1], 2)
    assert jacobian.shape == (*shape[:-1], 2, 3)
    for place in np.ndindex(shape[:-1]):
        expected = truth.derivative(central_projection, points[place], 1e-3)
        np.testing.assert_allclose(jacobian[place], expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("z", [0.0, -0.0, -1.0, np.nan])
def test_nothing_behind_has_an_image(z):
    points = np.array([[1.0, 2.0, z], [1.0, 2.0, 4.0]])
    assert np.isnan(central_projection(points)[0]).all()
    assert np.isnan(central_projection_jacobian(points)[0, [0, 1], [0, 1]]).all()
    assert np.isnan(central_projection_jacobian(points)[0, :, 2]).all()
    np.testing.assert_array_equal(central_projection(points)[1], [0.25, 0.5])


def test_other_shapes_are_refused():
    with pytest.raises(ValueError, match=r"3 components .* got shape \(4, 2\)"):
        central_projection(np.zeros((4, 2)))
