"""Several readings of one grid point: as one point, their mean.

What is wrong with a point's known position (the stage's error) is in all of its readings. As points of their own each
would predict the others, stage error and all, so that a fit would take that error for the detector's. The mean has the
noise of a reading over the root of their number, and the stage's error once.
"""

import numpy as np

from relnav.arrays import Codes, Matrix

SAME_M = 1e-9
"""No stage is set to a nanometre: known positions that agree to it are one."""
ODD = 8.0
"""Times the usual distance from the median of its point, a reading is none of that point."""
LEAST_READINGS = 3
"""Of a point, to tell an odd one."""


def points_of(true_m: Matrix) -> tuple[Codes, int]:
    """Which point each reading (n, 2) is of, (n,), counted as they come, and how many there are."""
    _, first, index = np.unique(np.round(true_m / SAME_M), axis=0, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[index.ravel()], len(first)


def mean_of_points(true_m: Matrix, measured_m: Matrix) -> tuple[Matrix, Matrix]:
    """Known and measured positions (p, 2) of the points of readings (n, 2)."""
    point, count = points_of(true_m)
    if count == len(true_m):
        return true_m, measured_m
    readings = np.bincount(point, minlength=count)[:, None]
    true, measured = (
        np.stack([np.bincount(point, weights=one[:, axis], minlength=count) for axis in range(2)], axis=1) / readings
        for one in (true_m, measured_m)
    )
    return true, measured


def odd_readings(true_m: Matrix, measured_m: Matrix) -> Codes:
    """Readings (k,) that the others of their point contradict; rows with NaN are none."""
    known = np.flatnonzero(np.isfinite(true_m).all(axis=1) & np.isfinite(measured_m).all(axis=1))
    point, count = points_of(true_m[known])
    apart = np.full(len(known), np.nan)
    for one in np.flatnonzero(np.bincount(point, minlength=count) >= LEAST_READINGS):
        rows = point == one
        seen = measured_m[known[rows]]
        apart[rows] = np.hypot(*(seen - np.median(seen, axis=0)).T)
    told = np.isfinite(apart)
    if not told.any():
        return np.empty(0, dtype=np.int64)
    odd: Codes = known[told & (apart > ODD * np.median(apart[told]))]
    return odd
