"""A spot of a camera: where the image ends, and what a spot's covariance says of the normalised point."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.sensors.three_marker.camera import (
    image_of,
    normalise,
    normalise_spot,
    on_image,
    usable_covariance,
    usable_into,
)


@pytest.fixture(scope="module")
def camera():
    return relnav.load_model("three_marker_vision").camera


def test_the_image_ends_half_a_pixel_beyond_its_last_centres(camera):
    width, height = camera.image_size_px
    inside = [[-0.5, -0.5], [width - 0.5, height - 0.5], [1.0, 1.0]]
    outside = [[-0.51, 1.0], [1.0, -0.51], [width - 0.49, 1.0], [1.0, height - 0.49], [np.nan, 1.0]]
    spots = np.array(inside + outside)
    assert on_image(spots, camera).tolist() == [True] * 3 + [False] * 5
    image, weights, which = np.empty((8, 2)), np.empty((8, 3)), np.empty(8, dtype=np.int64)
    lens = np.asarray(camera.lens, dtype=float)
    assert usable_into(spots, np.empty((0, 2, 2)), lens, image, weights, which) == 3
    assert which[:3].tolist() == [0, 1, 2]


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


def bent(camera):
    """With a lens that bends."""
    return dataclasses.replace(camera, distortion=(0.1, -0.05, 1e-3, -2e-3, 0.01))


def test_a_point_comes_back_from_its_image(camera):
    """Through the distortion and back, and the Jacobian by differences; each coordinate with a scale of its own."""
    points = np.array([[0.4, -0.3, 5.0], [-0.8, 0.5, 4.0], [0.05, 0.6, 3.0]])
    for one in (camera, bent(camera)):
        spots, jacobian = image_of(points, one)
        back, _ = normalise(spots, one)
        np.testing.assert_allclose(back, points[:, :2] / points[:, 2:], rtol=1e-9)
        for axis, step in enumerate(1e-5 * np.eye(3)):
            slope = (image_of(points + step, one)[0] - image_of(points - step, one)[0]) / 2e-5
            np.testing.assert_allclose(jacobian[:, :, axis], slope, rtol=1e-6, atol=1e-6)


def test_where_the_distortion_folds_back_there_is_no_image(camera):
    """Pure barrel of k1 = -0.3: r (1 - 0.3 r^2) rises up to r = 1.054 and falls beyond, in every direction."""
    folding = dataclasses.replace(camera, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    angle = np.radians(np.arange(0.0, 360.0, 22.5))
    inside, beyond = (np.column_stack([r * np.cos(angle), r * np.sin(angle), np.ones(16)]) for r in (1.05, 1.06))
    assert np.isfinite(image_of(inside, folding)[0]).all()
    for part in image_of(beyond, folding):
        assert np.isnan(part).all()


def test_information_of_the_cameras_own_noise(camera):
    """f^2 / sigma^2 where nothing bends, each coordinate its own."""
    plain = dataclasses.replace(camera, distortion=(0.0,) * 5)
    _, information = normalise(np.array([[620.0, 410.0], [100.0, 90.0]]), plain)
    fx, fy = plain.focal_length_px
    expected = np.array([fx**2, 0.0, fy**2]) / plain.spot_noise_px**2
    np.testing.assert_allclose(information, [expected, expected], rtol=1e-9, atol=1e-6)


def test_which_spots_are_used(camera):
    """What is off the image or has no covariance is left out, and the others keep their number and their weights."""
    spots = np.array([[620.0, 410.0], [-3.0, 5.0], [100.0, 90.0], [300.0, 300.0]])
    own = np.array([[[0.04, 0.01], [0.01, 0.09]], np.eye(2), [[1.0, 2.0], [2.0, 1.0]], [[0.16, -0.02], [-0.02, 0.25]]])
    image, weights, which = np.empty((4, 2)), np.empty((4, 3)), np.empty(4, dtype=np.int64)
    lens = np.asarray(camera.lens, dtype=float)
    assert usable_into(spots, own, lens, image, weights, which) == 2
    assert which[:2].tolist() == [0, 3]
    seen = spots[[0, 3]]
    expected, information = normalise(seen, camera, own[[0, 3]])
    np.testing.assert_allclose(image[:2], expected, rtol=1e-12)
    np.testing.assert_allclose(weights[:2], information, rtol=1e-12)
    assert usable_into(spots, np.empty((0, 2, 2)), lens, image, weights, which) == 3
    np.testing.assert_allclose(weights[:3], normalise(spots[[0, 2, 3]], camera)[1], rtol=1e-12)
    assert usable_into(spots[:1], own[:1], lens, image, weights, which) == 1
    np.testing.assert_allclose(weights[:1], information[:1], rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_covariance_is_symmetric_to_its_own_size(scale):
    """To 1e-9 of the geometric mean of its variances, whatever the unit."""

    def asymmetric_by(part):
        return scale * np.array([[2.0, 0.5], [0.5 + part, 3.0]])

    given = np.array([asymmetric_by(0.0), asymmetric_by(1e-9), asymmetric_by(1e-8)])
    assert usable_covariance(given).tolist() == [True, True, False]


def test_a_covariance_is_finite():
    for k in range(4):
        given = np.array([2.0, 0.0, 0.0, 3.0])
        for value in (np.inf, np.nan):
            given[k] = value
            assert usable_covariance(given.reshape(1, 2, 2)).tolist() == [False]
    assert usable_covariance(np.array([[[np.inf, 0.0], [0.0, np.inf]]])).tolist() == [False]
