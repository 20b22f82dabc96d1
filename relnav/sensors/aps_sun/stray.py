"""Which points of a calibration are strays, before anything is fitted to them by least squares.

One spot far off leads the fit of the ray model out of what can be built. So an affine map from where the design puts
the spots to where they are, which holds what misplaces a whole image (shift, scale, turn, shear), is fitted first by
least trimmed squares (Rousseeuw and Van Driessen 2006): to the three quarters of the points that it fits best. Strays
have no part in it, were they nearly a quarter.
"""

import numpy as np

from relnav.arrays import Flags, Matrix, Vector

SHARE = 0.75
"""Of the points, fitted: more than the strays leave, and enough for the map to hold over the whole field."""

SUBSETS = 30
"""Maps tried. One starts from three points, which all are good in 0.42 of the cases if a quarter of the points is bad:
none of thirty has a probability of 1e-7."""

CONCENTRATIONS = 10
"""Fits to the better part, each of which lowers the sum of squares; most have settled after five."""


def agree_at_first(
    xy: Matrix, designed: Matrix, rng: np.random.Generator, noise: float, sigmas: float, most: float
) -> Flags:
    """Which spots (N, 2) lie within so many sigmas of their places by the affine map of the designed ones.

    Sigma, of one coordinate, is what the distance that a share `most` of the points exceeds says, and not below the
    noise: at most so many are strays, and what the map leaves of a lens is no normal noise.
    """
    left = distances_from_affine(xy, designed, rng)
    usual = float(np.quantile(left, 1.0 - most, method="lower")) / np.sqrt(-2.0 * np.log(most))
    agree: Flags = left < sigmas * max(noise, usual)
    return agree


def distances_from_affine(xy: Matrix, designed: Matrix, rng: np.random.Generator) -> Vector:
    """Distance (N,) of every spot (N, 2) from its place by the affine map of the designed spots that fits most best."""
    columns = np.concatenate([designed - designed.mean(axis=0), np.ones((len(xy), 1))], axis=1)
    fitted, least = int(np.ceil(SHARE * len(xy))), np.inf
    best = np.full(len(xy), np.inf)
    for _ in range(SUBSETS):
        chosen = rng.permutation(len(xy))[: columns.shape[1]]
        for _ in range(CONCENTRATIONS):
            found = np.linalg.lstsq(columns[chosen], xy[chosen])[0]
            off = np.hypot(*(xy - columns @ found).T)
            before, chosen = chosen, np.sort(np.argsort(off, kind="stable")[:fitted])
            if np.array_equal(chosen, before):
                break
        total = float(np.sum(off[chosen] ** 2))
        if total < least:
            least, best = total, off
    return best
