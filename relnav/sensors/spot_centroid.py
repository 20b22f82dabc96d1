"""The centre of a sun spot in an image: the patent's centre of gravity, and one that states its own error.

The patent sums everything above a threshold. Counts that stand on a background or on the threshold itself pull the
centre toward the middle of the window, by up to 0.028 px at a threshold of 10 %; here both are subtracted. A background
that slopes pulls it along the slope: its plane is taken from the window's border, and what it is not known to is in the
covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import ArrayLike

from relnav.arrays import Codes, Matrix, Vector, numbers, one_piece
from relnav.codegen.kernel import entry, kernel
from relnav.sensors.measurement import OK, Status

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]
THRESHOLD = 0.05
"""Of the peak above the background: what is subtracted. More costs light, less lets noise in."""
NOISE_SIGMAS = 2.0
SEEN_SIGMAS = 6.0
MOST_SATURATED = 0.2
SHAPE_ERROR_PX = 0.003
"""1-sigma of what the subtracted threshold leaves, over the spot's place within a pixel (up to 0.006 px)."""
SHAPE_VARIANCE_PX2 = SHAPE_ERROR_PX**2
NOT_SEEN, SATURATED, AT_EDGE = int(Status.NOT_SEEN), int(Status.SATURATED), int(Status.AT_EDGE)
_NO_IMAGE = "an image has two axes (rows, columns) of 4 px or more, finite counts; got shape {}"
ORIGIN = (0.0, 0.0)
"""Corner of a window that is the whole detector."""


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
    g = _two_axes(image)
    if not np.isfinite(g).all():
        raise ValueError(_NO_IMAGE.format(g.shape))
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
        Subtracted, as a share of the peak; more if the noise requires it.
    background : float, optional
        Counts; a plane through the window's border if left out, robust against spots on it.
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
    g = _two_axes(image)
    noise = np.array([readout.electrons_per_count, readout.read_noise_e, readout.response_nonuniformity])
    levels = np.array([math.nan if background is None else background, threshold, readout.full_scale])
    signal, queue = np.empty(g.shape), np.empty(g.size, dtype=np.int64)
    border, plane, out = np.empty(2 * sum(g.shape) - 4), np.zeros(5), np.empty((count, 7))
    if not spots_into(g, noise, levels, -1.0 if dark else 1.0, border, plane, signal, queue, out):
        raise ValueError(_NO_IMAGE.format(g.shape))
    return tuple(map(_spot, out.tolist()))


@entry
def spots_into(
    g: Matrix,
    noise: Vector,
    levels: Vector,
    sign: float,
    border: Vector,
    plane: Vector,
    signal: Matrix,
    queue: Codes,
    out: Matrix,
) -> bool:
    """Write status, x, y, the covariance (xx, xy, yy) and the flux e of the brightest separate spots into out (k, 7).

    g (rows, columns) counts; noise (3,): electrons per count, read noise e, non-uniformity; levels (3,): background,
    NaN for a plane through the border, threshold as a share of the peak, largest count; sign -1 for dark spots. plane
    (5,) is zero. border (2 (rows + columns) - 4,), signal (rows, columns) and queue (rows columns,) are scratch. False
    where a count is not finite.
    """
    rows, columns = g.shape
    for y in range(rows):
        for x in range(columns):
            if not math.isfinite(g[y, x]):
                return False
    level, gain = levels[0], noise[0]
    sloping = math.isnan(level)
    if sloping:
        level = border_level(g, border)
    quiet = math.sqrt(noise[1] ** 2 + max(level, 0.0) * gain) / gain + 1.0 / math.sqrt(12.0)
    plane[0] = level
    if sloping:
        _slopes_into(g, quiet, border, plane)
    for y in range(rows):
        for x in range(columns):
            signal[y, x] = sign * (g[y, x] - _background(plane, rows, columns, y, x))
    for k in range(out.shape[0]):
        brightest, peak = 0, signal[0, 0]
        for y in range(rows):
            for x in range(columns):
                if signal[y, x] > peak:
                    brightest, peak = y * columns + x, signal[y, x]
        out[k, 0] = NOT_SEEN
        if peak > SEEN_SIGMAS * quiet:
            cut = max(levels[1] * peak, NOISE_SIGMAS * quiet)
            out[k, 0] = centre_of_blob(g, signal, plane, cut, brightest, noise, levels[2], queue, out[k, 1:])
    return True


@kernel
def border_level(g: Matrix, border: Vector) -> float:
    """Median of the pixels along the edges of g (rows, columns); border (2 (rows + columns) - 4,) is scratch."""
    rows, columns = g.shape
    for x in range(columns):
        border[x], border[columns + x] = g[0, x], g[rows - 1, x]
    for y in range(1, rows - 1):
        border[2 * columns + 2 * y - 2], border[2 * columns + 2 * y - 1] = g[y, 0], g[y, columns - 1]
    return _median(border)


@kernel
def _median(border: Vector) -> float:
    """Middle of numbers (n,), which are sorted."""
    count = border.shape[0]
    gap = count // 2
    while gap > 0:  # Shell 1959, A high-speed sorting procedure
        for k in range(gap, count):
            value, at = border[k], k
            while at >= gap and border[at - gap] > value:
                border[at] = border[at - gap]
                at -= gap
            border[at] = value
        gap //= 2
    middle: float = 0.5 * (border[(count - 1) // 2] + border[count // 2])
    return middle


@kernel
def _slopes_into(g: Matrix, quiet: float, border: Vector, plane: Vector) -> None:
    """Write slopes of the background by x and y and their variances to plane[1:5], from medians of opposite edges.

    Of n pixels with noise `quiet` (1-sigma) a median has the variance pi/2 quiet^2 / n.
    """
    rows, columns = g.shape
    for axis in range(2):
        n, length = (rows, columns) if axis == 0 else (columns, rows)
        edge, ends = border[:n], (0.0, 0.0)
        for side in range(2):
            last = side * (length - 1)
            for k in range(n):
                edge[k] = g[k, last] if axis == 0 else g[last, k]
            ends = ends[1], _median(edge)
        plane[1 + axis] = (ends[1] - ends[0]) / (length - 1)
        plane[3 + axis] = math.pi * quiet * quiet / (n * (length - 1.0) ** 2)


@kernel
def _background(plane: Vector, rows: int, columns: int, y: int, x: int) -> float:
    """Of a pixel: the level in the middle of the window, and the slopes."""
    level: float = plane[0] + plane[1] * (x - 0.5 * (columns - 1)) + plane[2] * (y - 0.5 * (rows - 1))
    return level


@kernel
def centre_of_blob(
    g: Matrix,
    signal: Matrix,
    plane: Vector,
    cut: float,
    brightest: int,
    noise: Vector,
    full_scale: float,
    queue: Codes,
    out: Vector,
) -> int:
    """Centre of the pixels with signal above the cut that hang together with the brightest; a Status code.

    g (rows, columns) counts, signal |g - background| of them, set to zero where it was used; plane (5,): background,
    its slopes by x and y and their variances; brightest: place in the image. noise (3,): electrons per count, read
    noise e, non-uniformity; full_scale: largest count. queue (rows columns,) is scratch.
    Writes x, y, the covariance (xx, xy, yy) and the flux e into out (6,). The cut is subtracted from every pixel.
    """
    rows, columns = g.shape
    gain, read, uneven = noise[0], noise[1], noise[2]
    queue[0], count, done, full, edge = brightest, 1, 0, 0, False
    signal[brightest // columns, brightest % columns] = 0.0
    total, sum_x, sum_y = 0.0, 0.0, 0.0
    while done < count:
        y, x = queue[done] // columns, queue[done] % columns
        done += 1
        weight = abs(g[y, x] - _background(plane, rows, columns, y, x)) - cut
        total, sum_x, sum_y = total + weight, sum_x + weight * x, sum_y + weight * y
        full += g[y, x] >= full_scale
        edge = edge or x == 0 or y == 0 or x == columns - 1 or y == rows - 1
        for side in range(4):
            q, p = y + (0, 0, 1, -1)[side], x + (1, -1, 0, 0)[side]
            if 0 <= q < rows and 0 <= p < columns and signal[q, p] > cut:
                signal[q, p] = 0.0
                queue[count] = q * columns + p
                count += 1
    if edge:
        return AT_EDGE
    if full > MOST_SATURATED * count:
        return SATURATED
    centre_x, centre_y = sum_x / total, sum_y / total
    xx, xy, yy = 0.0, 0.0, 0.0
    wide_x, wide_xy, wide_y = 0.0, 0.0, 0.0
    for k in range(count):
        y, x = queue[k] // columns, queue[k] % columns
        variance = (read * read + max(g[y, x], 0.0) * gain) / (gain * gain) + 1.0 / 12.0
        variance += (uneven * (g[y, x] - plane[0])) ** 2
        dx, dy = x - centre_x, y - centre_y
        xx, xy, yy = xx + dx * dx * variance, xy + dx * dy * variance, yy + dy * dy * variance
        wide_x, wide_xy, wide_y = wide_x + dx * dx, wide_xy + dx * dy, wide_y + dy * dy
    xx += wide_x * wide_x * plane[3] + wide_xy * wide_xy * plane[4]
    xy += wide_xy * (wide_x * plane[3] + wide_y * plane[4])
    yy += wide_xy * wide_xy * plane[3] + wide_y * wide_y * plane[4]
    squared = total * total
    out[0], out[1], out[5] = centre_x, centre_y, total * gain
    out[2], out[3], out[4] = xx / squared + SHAPE_VARIANCE_PX2, xy / squared, yy / squared + SHAPE_VARIANCE_PX2
    return OK


def _spot(found: list[float]) -> Spot:
    status, x, y, xx, xy, yy, flux = found
    if status != OK:
        return Spot(math.nan, math.nan, np.full((2, 2), math.nan), math.nan, Status(int(status)))
    covariance = np.array([[xx, xy], [xy, yy]])
    covariance.setflags(write=False)
    return Spot(x, y, covariance, flux, Status.OK)


def window_corner(corner_px: ArrayLike) -> tuple[float, float]:
    """Detector coordinates (x, y) of a window's first pixel; ValueError for what is not two finite numbers."""
    if corner_px is ORIGIN:
        return ORIGIN
    corner = numbers("corner_px", corner_px)
    if corner.shape != (2,) or not np.isfinite(corner).all():
        raise ValueError(f"corner_px is two finite numbers (x, y); got {corner.tolist()}")
    return float(corner[0]), float(corner[1])


def _two_axes(image: ArrayLike) -> Matrix:
    g = one_piece("image", image)
    if g.ndim != 2 or min(g.shape) < 4:
        raise ValueError(_NO_IMAGE.format(g.shape))
    return g
