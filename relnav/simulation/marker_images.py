"""Images of markers: round blobs spread over pixels, with shot noise, read noise, quantisation and full pixels."""

import numpy as np
from scipy.special import ndtr

from relnav.arrays import Matrix, Vector
from relnav.sensors.three_marker.sensor import Imager


def marker_image(
    spots_px: Matrix,
    flux_dn: Vector,
    imager: Imager,
    image_size_px: tuple[int, int],
    rng: np.random.Generator,
    *,
    background_dn: float = 20.0,
    radius_px: float | None = None,
) -> Matrix:
    """Image (height, width) dn of Gaussian blobs, each integrated over every pixel.

    Parameters
    ----------
    spots_px : (k, 2)
        Centres; NaN rows are not drawn.
    flux_dn : (k,)
        Total of each blob, dn.
    imager : Imager
        Blob radius, noise and saturation.
    image_size_px : (2,)
        Width and height.
    rng : Generator
        Of the noise.
    background_dn : float
        Even light, with its own shot noise.
    radius_px : float, optional
        1-sigma radius of the blobs where it is not the imager's: a near marker is wide.
    """
    width, height = image_size_px
    sigma = imager.spot_sigma_px if radius_px is None else radius_px
    mean = np.full((height, width), background_dn)
    for (x, y), flux in zip(np.asarray(spots_px), np.asarray(flux_dn), strict=True):
        if not np.isfinite([x, y]).all():
            continue
        along_x = np.diff(ndtr((np.arange(width + 1) - 0.5 - x) / sigma))
        along_y = np.diff(ndtr((np.arange(height + 1) - 0.5 - y) / sigma))
        mean += flux * along_y[:, None] * along_x[None, :]
    electrons = rng.poisson(mean * imager.electrons_per_dn)
    noisy = electrons / imager.electrons_per_dn + rng.normal(size=mean.shape) * imager.read_noise_dn
    image: Matrix = np.clip(np.round(noisy), 0.0, imager.saturation_dn)
    return image
