"""In which order the spots of a frame are taken and which pairs of them are tried, where no focal length is known.

A frame that cannot be solved costs all that is tried, so that nothing is tried twice, and the cheap before the dear.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from relnav.arrays import Codes, Matrix

CHECKED_SPOTS = 24
"""The brightest spots that a candidate is checked against."""

PAIR_SPOTS, FAR_SPOTS, FEW_FAR_SPOTS = 14, 11, 8
"""The brightest spots that pairs are made of: those up to `NEAR`, those farther apart, and these in a field that is not
wide. Of 790 frames of narrow fields, 240 of them half hidden, 11 far spots solved none that 8 did not, in 1.6 times
the time."""

CLOSEST, NEAR, FAR = 0.1, 0.7, 1.1
"""Distance of the spots of a pair, relative to that of the farthest spot from the axis. Of 121 frames, half of them
with a half hidden sky, 100 have a right pair up to NEAR; 98 have one among FAR_SPOTS from 0.2 to FAR, for three times
the work."""

CLOSER = 0.5
"""The same for other orders of the spots than that given, in a narrow field: 95 of 100 at 0.4 of the work."""

NARROW, WIDE = 0.1, 0.25
"""Distance of the farthest spot from the axis, rad: work goes with the inverse of the field. Beyond WIDE it is so
little that pairs up to FAR are tried in every order, below NARROW so much that they are tried in one alone."""

CELLS = 4
"""Along each side of the field: where bright spots crowd (leaves, lamps) the brightest of every cell comes first."""

ALIKE = 0.75
"""A pair of spots that was tried in another order of the spots is hardly asked anything new where this share of the
spots that it is checked against is the same; nothing at all where all are."""

Pairs = list[tuple[int, int]]
"""Of spots, by their places in a frame."""


class Way(NamedTuple):
    """One search.

    Attributes
    ----------
    order : (n,)
        Of the spots.
    shear : float
        Error of a spot relative to its distance from the pair.
    stars_in_field : float
        Among which pairs of stars are looked up.
    farthest : float
        As `FAR`.
    """

    order: Codes
    shear: float
    stars_in_field: float
    farthest: float


def edge(points: Matrix) -> float:
    """Distance of the farthest of spots (n, 2) on the plane z = 1 from the axis."""
    return float(np.max(np.hypot(points[:, 0], points[:, 1])))


def pair_order(points: Matrix, farthest: float) -> Pairs:
    """Pairs of the brightest spots, neither too close nor too far apart, the closest first.

    Any pair is as likely to be a right one, and there are as many pairs of stars to try as the square of its width.
    """
    points = points[:CHECKED_SPOTS]
    radius = edge(points)
    far_spots = FAR_SPOTS if radius > WIDE else FEW_FAR_SPOTS
    apart = {(i, j): math.dist(points[i], points[j]) for j in range(min(PAIR_SPOTS, len(points))) for i in range(j)}
    most = [min(farthest, NEAR if j >= far_spots else FAR) * radius for j in range(PAIR_SPOTS)]
    return sorted((pair for pair in apart if CLOSEST * radius < apart[pair] < most[pair[1]]), key=apart.__getitem__)


def new_pairs(points: Matrix, ways: list[Way]) -> Iterator[Pairs]:
    """For each way through the spots its pairs; in a field that is not wide without those that one before tried alike.

    Tried again against other spots a right pair has another chance: where that costs little it is given.
    """
    share = 1.0 if edge(points) > WIDE else ALIKE
    tried: list[tuple[list[float], set[int], set[frozenset[int]]]] = []
    for order, *way, farthest in ways:
        checked, pairs = set(order[:CHECKED_SPOTS].tolist()), pair_order(points[order], farthest)
        alike = [old for how, spots, old in tried if how == way and len(spots & checked) >= share * len(checked)]
        names = [frozenset((int(order[i]), int(order[j]))) for i, j in pairs]
        tried.append((way, checked, set(names)))
        yield [pair for pair, name in zip(pairs, names, strict=True) if not any(name in old for old in alike)]


def spread_order(points: Matrix) -> Codes:
    """Indices (n,) of spots, brightest first, so that the brightest of every cell of the field come first."""
    low, span = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-12)
    cell = np.minimum((points - low) / span * CELLS, CELLS - 1).astype(np.int64) @ np.array([1, CELLS])
    place = np.array([np.sum(cell[:k] == cell[k]) for k in range(len(cell))])
    return np.argsort(place, kind="stable")


def half_orders(points: Matrix) -> list[Codes]:
    """Indices (n,) of spots, four times: those of one half of the field first, as if the other half were a roof."""
    at = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
    return [np.argsort(~(sign * at[:, axis] > 0.0), kind="stable") for axis in range(2) for sign in (1.0, -1.0)]
