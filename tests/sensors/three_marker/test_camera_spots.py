"""A spot of a camera: where the image ends, and what a spot's covariance says of the normalised point."""

import numpy as np
import pytest

import relnav
from relnav.sensors.three_marker.camera import normalise_spot, on_image


@pytest.fixture(scope="module")
def camera():
    return relnav.load_model("three_marker_vision").camera


def test_the_image_ends_half_a_pixel_beyond_its_last_centres(camera):
    width, height = camera.image_size_px
    inside = [[-0.5, -0.5], [width - 0.5, height - 0.5], [1.0, 1.0]]
    outside = [[-0.51, 1.0], [1.0, -0.51], [width - 0.49, 1.0], [1.0, height - 0.49], [np.nan, 1.0]]
    assert on_image(np.array(inside + outside), camera).tolist() == [True] * 3 + [False] * 5


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_information_of_a_normalised_point(camera, scale):
    """J^T R^-1 J by central differences of the spot over the point, for a covariance small and large in px^2."""
    covariance = scale * np.array([[0.04, 0.01], [0.01, 0.09]])
    lens = np.asarray(camera.lens, dtype=float)
    x, y, *information = normalise_spot(620.0, 410.0, *covariance.ravel().tolist(), lens)
    step, corners = 0.5, []
    for u, v in ((620.0 + step, 410.0), (620.0 - step, 410.0), (620.0, 410.0 + step), (620.0, 410.0 - step)):
        corners.append(normalise_spot(u, v, 1.0, 0.0, 0.0, 1.0, lens)[:2])
    right, left, down, up = map(np.array, corners)
    point_of_spot = np.stack([(right - left) / (2.0 * step), (down - up) / (2.0 * step)], axis=1)
    of_point = np.linalg.inv(point_of_spot @ covariance @ point_of_spot.T)
    assert np.isfinite([x, y]).all()
    np.testing.assert_allclose(information, [of_point[0, 0], of_point[0, 1], of_point[1, 1]], rtol=1e-5)


def test_a_covariance_without_determinant_gives_no_point(camera):
    assert np.isnan(normalise_spot(620.0, 410.0, 1.0, 1.0, 1.0, 1.0, np.asarray(camera.lens, dtype=float))).all()
