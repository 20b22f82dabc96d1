"""Lens distortion against OpenCV's camera model, its Jacobian against differences, its inverse against itself."""

import numpy as np
import pytest

from relnav.geometry.distortion import distort, undistort

LENSES = {
    "none": np.zeros(5),
    "barrel": np.array([-0.25, 0.08, 1e-3, -8e-4, -0.01]),
    "pincushion": np.array([0.15, -0.02, -5e-4, 3e-4, 0.004]),
}


def grid(half=0.36):
    x, y = np.meshgrid(np.linspace(-half, half, 15), np.linspace(-half, half, 15))
    return np.stack([x.ravel(), y.ravel()], axis=-1)


@pytest.mark.parametrize("lens", LENSES)
def test_against_opencv(lens, outside):
    cv2 = pytest.importorskip("cv2", reason="OpenCV, the other implementation, is not installed")
    k, xy = LENSES[lens], grid()
    points = np.column_stack([xy, np.ones(len(xy))])
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), k)
    off = np.abs(distort(xy, k)[0] - theirs[:, 0]).max()
    outside("OpenCV projectPoints", f"lens distortion, {lens}, normalised image", off, 1e-14)


@pytest.mark.parametrize("lens", LENSES)
def test_jacobian(lens, truth):
    k = LENSES[lens]
    for point in grid()[::7]:
        expected = truth.derivative(lambda v: distort(v[None], k)[0][0], point, 1e-3)
        np.testing.assert_allclose(distort(point[None], k)[1][0], expected, atol=1e-10)


@pytest.mark.parametrize("lens", LENSES)
def test_there_and_back(lens):
    k, xy = LENSES[lens], grid()
    image, jacobian = distort(xy, k)
    back, slope = undistort(image, k)
    np.testing.assert_allclose(back, xy, atol=1e-12)
    np.testing.assert_allclose(slope, jacobian, atol=1e-10)


def test_an_image_beyond_the_fold_is_none():
    """The most of x (1 - 0.25 x^2) is 0.77, at x = 1.15: no point has its image at 1.0."""
    image = np.array([[1.0, 0.0], [0.5, 0.0], [np.nan, 0.0]])
    back, _ = undistort(image, np.array([-0.25, 0.0, 0.0, 0.0, 0.0]))
    assert np.isnan(back[[0, 2]]).all()
    assert back[1, 0] * (1.0 - 0.25 * back[1, 0] ** 2) == pytest.approx(0.5, abs=1e-12)
