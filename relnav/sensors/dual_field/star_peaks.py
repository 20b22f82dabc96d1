"""Where stars may be in a picture: its peaks, each once."""

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Flags, Matrix
from relnav.sensors.dual_field.sky_background import Dark, smoothed

PEAK_PX = 2
"""A peak is the largest of all pixels so near, along each axis."""
MOST_ABOVE = 0.1
"""Share of the pixels that can stand out: of more only the highest, for a picture of daylight."""


def find_peaks(
    counts: NDArray[np.float32], dead: Flags, dark: Dark, threshold_sigma: float, most: int
) -> NDArray[np.intp]:
    """Rows and columns (n, 2) of the highest peaks, at most `most`."""
    smooth = smoothed(counts)
    above = dark.places_above(smooth, dead, threshold_sigma, int(MOST_ABOVE * smooth.size) + 100)
    row, column = above.T
    inside = (row >= PEAK_PX) & (row < smooth.shape[0] - PEAK_PX) & (column >= PEAK_PX)
    inside &= column < smooth.shape[1] - PEAK_PX
    row, column = row[inside], column[inside]
    height, peak = smooth[row, column], ~dead[row, column]
    span = range(-PEAK_PX, PEAK_PX + 1)
    for i, j in [(i, j) for i in span for j in span if (i, j) != (0, 0)]:
        beside = smooth[row + i, column + j]
        peak &= (height > beside) | ((height == beside) & ((i, j) > (0, 0)))  # of equals the last
        if max(abs(i), abs(j)) == 1:
            peak &= ~dead[row + i, column + j]
    order = np.argsort(-height[peak], kind="stable")[:most]
    return np.stack([row[peak][order], column[peak][order]], axis=-1)


def without_doubles(rows: Matrix) -> Matrix:
    """Each centre once: several peaks of a full star lead to the same."""
    from scipy.spatial import cKDTree

    if len(rows) < 2:
        return rows
    drop = np.zeros(len(rows), dtype=bool)
    for first, second in sorted(cKDTree(rows[:, :2]).query_pairs(PEAK_PX)):
        if not drop[first]:
            drop[second] = True
    return rows[~drop]
