"""Images of the sun spot: energy, place, size, symmetry, noise, and a bound that no other spot shape explains."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.sensors.aps_sun.rays import project
from relnav.sensors.birefringent_sun.spots import project as two_spots
from relnav.simulation.sun_spot import Window, centroid_bound, read_out, render_spot, render_two_spots, sun_disc


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("aps_sun")


def direction(alpha_deg, beta_deg):
    t = np.tan(np.radians([alpha_deg, beta_deg]))
    return np.array([*t, 1.0]) / np.sqrt(1.0 + t @ t)


def moments(image):
    """Sum, centre (x, y), and variance of x and of y."""
    total, n = image.sum(), np.arange(len(image))
    px, py = image.sum(axis=0) / total, image.sum(axis=1) / total
    x, y = px @ n, py @ n
    return total, np.array([x, y]), np.array([px @ (n - x) ** 2, py @ (n - y) ** 2])


@pytest.mark.parametrize("angles", [(0.0, 0.0), (60.0, 0.0), (-60.0, 60.0)])
def test_all_the_light_is_in_the_window_at_the_spots_place(model, angles):
    """The disc's centre of light lies where the ray trace has it, and outward by up to 0.03 px at the corner."""
    window = render_spot(model, direction(*angles), signal_e=1e4)
    total, centre, _ = moments(window.electrons)
    assert total == pytest.approx(1e4, rel=3e-5)
    offset = centre + window.corner_px - project(model, direction(*angles))
    assert np.abs(offset).max() < 0.03


def test_variance_is_that_of_hole_sun_and_blur(model):
    """On axis: R^2/4 of a disc, the sun's times its h, the blur and 1/12 of a pixel."""
    image = model.image
    _, _, variance = moments(render_spot(model, direction(0.0, 0.0)).electrons)
    radius = image.hole_radius_m / model.sensor.pixel_pitch_m
    h = model.sensor.paraxial_height_m / model.sensor.pixel_pitch_m
    u, a = 0.6, 4.65e-3 * h
    mean_r2 = (
        a**2 * (0.5 - u * (0.5 - 4.0 / 15.0)) / (1.0 - u / 3.0)
    )  # limb darkening: int r^3 (1 - u + u sqrt(1 - r^2))
    expected = radius**2 / 4.0 + mean_r2 / 2.0 + image.blur_px**2 + 1.0 / 12.0
    np.testing.assert_allclose(variance, expected, rtol=0.02)


def test_the_suns_disc_stretches_the_spot_away_from_the_axis(model):
    _, _, near = moments(render_spot(model, direction(0.0, 0.0)).electrons)
    _, _, far = moments(render_spot(model, direction(60.0, 0.0)).electrons)
    assert far[0] > near[0] + 0.5
    assert far[0] > far[1] + 0.3
    _, _, point = moments(render_spot(model, direction(60.0, 0.0), sun_radius_rad=1e-9).electrons)
    np.testing.assert_allclose(point[0], point[1], rtol=1e-3)


def test_the_disc_is_centred_and_of_its_radius():
    s = direction(30.0, -20.0)
    points, weights = sun_disc(s, 4.65e-3)
    assert weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-14)
    centre = weights @ points
    np.testing.assert_allclose(centre / np.linalg.norm(centre), s, atol=1e-8)
    away = np.arccos(np.clip(points @ s, -1.0, 1.0))
    assert 0.9 * 4.65e-3 < away.max() < 4.65e-3


def test_read_out_has_its_moments(model):
    image = replace(model.image, response_nonuniformity=0.0)
    window = Window(np.full((100, 100), 5000.0), (0, 0))
    counts = read_out(window, image, np.random.default_rng(0))
    gain = image.electrons_per_count
    assert counts.mean() * gain == pytest.approx(5000.0 + image.background_e, rel=2e-3)
    assert counts.var() * gain**2 == pytest.approx(5050.0 + 900.0 + gain**2 / 12.0, rel=0.06)
    assert read_out(Window(np.full((8, 8), 1e6), (0, 0)), image, np.random.default_rng(0)).max() == image.full_scale
    assert (
        read_out(Window(np.zeros((8, 8)), (0, 0)), replace(image, background_e=0.0), np.random.default_rng(0)).min()
        == 0
    )


def test_the_bound_is_that_of_a_gaussian_spot(model):
    """Photon noise alone, a spot of width w: w^2 / N (a textbook case)."""
    image = replace(model.image, background_e=0.0, read_noise_e=1e-3, response_nonuniformity=0.0, full_scale_e=1.0)
    n, w = np.arange(40), 4.0
    spot = np.exp(-((n - 19.3) ** 2) / (2 * w * w))
    spot = 1e6 * np.outer(spot, spot) / spot.sum() ** 2
    bound = centroid_bound(Window(spot + 1e-6, (0, 0)), image)
    np.testing.assert_allclose(np.diag(bound), w * w / 1e6, rtol=0.03)
    assert abs(bound[0, 1]) < 1e-3 * bound[0, 0]


def test_no_light(model):
    with pytest.raises(ValueError, match="no light comes through the hole"):
        render_spot(model, np.array([0.6, 0.0, -0.8]))


@pytest.fixture(scope="module")
def crystal():
    return relnav.load_model("birefringent_sun")


@pytest.mark.parametrize("light_filter", ["hole", "dot", "lens"])
def test_from_an_image_of_two_spots_to_the_direction(crystal, light_filter):
    """The patent's three filters: 25 images each, right to 12 arcsec, errors as their covariances say."""
    sensor = replace(
        crystal.sensor,
        light_filter=light_filter,
        air_path_m=1e-3 if light_filter == "lens" else 0.0,
        detector_size_px=(2048, 2048),
        zero_spot_px=(1023.5, 1023.5),
    )
    model, rng, nees = replace(crystal, sensor=sensor), np.random.default_rng(6), []
    for alpha, beta in rng.uniform(-40.0, 40.0, (25, 2)):
        s = direction(alpha, beta)
        window = render_two_spots(model, s)
        seen = relnav.birefringent_sun.measure(read_out(window, model.image, rng), model, corner_px=window.corner_px)
        assert seen.ok
        assert np.degrees(np.linalg.norm(seen.direction - s)) * 3600.0 < 15.0
        error = (s - seen.direction)[:2]
        nees.append(error @ np.linalg.solve(seen.covariance[:2, :2], error))
    assert 0.9 < np.mean(nees) < 3.6


def test_two_spots_share_the_light_and_stand_where_they_should(crystal):
    s = direction(20.0, -30.0)
    window = render_two_spots(crystal, s)
    assert window.electrons.sum() == pytest.approx(crystal.image.signal_e, rel=1e-4)
    spots = two_spots(crystal.sensor, s)
    middle = 0.5 * spots.sum(axis=0) - window.corner_px
    _, centre, _ = moments(window.electrons)
    np.testing.assert_allclose(centre, middle, atol=0.05 * np.linalg.norm(spots[1] - spots[0]))


def test_an_image_without_two_spots(crystal):
    s = direction(5.0, 5.0)
    window = render_two_spots(crystal, s)
    counts = read_out(window, crystal.image, np.random.default_rng(0))
    measure = relnav.birefringent_sun.measure
    assert measure(np.zeros((50, 50)), crystal).status is relnav.Status.NOT_SEEN
    spots = two_spots(crystal.sensor, s) - window.corner_px
    between = int(np.rint(spots[:, 0].mean()))
    assert measure(counts[:, :between], crystal, corner_px=window.corner_px).status is relnav.Status.NOT_SEEN
    cut = int(np.rint(spots[:, 0].max()))
    assert measure(counts[:, :cut], crystal, corner_px=window.corner_px).status is relnav.Status.AT_EDGE
    full = np.minimum(counts * 20.0, crystal.image.full_scale)
    assert measure(full, crystal, corner_px=window.corner_px).status is relnav.Status.SATURATED


def test_two_spots_that_cannot_be_drawn(crystal):
    with pytest.raises(ValueError, match="no light comes through the crystal"):
        render_two_spots(crystal, np.array([0.6, 0.0, -0.8]))
    small = replace(crystal, image=replace(crystal.image, window_px=64))
    with pytest.raises(ValueError, match="do not fit a window of 64 px"):
        render_two_spots(small, direction(0.0, 0.0))
