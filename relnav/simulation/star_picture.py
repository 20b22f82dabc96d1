"""Pictures of the sky: round Gaussian stars over pixels, sky and stray light, shot and read noise, hot, full pixels."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from relnav.arrays import Matrix, Vector

REACH = 6.0
"""Sigmas of a blob that are drawn."""


@dataclass(frozen=True)
class Exposure:
    """How a picture is taken.

    Attributes
    ----------
    radius_px : float
        1-sigma of a star's blob.
    zero_point : float
        Magnitude of a star of one count.
    sky_counts, read_noise_counts, electrons_per_count : float
        Even light of each pixel, 1-sigma of the read-out, and gain.
    hot_pixels : float
        Share of the pixels that read anything up to full.
    bits : int
        Counts go up to 2^bits - 1.
    stray_counts : (2,)
        Mean stray light of a pixel that gets past each baffle: of the first it falls off evenly from the left edge
        (twice the mean) to the right (none), of the second from top to bottom.
    """

    radius_px: float = 1.2
    zero_point: float = 15.0
    sky_counts: float = 150.0
    read_noise_counts: float = 6.0
    electrons_per_count: float = 2.0
    hot_pixels: float = 2e-5
    bits: int = 16
    stray_counts: tuple[float, float] = (0.0, 0.0)

    def flux(self, magnitude: Vector) -> Vector:
        """Counts (n,) of stars of given magnitudes (n,)."""
        counts: Vector = 10.0 ** (0.4 * (self.zero_point - magnitude))
        return counts

    def dark(self, size_px: tuple[int, int]) -> Matrix:
        """Mean counts (rows, columns) of a picture without stars: sky and stray light."""
        width, height = size_px
        across, down = (2.0 - (2.0 * np.arange(side) + 1.0) / side for side in (width, height))
        mean: Matrix = self.sky_counts + self.stray_counts[0] * across + self.stray_counts[1] * down[:, None]
        return mean


def picture_of(
    spots_px: Matrix, flux: Vector, size_px: tuple[int, int], exposure: Exposure, rng: np.random.Generator
) -> Matrix:
    """Counts (rows, columns) of a picture of spots (n, 2), from its centre, x right, y down, with fluxes (n,)."""
    width, height = size_px
    mean = exposure.dark(size_px)
    half = int(np.ceil(REACH * exposure.radius_px)) + 1
    centre = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
    for (x, y), counts in zip(spots_px + centre, flux, strict=True):
        columns = np.arange(max(0, round(x) - half), min(width, round(x) + half + 1))
        rows = np.arange(max(0, round(y) - half), min(height, round(y) + half + 1))
        if len(columns) and len(rows):
            across = ndtr((columns + 0.5 - x) / exposure.radius_px) - ndtr((columns - 0.5 - x) / exposure.radius_px)
            down = ndtr((rows + 0.5 - y) / exposure.radius_px) - ndtr((rows - 0.5 - y) / exposure.radius_px)
            mean[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] += counts * down[:, None] * across
    full = 2.0**exposure.bits - 1.0
    counts = rng.poisson(mean * exposure.electrons_per_count) / exposure.electrons_per_count
    counts = counts + rng.normal(size=mean.shape) * exposure.read_noise_counts
    hot = rng.random(mean.shape) < exposure.hot_pixels
    counts[hot] += full * rng.random(int(hot.sum()))
    picture: Matrix = np.clip(np.rint(counts), 0.0, full)
    return picture
