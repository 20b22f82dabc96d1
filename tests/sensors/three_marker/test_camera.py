"""Projection with distortion, what is visible, the way back, and pixel noise as a weight."""

import dataclasses

import numpy as np
import pytest

from relnav.sensors.three_marker import project
from relnav.sensors.three_marker.camera import is_covariance, normalise, unit_rays


def points_in_front(n=40, seed=1):
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.0, 30.0, n)
    return np.column_stack([rng.uniform(-0.3, 0.3, n) * z, rng.uniform(-0.3, 0.3, n) * z, z])


def test_against_opencv(with_lens):
    cv2 = pytest.importorskip("cv2", reason="OpenCV, the other implementation, is not installed")
    camera, p = with_lens.camera, points_in_front()
    (fx, fy), (cx, cy) = camera.focal_length_px, camera.principal_point_px
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    theirs, _ = cv2.projectPoints(p, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))
    seen = project(p, camera)
    assert seen.visible.all()
    np.testing.assert_allclose(seen.spots_px, theirs[:, 0], atol=1e-9)


def test_jacobian(with_lens, truth):
    for p in points_in_front(10):
        expected = truth.derivative(lambda q: project(q[None], with_lens.camera).spots_px[0], p, 1e-3)
        np.testing.assert_allclose(project(p[None], with_lens.camera).jacobian_px_m[0], expected, rtol=1e-7, atol=1e-7)


def test_there_and_back(with_lens):
    p = points_in_front()
    xy, _ = normalise(project(p, with_lens.camera).spots_px, with_lens.camera)
    np.testing.assert_allclose(xy, p[:, :2] / p[:, 2:], atol=1e-12)
    np.testing.assert_allclose(unit_rays(xy), p / np.linalg.norm(p, axis=1)[:, None], atol=1e-12)


def test_what_is_not_visible(model):
    camera = model.camera
    edge = (1023.5 - 511.5) / 1407.0
    p = np.array(
        [
            [0.0, 0.0, 5.0],
            [0.0, 0.0, -5.0],
            [0.0, 0.0, 0.0],
            [5.0 * edge * 0.9999, 0.0, 5.0],
            [5.0 * edge * 1.0001, 0.0, 5.0],
            [0.0, -5.0 * edge * 1.0001, 5.0],
            [np.nan, 0.0, 5.0],
        ]
    )
    seen = project(p, camera)
    assert seen.visible.tolist() == [True, False, False, True, False, False, False]
    assert np.isnan(seen.spots_px[~seen.visible]).all()
    assert np.isnan(seen.jacobian_px_m[~seen.visible]).all()
    np.testing.assert_allclose(seen.spots_px[0], [511.5, 511.5])


def test_a_fold_does_not_bring_back_what_is_outside(model):
    """At x = 0.97, x (1 - 0.9 x^2) is 0.15: on the image, although the ray is far off it."""
    camera = dataclasses.replace(model.camera, distortion=(-0.9, 0.0, 0.0, 0.0, 0.0))
    p = np.array([[0.97 * 5.0, 0.0, 5.0], [0.1 * 5.0, 0.0, 5.0]])
    assert project(p, camera).visible.tolist() == [False, True]


def test_weight_is_the_information_of_the_pixel_noise(with_lens, truth):
    camera, p = with_lens.camera, points_in_front(10)
    spots = project(p, camera).spots_px
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    xy, weights = normalise(spots, camera, np.tile(covariance, (10, 1, 1)))
    for k in range(10):
        J = truth.derivative(lambda v, z=1.0: project(np.array([[*(v * z), z]]), camera).spots_px[0], xy[k], 1e-3)
        W = J.T @ np.linalg.solve(covariance, J)
        np.testing.assert_allclose(weights[k], [W[0, 0], W[0, 1], W[1, 1]], rtol=1e-7)
    _, plain = normalise(spots, camera)
    _, same = normalise(spots, camera, np.tile(0.1**2 * np.eye(2), (10, 1, 1)))
    np.testing.assert_allclose(plain, same, rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_unit_of_length_moves_no_spot(with_lens, scale):
    p = points_in_front()
    near, scaled = project(p, with_lens.camera), project(scale * p, with_lens.camera)
    np.testing.assert_array_equal(scaled.visible, near.visible)
    np.testing.assert_allclose(scaled.spots_px, near.spots_px, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("matrix", "good"),
    [
        ((2.0, 0.5, 0.5, 1.0), True),
        ((2.0, 0.5, 0.4, 1.0), False),  # not symmetric
        ((1.0, 1.0, 1.0, 1.0), False),  # not definite
        ((-2.0, 0.0, 0.0, -1.0), False),
        ((np.inf, 0.0, 0.0, 1.0), False),
        ((1.0, 0.0, 0.0, np.inf), False),
        ((1.0, np.nan, 0.0, 1.0), False),
    ],
)
def test_what_is_a_covariance(matrix, good):
    assert is_covariance(*matrix) == good
