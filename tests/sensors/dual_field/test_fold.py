"""The fold: reflection by ray tracing, the exact angle across fields, and the patent's angle, which is wrong."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.sensors.dual_field.fold import check_fold, cross_field_cos, fold_rays, mirror_fold, patent_cross_angles
from relnav.sensors.dual_field.sensor import Fold

NORMAL = np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)


HALF = np.tan(np.radians(7.0))


def field_rays(rng, n=200):
    u = np.concatenate([rng.uniform(-HALF, HALF, (n, 2)), np.ones((n, 1))], axis=1)
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def test_light_from_the_folded_direction_arrives_along_the_ray():
    """Light of a star at s travels along -s; the mirror turns it to -s + 2 n (n.s), which must be -u."""
    u = field_rays(np.random.default_rng(1))
    s = fold_rays(u, np.ones(len(u), dtype=int), mirror_fold(NORMAL))
    reflected = -s + 2.0 * (s @ NORMAL)[:, None] * NORMAL
    np.testing.assert_allclose(reflected, -u, atol=1e-15)


def test_the_second_boresight_is_plus_x():
    np.testing.assert_allclose(mirror_fold(NORMAL) @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(Fold("mirror").matrix, mirror_fold(-NORMAL), atol=1e-12)
    np.testing.assert_allclose(Fold("rotation").matrix @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    assert Fold("none").matrix is None


def test_a_mirror_is_its_own_inverse_and_changes_the_handedness():
    M = mirror_fold(np.array([0.6, 0.0, -0.8]))
    np.testing.assert_allclose(M @ M, np.eye(3), atol=1e-15)
    assert np.linalg.det(M) == pytest.approx(-1.0)


def test_the_angle_across_fields_in_detector_coordinates():
    """It is cos t = (X_i + X_j + Y_i Y_j) / sqrt(..) for the mirror at 45 deg, the same whoever is in which field."""
    rng = np.random.default_rng(2)
    u, w = field_rays(rng), field_rays(rng)
    (X, Y), (P, Q) = (u[:, :2] / u[:, 2:]).T, (w[:, :2] / w[:, 2:]).T
    expected = (X + P + Y * Q) / np.sqrt((1 + X**2 + Y**2) * (1 + P**2 + Q**2))
    M = mirror_fold(NORMAL)
    np.testing.assert_allclose(cross_field_cos(u, w, M), expected, atol=1e-15)
    np.testing.assert_allclose(cross_field_cos(w, u, M), expected, atol=1e-15)
    np.testing.assert_allclose(cross_field_cos(u, w, M), np.sum(u * (w @ M.T), axis=1), atol=1e-15)


def test_the_patents_angle_fails_even_in_the_plane():
    """Y = 0: the true angle is 90 deg minus the sum of the field angles; the patent has their difference."""
    a, b = np.radians(5.0), np.radians(2.0)
    u, w = np.array([np.sin(a), 0, np.cos(a)]), np.array([np.sin(b), 0, np.cos(b)])
    true = np.degrees(np.arccos(cross_field_cos(u, w, mirror_fold(NORMAL))))
    assert true == pytest.approx(90.0 - 7.0)
    assert np.degrees(patent_cross_angles(a - b)) == pytest.approx((87.0, 93.0))
    turned = np.degrees(np.arccos(cross_field_cos(u, w, Rotation.from_euler("y", 90, degrees=True).as_matrix())))
    assert turned == pytest.approx(90.0 - 3.0) or turned == pytest.approx(90.0 + 3.0)


def test_the_patents_angle_is_off_by_degrees_for_most_pairs():
    rng = np.random.default_rng(3)
    u, w = field_rays(rng, 4000), field_rays(rng, 4000)
    true = np.arccos(cross_field_cos(u, w, mirror_fold(NORMAL)))
    less, more = patent_cross_angles(np.arccos(np.sum(u * w, axis=1)))
    error = np.degrees(np.minimum(np.abs(true - less), np.abs(true - more)))
    assert 3.0 < np.median(error) < 6.0
    assert np.mean(error < 30.0 / 3600.0) < 0.01


def test_swapping_all_fields_changes_no_angle():
    """Why the patent's eight cases leave two solutions, and handedness must decide."""
    rng = np.random.default_rng(4)
    u, M, field = field_rays(rng, 4), mirror_fold(NORMAL), np.array([0, 1, 1, 0])
    s, swapped = fold_rays(u, field, M), fold_rays(u, 1 - field, M)
    np.testing.assert_allclose(s @ s.T, swapped @ swapped.T, atol=1e-15)
    assert np.linalg.det(s[:3]) == pytest.approx(-np.linalg.det(swapped[:3]))


@pytest.mark.parametrize("normal", [np.array([1.0, 0.0, -1.0]), np.array([1.0, 0.0])])
def test_a_normal_that_is_none(normal):
    with pytest.raises(ValueError, match="unit vector"):
        mirror_fold(normal)


def test_a_fold_that_is_none():
    with pytest.raises(ValueError, match="orthogonal"):
        check_fold(np.ones((3, 3)))
    with pytest.raises(ValueError, match="mirror_normal is a unit vector"):
        Fold("mirror", mirror_normal=(1.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="rotation is a unit quaternion"):
        Fold("rotation", rotation=(1.0, 0.0, 0.0, 1.0))
