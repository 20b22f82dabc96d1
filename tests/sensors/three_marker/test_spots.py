"""From images to spots: centroids with honest covariance, and merged, full, cut and false blobs told."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.sensors.three_marker import find_spots, measure_image, project
from relnav.simulation.marker_images import marker_image


@pytest.fixture(scope="module")
def imager(model):
    return dataclasses.replace(model.imager, centroid_floor_px=0.0)


def image(spots, flux, imager, rng, size=(60, 60), **options):
    return marker_image(np.array(spots, dtype=float), np.full(len(spots), float(flux)), imager, size, rng, **options)


@pytest.mark.parametrize("flux", [500.0, 3000.0, 20000.0])
def test_centroid_and_its_covariance(imager, flux):
    """Mean NEES over 2 within 1 +- 0.15 (480 spots: 3 sigma is 0.14)."""
    rng = np.random.default_rng(1)
    nees = []
    for _ in range(120):
        true = np.array([[15.0, 15.0], [45.0, 15.0], [15.0, 45.0], [45.0, 45.0]]) + rng.uniform(-0.5, 0.5, (4, 2))
        found = find_spots(image(true, flux, imager, rng), imager)
        assert len(found.spots_px) == 4
        for spot, covariance in zip(found.spots_px, found.covariance_px2, strict=True):
            error = spot - true[np.argmin(np.linalg.norm(true - spot, axis=1))]
            assert np.linalg.norm(error) < 1.0
            nees.append(error @ np.linalg.solve(covariance, error))
        assert found.usable.all()
    assert np.mean(nees) / 2.0 == pytest.approx(1.0, abs=0.15)


def test_flux_and_radius(imager):
    found = find_spots(image([[30.2, 29.7]], 8000.0, imager, np.random.default_rng(2), radius_px=2.5), imager)
    assert found.flux_dn[0] == pytest.approx(8000.0, rel=0.02)
    assert found.radius_px[0] == pytest.approx(2.5, rel=0.05)


def test_brightest_first(imager):
    rng = np.random.default_rng(3)
    picture = marker_image(np.array([[15.0, 15.0], [45.0, 45.0]]), np.array([1000.0, 9000.0]), imager, (60, 60), rng)
    assert find_spots(picture, imager).spots_px[0] == pytest.approx([45.0, 45.0], abs=0.3)


@pytest.mark.parametrize("separation", [1.8, 2.5, 4.0, 6.0])
def test_merged_blobs_are_told(imager, separation):
    rng = np.random.default_rng(4)
    told = 0
    for _ in range(40):
        angle, middle = rng.uniform(0.0, np.pi), rng.uniform(28.0, 32.0, 2)
        half = 0.5 * separation * np.array([np.cos(angle), np.sin(angle)])
        flux = 6000.0 * np.array([1.0, rng.uniform(0.5, 1.0)])
        found = find_spots(marker_image(np.array([middle + half, middle - half]), flux, imager, (60, 60), rng), imager)
        told += bool(found.blended.all()) or len(found.blended) == 2
    assert told == 40


def test_a_single_blob_is_not_called_merged(imager):
    rng = np.random.default_rng(5)
    for radius in (0.8, 1.0, 2.0, 4.0):
        for _ in range(40):
            found = find_spots(image([rng.uniform(25.0, 35.0, 2)], 8000.0, imager, rng, radius_px=radius), imager)
            assert found.blended.tolist() == [False]


def test_full_pixels_are_told(imager):
    rng = np.random.default_rng(6)
    assert find_spots(image([[30.0, 30.0]], 60000.0, imager, rng), imager).saturated.tolist() == [True]
    assert find_spots(image([[30.0, 30.0]], 15000.0, imager, rng), imager).saturated.tolist() == [False]


def test_a_blob_at_the_edge_is_told(imager):
    found = find_spots(image([[30.0, 0.3]], 8000.0, imager, np.random.default_rng(7)), imager)
    assert found.clipped.tolist() == [True]
    assert not found.usable.any()


def test_hot_and_dead_pixels_are_no_spots(imager):
    picture = image([[30.0, 30.0]], 8000.0, imager, np.random.default_rng(8))
    picture[10, 10] = 3000.0
    picture[50, 5] = np.nan
    assert len(find_spots(picture, imager).spots_px) == 1


@pytest.mark.parametrize("picture", [np.zeros((20, 20)), np.full((20, 20), np.nan), np.full((20, 20), 4095.0)])
def test_nothing_to_see(imager, picture):
    found = find_spots(picture, imager)
    assert found.spots_px.shape == (0, 2)
    assert found.covariance_px2.shape == (0, 2, 2)


def test_noise_alone_is_no_spot(imager):
    rng = np.random.default_rng(9)
    assert all(len(find_spots(image([], 0.0, imager, rng, (200, 200)), imager).spots_px) == 0 for _ in range(20))


def test_a_stray_light_gradient_is_borne(imager):
    picture = image([[30.0, 30.0]], 8000.0, imager, np.random.default_rng(10)) + np.linspace(0.0, 8.0, 60)
    found = find_spots(picture, imager)
    assert found.spots_px[0] == pytest.approx([30.0, 30.0], abs=0.1)


def test_from_image_to_pose(model, own):
    rng = np.random.default_rng(11)
    nees = []
    for _ in range(12):
        dcm = model.view.dcm_cam_from_target @ own.tilt(rng, 4.0)
        position = np.array([0.1, -0.1, rng.uniform(3.0, 12.0)])
        spots = project(model.markers.points_m @ dcm.T + position, model.camera).spots_px
        shown = spots + model.imager.centroid_floor_px * rng.normal(size=(3, 2))
        picture = marker_image(shown, np.full(3, 8000.0), model.imager, (1024, 1024), rng)
        result = measure_image(picture, model)
        assert result.ok
        assert sorted(result.labels) == [0, 1, 2]
        assert own.attitude_error(result.dcm_cam_from_target, dcm) < np.radians(0.5)
        error = position - result.position_m
        nees.append(error @ np.linalg.solve(result.covariance[:3, :3], error))
    assert 1.0 < np.mean(nees) < 6.0  # chi-square of 3, 12 images: 3 sigma is 2.1


def test_an_image_without_markers_has_a_status(model):
    rng = np.random.default_rng(12)
    picture = marker_image(np.empty((0, 2)), np.empty(0), model.imager, (1024, 1024), rng)
    assert measure_image(picture, model).status is relnav.Status.NOT_SEEN


def test_wrong_use(model):
    with pytest.raises(ValueError, match=r"shape \(height, width\) = \(1024, 1024\); got \(10, 10\)"):
        measure_image(np.zeros((10, 10)), model)
    with pytest.raises(ValueError, match=r"shape \(height, width\); got \(5,\)"):
        find_spots(np.zeros(5), model.imager)
