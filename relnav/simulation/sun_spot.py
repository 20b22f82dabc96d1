"""Images of the sun spot as the detector would give them, and the least error that any centroid of them can have.

Every point of the sun's disc throws the hole's own shape (a parallel beam keeps it on a parallel plane); the spot is
their sum, weighted by limb darkening, through dome and glass, with a Gaussian blur. Not modelled: diffraction at the
hole, thickness of the mask.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.sensors.aps_sun.rays import project
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.birefringent_sun.polarised import unpolarised_shares
from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel
from relnav.sensors.birefringent_sun.spots import project as project_two
from relnav.sensors.spot_centroid import SpotImage

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
    spots = project(model, points) - np.array(corner)
    shape = _disc_on_pixels(spots, weights, image, model.sensor.pixel_pitch_m, size)
    return Window(shape * (image.signal_e if signal_e is None else signal_e), corner)


def render_two_spots(model: BirefringentSunModel, s: Vector, *, sun_radius_rad: float = SUN_RADIUS_RAD) -> Window:
    """Expected image of the sun's two spots in a birefringent sensor, s (3,) a unit vector to the disc's centre.

    The light that enters the crystal is shared between them as for sunlight. Behind a dot both are shadows of as many
    electrons in a background that is even.

    Raises
    ------
    ValueError
        If the sun stands behind the sensor, or the two spots do not fit the window.
    """
    image, sensor = model.image, model.sensor
    centres = project_two(sensor, s)
    if not np.all(np.isfinite(centres)):
        raise ValueError(f"no light comes through the crystal from {np.asarray(s).tolist()}")
    size = image.window_px
    middle = np.rint(centres.mean(axis=0)).astype(np.int64)
    corner = middle - size // 2
    points, weights = sun_disc(s, sun_radius_rad)
    spots = project_two(sensor, points)
    share = unpolarised_shares(sensor, np.asarray(s, dtype=np.float64))
    electrons = np.zeros((size, size))
    for k in range(2):
        spread = np.abs(spots[:, k] - centres[k]).max() + image.hole_radius_m / sensor.pixel_pitch_m
        half = int(np.ceil(spread + 5.0 * image.blur_px)) + 1
        low = np.rint(centres[k]).astype(np.int64) - half
        begin = low - corner
        if np.any(begin < 0) or np.any(begin + 2 * half > size):
            raise ValueError(f"the two spots of {np.asarray(s).tolist()} do not fit a window of {size} px")
        part = _disc_on_pixels(spots[:, k] - low, weights, image, sensor.pixel_pitch_m, 2 * half)
        rows, columns = slice(begin[1], begin[1] + 2 * half), slice(begin[0], begin[0] + 2 * half)
        electrons[rows, columns] += image.signal_e * share[k] / share.sum() * part
    if sensor.light_filter == "dot":
        electrons = 1.2 * electrons.max() - electrons
    return Window(electrons, (int(corner[0]), int(corner[1])))


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


def _disc_on_pixels(centres: Matrix, weights: Vector, image: SpotImage, pitch_m: float, size: int) -> Matrix:
    """Share of the light in each pixel of a square: blurred discs about centres (n, 2) px, summed with weights."""
    from scipy.special import erfc

    radius = image.hole_radius_m / pitch_m
    nodes, node_weights = np.polynomial.legendre.leggauss(SUBPIXELS)
    places = (np.arange(size)[:, None] + 0.5 * nodes).ravel()
    dx2 = (places[None, :] - centres[:, 0, None]) ** 2
    dy2 = (places[None, :] - centres[:, 1, None]) ** 2
    fine = np.zeros((len(places), len(places)))
    for k, weight in enumerate(weights):
        rho = np.sqrt(dy2[k][:, None] + dx2[k][None, :])
        fine += weight * 0.5 * erfc((rho - radius) / (np.sqrt(2.0) * image.blur_px))
    quadrature = np.tile(0.5 * node_weights, size)
    fine *= quadrature[:, None] * quadrature[None, :]
    shares: Matrix = fine.reshape(size, SUBPIXELS, size, SUBPIXELS).sum(axis=(1, 3))
    return shares / (np.pi * (radius**2 + image.blur_px**2))
