"""The centre of a sun spot in an image: the patent's centre of gravity, and one that states its own error.

The patent sums everything above a threshold. Counts that stand on a background or on the threshold itself pull the
centre toward the middle of the window, by up to 0.028 px at a threshold of 10 %; here both are subtracted.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import ArrayLike

from relnav.arrays import Flags, Matrix, numbers
from relnav.sensors.measurement import Status

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]
THRESHOLD = 0.05
"""Of the peak above the background: what is subtracted. More costs light, less lets noise in."""
NOISE_SIGMAS = 2.0
SEEN_SIGMAS = 6.0
MOST_SATURATED = 0.2
SHAPE_ERROR_PX = 0.003
"""1-sigma of what the subtracted threshold leaves, over the spot's place within a pixel (up to 0.006 px)."""


@dataclass(frozen=True)
class SpotImage:
    """Hole, exposure and read-out, from which an image of the spot follows.

    Attributes
    ----------
    hole_radius_m, blur_px : float
        Radius of the hole; Gaussian 1-sigma of what else blurs the spot.
    signal_e, background_e, read_noise_e : float
        Electrons of the whole spot; of the background and 1-sigma of the read-out in each pixel.
    response_nonuniformity : float
        1-sigma of the pixels' relative response.
    bits, full_scale_e : int, float
        Read-out: `full_scale_e` electrons read 2^bits - 1.
    window_px : int
        Side of the read-out window.
    """

    hole_radius_m: Positive
    blur_px: Positive
    signal_e: Positive
    background_e: NonNegative
    read_noise_e: Positive
    response_nonuniformity: Annotated[float, Ge(0.0), Lt(0.2)]
    bits: Annotated[int, Ge(6), Le(16)]
    full_scale_e: Positive
    window_px: Annotated[int, Ge(8), Le(256)]

    @property
    def full_scale(self) -> int:
        """The largest count."""
        return int(2**self.bits - 1)

    @property
    def electrons_per_count(self) -> float:
        """Conversion gain."""
        return self.full_scale_e / self.full_scale


@dataclass(frozen=True)
class Spot:
    """Centre of a sun spot.

    Attributes
    ----------
    x_px, y_px : float
        Column and row of the centre, 0-based, pixel centres are integers; NaN unless `status` is OK.
    covariance_px2 : (2, 2)
        NaN unless `status` is OK.
    flux_e : float
        Electrons above background and threshold.
    status : Status
        OK, NOT_SEEN, SATURATED or AT_EDGE.
    """

    x_px: float
    y_px: float
    covariance_px2: Matrix
    flux_e: float
    status: Status

    @property
    def ok(self) -> bool:
        """Whether centre and covariance can be used."""
        return self.status is Status.OK


def centroid_patent(image: ArrayLike, threshold: float = 0.0) -> tuple[float, float]:
    """Centre (x, y) px as the patent's first step has it: sum(x g)/sum(g) over all pixels with g above the threshold.

    NaN if none is.
    """
    g = _checked(image)
    g = np.where(g > threshold, g, 0.0)
    total = float(g.sum())
    if total == 0.0:
        return math.nan, math.nan
    return float(g.sum(axis=0) @ np.arange(g.shape[1]) / total), float(g.sum(axis=1) @ np.arange(g.shape[0]) / total)


def centroid(
    image: ArrayLike,
    readout: SpotImage,
    *,
    threshold: float = THRESHOLD,
    background: float | None = None,
    dark: bool = False,
) -> Spot:
    """Centre of the brightest spot of a window, with covariance.

    Parameters
    ----------
    image : (rows, columns)
        Counts.
    readout : SpotImage
        Read-out of the detector: gain, noise, full scale.
    threshold : float
        Subtracted, as a share of the peak; more where the noise asks for it.
    background : float, optional
        Counts; the median of the window's border if left out.
    dark : bool
        The shadow of a dot on a bright background, instead of the light of a hole.

    Returns
    -------
    Spot
        With status NOT_SEEN if no pixel stands out of the noise, SATURATED if more than a fifth of the spot is at full
        scale, AT_EDGE if the spot touches the window's border.

    Raises
    ------
    ValueError
        For an image that is not two-dimensional, finite and 4 px or more on each side, or a threshold outside 0 to 0.9.
    """
    return centroids(image, readout, 1, threshold=threshold, background=background, dark=dark)[0]


def centroids(
    image: ArrayLike,
    readout: SpotImage,
    count: int,
    *,
    threshold: float = THRESHOLD,
    background: float | None = None,
    dark: bool = False,
) -> tuple[Spot, ...]:
    """Centres of the `count` brightest separate spots of a window, brightest first; parameters as of `centroid`."""
    if not 0.0 <= threshold <= 0.9:
        raise ValueError(f"threshold is a share of the peak between 0 and 0.9; got {threshold}")
    g = _checked(image)
    border = np.concatenate([g[0], g[-1], g[1:-1, 0], g[1:-1, -1]])
    level = float(np.median(border)) if background is None else background
    signal = level - g if dark else g - level
    gain = readout.electrons_per_count
    quiet = math.sqrt(readout.read_noise_e**2 + max(level, 0.0) * gain) / gain + 1.0 / math.sqrt(12.0)
    found = []
    for _ in range(count):
        row, column = (int(k) for k in np.unravel_index(int(np.argmax(signal)), g.shape))
        peak = float(signal[row, column])
        if not peak > SEEN_SIGMAS * quiet:
            found.append(_none(Status.NOT_SEEN))
            continue
        cut = max(threshold * peak, NOISE_SIGMAS * quiet)
        used = _joined(signal > cut, row, column)
        found.append(_centre(g, signal, used, cut, readout))
        signal = np.where(used, 0.0, signal)
    return tuple(found)


def _centre(g: Matrix, signal: Matrix, used: Flags, cut: float, readout: SpotImage) -> Spot:
    """Centre of the pixels `used`, with the threshold subtracted."""
    rows, columns = np.indices(g.shape)
    weight = np.where(used, signal - cut, 0.0)
    total = float(weight.sum())
    x, y = float(np.sum(weight * columns)) / total, float(np.sum(weight * rows)) / total
    if np.any(used[[0, -1], :]) or np.any(used[:, [0, -1]]):
        return _none(Status.AT_EDGE)
    if np.mean(g[used] >= readout.full_scale) > MOST_SATURATED:
        return _none(Status.SATURATED)
    gain = readout.electrons_per_count
    variance = (readout.read_noise_e**2 + np.maximum(g, 0.0) * gain) / gain**2 + 1.0 / 12.0
    variance = np.where(used, variance + (readout.response_nonuniformity * signal) ** 2, 0.0)
    arm = np.stack([columns - x, rows - y])
    covariance = np.einsum("iab,jab,ab->ij", arm, arm, variance) / total**2 + SHAPE_ERROR_PX**2 * np.eye(2)
    covariance.setflags(write=False)
    return Spot(x, y, covariance, total * gain, Status.OK)


def _none(status: Status) -> Spot:
    return Spot(math.nan, math.nan, np.full((2, 2), math.nan), math.nan, status)


def _joined(mask: Flags, row: int, column: int) -> Flags:
    """The part of a mask that hangs together with one pixel."""
    from scipy.ndimage import label

    parts, _ = label(mask)
    joined: Flags = parts == parts[row, column]
    return joined


def _checked(image: ArrayLike) -> Matrix:
    g = numbers("image", image)
    if g.ndim != 2 or min(g.shape) < 4 or not np.all(np.isfinite(g)):
        raise ValueError(f"an image has two axes (rows, columns) of 4 px or more, finite counts; got shape {g.shape}")
    return g
