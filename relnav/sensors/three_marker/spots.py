"""From an image to spots: threshold, centroid with covariance, and which spots are not to be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector, numbers
from relnav.sensors.three_marker.sensor import Imager

_RIM = 0.5  # of the threshold: pixels above it that touch one above the threshold are of the same blob
_MARGIN_PX = 2  # pixels around those that belong to a spot as well: its faint rim
_ELONGATION = 1.25  # of the squared radii along and across: a round blob has 1, two equal ones 1.1 sigma apart 1.3
_HOT_PIXEL = 0.3  # of the brightest pixel: its eight neighbours together hold more in any image that a lens makes
_QUANTISATION_DN = 12.0**-0.5
_LEAST_DIP = 5.0  # noise sigmas by which a second peak must stand out


@dataclass(frozen=True)
class Spots:
    """The spots of one image, the brightest first.

    Attributes
    ----------
    spots_px : (k, 2)
        Centroids x, y; pixel (0, 0) has its centre at (0.0, 0.0).
    covariance_px2 : (k, 2, 2)
        Of each centroid, from read noise, shot noise, quantisation and the imager's centroid floor.
    flux_dn : (k,)
        Sum above the background.
    radius_px : (k,)
        Root of the mean of the squared radii along and across, 1-sigma.
    saturated, blended, clipped : (k,)
        A pixel is saturated; the blob is not round or has several peaks (two markers, or motion); it touches the
        image's edge. The covariance of such a spot is not to be trusted. Two blobs less than about 1.5 of their 1-sigma
        radii apart look like one round one and are not recognised.
    """

    spots_px: Matrix
    covariance_px2: Stack
    flux_dn: Vector
    radius_px: Vector
    saturated: Flags
    blended: Flags
    clipped: Flags

    @property
    def usable(self) -> Flags:
        """Neither saturated, blended nor clipped, (k,)."""
        return ~(self.saturated | self.blended | self.clipped)


@dataclass(frozen=True)
class _Blob:
    centre: Vector
    covariance: Matrix
    flux: float
    radius: float
    saturated: bool
    blended: bool
    clipped: bool


def find_spots(image_dn: ArrayLike, imager: Imager) -> Spots:
    """Spots on an image, each with its covariance and its flags.

    Parameters
    ----------
    image_dn : (height, width)
        Digital numbers; pixels that are not finite are dead: they take the background's value.
    imager : Imager
        Noise, saturation and threshold, as in `model.imager`.

    Returns
    -------
    Spots

    Raises
    ------
    ValueError
        If the image is not two-dimensional.
    """
    from scipy import ndimage  # as late as this: who only loads a model has no image

    image = numbers("image_dn", image_dn).copy()
    if image.ndim != 2 or image.size == 0:
        raise ValueError(f"image_dn has shape (height, width); got {image.shape}")
    background, noise = _background(image, imager)
    image[~np.isfinite(image)] = background
    signal = image - background
    level = imager.threshold_sigma * noise
    labels = np.zeros(image.shape, dtype=np.int64)
    ndimage.label(signal > _RIM * level, np.ones((3, 3), dtype=bool), output=labels)
    seen = np.unique(labels[signal > level])
    labels[~np.isin(labels, seen)] = 0
    boxes = ndimage.find_objects(labels)
    found = [_measure_blob(image, signal, labels, int(k), boxes[k - 1], noise, imager) for k in seen]
    blobs = sorted((blob for blob in found if blob is not None), key=lambda blob: -blob.flux)
    return Spots(
        np.array([blob.centre for blob in blobs]).reshape(-1, 2),
        np.array([blob.covariance for blob in blobs]).reshape(-1, 2, 2),
        np.array([blob.flux for blob in blobs]),
        np.array([blob.radius for blob in blobs]),
        np.array([blob.saturated for blob in blobs], dtype=bool),
        np.array([blob.blended for blob in blobs], dtype=bool),
        np.array([blob.clipped for blob in blobs], dtype=bool),
    )


def _background(image: Matrix, imager: Imager) -> tuple[float, float]:
    """Level of the dark pixels, and their noise: of the image itself where that is more than the read noise."""
    pixels = image[np.isfinite(image)]
    floor = float(np.hypot(imager.read_noise_dn, _QUANTISATION_DN))
    if pixels.size == 0:
        return 0.0, floor
    level = float(np.median(pixels))
    width = 1.4826 * float(np.median(np.abs(pixels - level)))
    dark = pixels[np.abs(pixels - level) < 4.0 * max(width, floor)]
    return float(dark.mean()), max(floor, float(dark.std()))


def _measure_blob(
    image: Matrix, signal: Matrix, labels: Codes, k: int, place: tuple[slice, ...], noise: float, imager: Imager
) -> _Blob | None:
    """Centroid, moments and flags of blob k; None for a hot pixel."""
    from scipy import ndimage

    height, width = image.shape
    rows = slice(max(0, place[0].start - _MARGIN_PX), min(height, place[0].stop + _MARGIN_PX))
    columns = slice(max(0, place[1].start - _MARGIN_PX), min(width, place[1].stop + _MARGIN_PX))
    core = labels[rows, columns] == k
    others = (labels[rows, columns] != 0) & ~core
    window = ndimage.binary_dilation(core, iterations=_MARGIN_PX, structure=np.ones((3, 3), dtype=bool)) & ~others
    y, x = np.nonzero(window)
    s = signal[rows, columns][window]
    flux = float(s.sum())
    if not flux > 0.0:
        return None
    at = np.stack([x + columns.start, y + rows.start], axis=-1).astype(np.float64)
    centre = s @ at / flux
    d = at - centre
    variance = noise**2 + np.maximum(s, 0.0) / imager.electrons_per_dn
    covariance = (d * variance[:, None]).T @ d / flux**2 + imager.centroid_floor_px**2 * np.eye(2)
    moments = (d * s[:, None]).T @ d / flux
    peak = int(np.argmax(s))
    beside = np.abs(at - at[peak]).max(axis=1) == 1.0
    if not float(s[beside].sum()) > _HOT_PIXEL * float(s[peak]):
        return None
    (across, along), axes = np.linalg.eigh(moments)
    spread = d @ axes
    excess = spread[:, 1] ** 2 - along - _ELONGATION * (spread[:, 0] ** 2 - across)
    excess_sigma = float(np.sqrt(excess**2 @ variance)) / flux
    elongated = along - _ELONGATION * across > 4.0 * excess_sigma
    return _Blob(
        centre,
        covariance,
        flux,
        float(np.sqrt(0.5 * moments.trace())),
        bool((image[rows, columns][core] >= imager.saturation_dn).any()),
        bool(elongated) or bool(others.any()) or _has_several_peaks(signal[rows, columns], core, variance.max()),
        place[0].start == 0 or place[1].start == 0 or place[0].stop == height or place[1].stop == width,
    )


def _has_several_peaks(signal: Matrix, core: Flags, variance: float) -> bool:
    """Whether a blob has two peaks with a dip between them that noise does not explain."""
    from scipy import ndimage

    dip = _LEAST_DIP * float(np.sqrt(variance))
    top = float(signal[core].max())
    for level in np.linspace(top - dip, dip, 8):
        islands, count = ndimage.label(core & (signal > level), structure=np.ones((3, 3)))
        if count < 2:
            continue
        heights = ndimage.maximum(signal, islands, index=np.arange(1, count + 1))
        if np.sum(np.asarray(heights) > level + dip) > 1:
            return True
    return False
