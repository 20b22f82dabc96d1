"""Images of the sun spot: energy, place, size, symmetry, noise, and a bound that no other spot shape explains."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.sensors.aps_sun.rays import project
from relnav.simulation.sun_spot import Window, centroid_bound, read_out, render_spot, sun_disc


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
