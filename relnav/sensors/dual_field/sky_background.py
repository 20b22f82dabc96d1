"""The dark between the stars: level and noise of a picture over boxes, bilinear between their centres."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Flags, Matrix, Vector

BOX_PX = 48
SAMPLES = 16
"""Pixels along a side of a box that are looked at: they give its noise to 5 %."""
CLIP = 3.0
MAD_TO_SIGMA = 1.4826
ROWS = 64
"""Of the picture that are worked on at a time."""


@dataclass(frozen=True)
class Dark:
    """Noise (r, c), counts, at the centres (rows (r,), columns (c,)) of boxes."""

    rows: Vector
    columns: Vector
    noise: Matrix

    def noise_at(self, places: NDArray[np.intp]) -> Vector:
        """Noise at pixels (n, 2), row and column: bilinear, constant beyond the outermost centres."""
        i, s = _weights(self.rows, places[:, 0].astype(np.float64))
        j, t = _weights(self.columns, places[:, 1].astype(np.float64))
        k, m = np.minimum(i + 1, len(self.rows) - 1), np.minimum(j + 1, len(self.columns) - 1)
        first, last = ((1.0 - t) * self.noise[line, j] + t * self.noise[line, m] for line in (i, k))
        between: Vector = (1.0 - s) * first + s * last
        return between

    def places_above(self, smooth: NDArray[np.float32], dead: Flags, sigmas: float, most: int) -> NDArray[np.intp]:
        """Row and column (n, 2) of the pixels of a smoothed picture that stand out of its noise; the highest `most`."""
        from scipy import ndimage

        noise = ndimage.maximum_filter(_mesh(smooth, dead)[1], 3, mode="nearest")  # a roof is quieter than the sky
        found = []
        for rows, threshold in _strips(noise, self.rows, self.columns, smooth.shape):
            with np.errstate(over="ignore"):  # beyond the largest float: nothing stands out
                places = np.argwhere(smooth[rows] > sigmas * threshold)
            found.append(places + np.array([rows.start, 0]))
        above = np.concatenate(found)
        if len(above) > most:
            height = smooth[above[:, 0], above[:, 1]]
            above = above[np.sort(np.argpartition(-height, most)[:most])]
        return above


def subtract_background(counts: NDArray[np.float32], dead: Flags) -> Dark:
    """Take the background off a picture, in place; its dead pixels take the mean of the living ones about them."""
    if dead.any():
        alive = counts[::7, ::7][~dead[::7, ::7]]
        counts[dead] = np.median(alive) if alive.size else 0.0
    level, noise = _mesh(counts, dead)
    rows, columns = _centres(counts.shape[0]), _centres(counts.shape[1])
    for strip, values in _strips(level, rows, columns, counts.shape):
        counts[strip] -= values
    if dead.any():
        _fill(counts, dead)
    return Dark(rows, columns, noise)


def smoothed(counts: NDArray[np.float32]) -> NDArray[np.float32]:
    """The picture with each pixel mixed with its neighbours, 1 : 2 : 1 along each axis."""
    smooth = np.empty_like(counts)
    last = counts.shape[0] - 1
    for start in range(0, last + 1, ROWS):
        stop = min(start + ROWS, last + 1)
        part = counts[max(start - 1, 0) : min(stop + 1, last + 1)]
        part = np.pad(part, ((int(start == 0), int(stop > last)), (1, 1)), mode="edge")
        along = 0.5 * part[1:-1] + 0.25 * (part[:-2] + part[2:])
        smooth[start:stop] = 0.5 * along[:, 1:-1] + 0.25 * (along[:, :-2] + along[:, 2:])
    return smooth


def _fill(counts: NDArray[np.float32], dead: Flags) -> None:
    """Give dead pixels the mean of the living among their eight neighbours; zero where there is none."""
    row, column = np.nonzero(dead)
    total, count = np.zeros(len(row)), np.zeros(len(row))
    for i, j in [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]:
        at = np.clip(row + i, 0, dead.shape[0] - 1), np.clip(column + j, 0, dead.shape[1] - 1)
        alive = ~dead[at]
        total += np.where(alive, counts[at], 0.0)
        count += alive
    counts[row, column] = total / np.maximum(count, 1.0)


def _side(length: int) -> tuple[int, int]:
    """Number of boxes along an axis, and pixels along the side of one."""
    number = max(1, round(length / BOX_PX))
    return number, length // number


def _centres(length: int) -> Vector:
    number, side = _side(length)
    return np.asarray((np.arange(number) + 0.5) * side - 0.5, dtype=np.float64)


def _boxes(pixels: NDArray[Any], step: int) -> NDArray[Any]:
    """Every `step`-th pixel of every box, (r, c, samples); the last rows and columns can be left over."""
    (n, height), (m, width) = _side(pixels.shape[0]), _side(pixels.shape[1])
    part = pixels[: n * height, : m * width].reshape(n, height, m, width)[:, ::step, :, ::step]
    return part.transpose(0, 2, 1, 3).reshape(n, m, -1)


def _mesh(counts: NDArray[np.float32], dead: Flags) -> tuple[Matrix, Matrix]:
    """Level and noise of every box: mean and deviation of what lies near the median.

    Outliers among the boxes are taken away by the median of each with its neighbours; noise is at least that of
    rounding. A box that is half dead is as its neighbours.
    """
    from scipy import ndimage

    step = max(1, BOX_PX // SAMPLES)
    sample, unusable = _boxes(counts, step), _boxes(dead, step).mean(axis=-1) > 0.5
    if np.all(unusable):
        return np.zeros(unusable.shape), np.full(unusable.shape, 1e30)
    least = _quantum(sample)
    middle = np.median(sample, axis=-1, keepdims=True)
    away = np.abs(sample - middle)
    width = np.maximum(CLIP * MAD_TO_SIGMA * np.median(away, axis=-1, keepdims=True), 2.0 * least)
    kept = away <= width
    count, from_middle = kept.sum(axis=-1), np.where(kept, sample - middle, 0.0)
    mean = from_middle.sum(axis=-1, dtype=np.float64) / count
    variance = (from_middle.astype(np.float64) ** 2).sum(axis=-1) / count - mean**2
    level, noise = middle[..., 0] + mean, np.sqrt(np.maximum(variance, least**2 / 12.0))
    for part in (level, noise):
        part[unusable] = np.median(part[~unusable])
        part[:] = ndimage.median_filter(part, 3, mode="nearest")
    return level.astype(np.float64), noise.astype(np.float64)


def _quantum(sample: NDArray[np.float32]) -> float:
    """Smallest step between two counts: 1 of whole numbers, 16 of 12 bits in 16, next to nothing of floats."""
    steps = np.diff(np.unique(sample[..., ::5]))
    return float(steps.min()) if len(steps) else 1.0


def _weights(centres: Vector, at: Vector) -> tuple[NDArray[np.intp], Vector]:
    """Box before each place, and how far the place is on the way to the next."""
    if len(centres) == 1:
        return np.zeros(len(at), dtype=np.intp), np.zeros(len(at))
    index = np.clip(np.searchsorted(centres, at) - 1, 0, len(centres) - 2)
    weight: Vector = np.clip((at - centres[index]) / (centres[index + 1] - centres[index]), 0.0, 1.0)
    return index, weight


def _strips(
    mesh: Matrix, rows: Vector, columns: Vector, shape: tuple[int, ...]
) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """A mesh spread over a picture, some rows at a time: which rows, and its values there."""
    across = np.array([np.interp(np.arange(shape[1]), columns, line) for line in mesh], dtype=np.float32)
    for start in range(0, shape[0], ROWS):
        at = np.arange(start, min(start + ROWS, shape[0]))
        index, weight = _weights(rows, at.astype(np.float64))
        t = weight.astype(np.float32)[:, None]
        yield (
            slice(start, start + len(at)),
            (1.0 - t) * across[index] + t * across[np.minimum(index + 1, len(mesh) - 1)],
        )
