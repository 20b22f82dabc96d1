"""Images of the sun spot as the detector would give them, and the least error that any centroid of them can have.

Every point of the sun's disc throws the hole's own shape (a parallel beam keeps it on a parallel plane); the spot is
their sum, weighted by limb darkening, through dome and glass, with a Gaussian blur. Not modelled: diffraction at the
hole, thickness of the mask.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.sensors.aps_sun.rays import project
from relnav.sensors.aps_sun.sensor import ApsSunModel, SpotImage

SUN_RADIUS_RAD = 4.65e-3
"""Angular radius of the sun at 1 au."""
LIMB_DARKENING = 0.6
"""u of the linear law I = 1 - u (1 - cos theta), visible light."""
RINGS, SPOKES, SUBPIXELS = 4, 12, 2
"""Quadrature over the disc and over a pixel: within 0.06 % of the peak and 1e-5 px of finer ones."""


@dataclass(frozen=True)
class Window:
    """A read-out window: expected electrons of each pixel, without background; `corner_px` is its first (x, y)."""

    electrons: Matrix
    corner_px: tuple[int, int]


def render_spot(
    model: ApsSunModel,
    s: Vector,
    *,
    signal_e: float | None = None,
    sun_radius_rad: float = SUN_RADIUS_RAD,
    corner_px: tuple[int, int] | None = None,
) -> Window:
    """Expected image of the sun in direction s (3,), a unit vector to the disc's centre.

    The window is the read-out's, about the spot unless its corner is stated; signal_e is the model's own if left out.

    Raises
    ------
    ValueError
        If no ray comes through from there.
    """
    image = model.image
    centre = project(model, s)
    if not np.all(np.isfinite(centre)):
        raise ValueError(f"no light comes through the hole from {np.asarray(s).tolist()}")
    size = image.window_px
    corner = corner_px
    if corner is None:
        corner = (int(np.rint(centre[0])) - size // 2, int(np.rint(centre[1])) - size // 2)
    points, weights = sun_disc(s, sun_radius_rad)
    shape = _disc_on_pixels(project(model, points) - np.array(corner), weights, image, model.sensor.pixel_pitch_m)
    return Window(shape * (image.signal_e if signal_e is None else signal_e), corner)


def read_out(window: Window, image: SpotImage, rng: np.random.Generator) -> Matrix:
    """Counts of one exposure: shot noise, uneven response, read noise, whole counts up to full scale."""
    expected = window.electrons + image.background_e
    electrons = rng.poisson(expected) * (1.0 + image.response_nonuniformity * rng.normal(size=expected.shape))
    electrons = electrons + image.read_noise_e * rng.normal(size=expected.shape)
    counts: Matrix = np.clip(np.rint(electrons / image.electrons_per_count), 0, image.full_scale)
    return counts


def centroid_bound(window: Window, image: SpotImage) -> Matrix:
    """Cramer-Rao bound (2, 2) px^2 of the spot's place, with flux and background unknown.

    F = sum_i (d mu_i)(d mu_i)^T / var_i, var = mu + read noise^2 + (response mu)^2 + quantisation.
    """
    spot = window.electrons
    slope_y, slope_x = np.gradient(spot)
    parts = np.stack([slope_x, slope_y, spot / spot.sum(), np.ones_like(spot)]).reshape(4, -1)
    mean = (spot + image.background_e).ravel()
    variance = mean + image.read_noise_e**2 + (image.response_nonuniformity * spot.ravel()) ** 2
    variance = variance + image.electrons_per_count**2 / 12.0
    bound: Matrix = np.linalg.inv((parts / variance) @ parts.T)[:2, :2]
    return bound


def sun_disc(s: Vector, radius_rad: float) -> tuple[Matrix, Vector]:
    """Directions (RINGS x SPOKES, 3) over the sun's disc about s (3,) and their weights, sum 1."""
    nodes, node_weights = np.polynomial.legendre.leggauss(RINGS)
    area, area_weights = 0.5 * (nodes + 1.0), 0.5 * node_weights  # over r^2: equal areas
    brightness = 1.0 - LIMB_DARKENING * (1.0 - np.sqrt(1.0 - area))
    turn = 2.0 * np.pi * (np.arange(SPOKES)[None, :] + 0.5 * (np.arange(RINGS)[:, None] % 2)) / SPOKES
    s = np.asarray(s, dtype=np.float64)
    across = np.cross(s, [0.0, 1.0, 0.0] if abs(s[1]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    radius = np.tan(radius_rad * np.sqrt(area))[:, None, None]
    points = s + radius * (np.cos(turn)[..., None] * across + np.sin(turn)[..., None] * np.cross(s, across))
    points = points.reshape(-1, 3)
    weights = np.repeat(area_weights * brightness / SPOKES, SPOKES)
    return points / np.linalg.norm(points, axis=1, keepdims=True), weights / weights.sum()


def _disc_on_pixels(centres: Matrix, weights: Vector, image: SpotImage, pitch_m: float) -> Matrix:
    """Share of the light in each pixel: blurred discs about centres (n, 2) px of the window, summed with weights."""
    from scipy.special import erfc

    radius = image.hole_radius_m / pitch_m
    nodes, node_weights = np.polynomial.legendre.leggauss(SUBPIXELS)
    places = (np.arange(image.window_px)[:, None] + 0.5 * nodes).ravel()
    dx2 = (places[None, :] - centres[:, 0, None]) ** 2
    dy2 = (places[None, :] - centres[:, 1, None]) ** 2
    fine = np.zeros((len(places), len(places)))
    for k, weight in enumerate(weights):
        rho = np.sqrt(dy2[k][:, None] + dx2[k][None, :])
        fine += weight * 0.5 * erfc((rho - radius) / (np.sqrt(2.0) * image.blur_px))
    quadrature = np.tile(0.5 * node_weights, image.window_px)
    fine *= quadrature[:, None] * quadrature[None, :]
    shares: Matrix = fine.reshape(image.window_px, SUBPIXELS, image.window_px, SUBPIXELS).sum(axis=(1, 3))
    return shares / (np.pi * (radius**2 + image.blur_px**2))
