"""The spots of a frame written in the frame of one pair of them, for any scale: where the others would find a star.

That frame is sum, product and difference of the pair's two directions as they are.
"""

import math
from typing import NamedTuple

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.matching import spread_chord2
from relnav.sensors.dual_field.star_levels import Levels

ALONG, ACROSS, APART, LOOSE2, TIGHT2, LOG_LOOSE, LOG_TIGHT, LEVEL, HALF, SPOT_NUMBERS = range(10)
"""Columns of a template (spots, SPOT_NUMBERS): coordinates in the frame of the pair, the squares of both tolerances and
the logarithms of their chances, and which table of `Levels` is asked, with half as many cells as it has."""


class Spots(NamedTuple):
    """The spots of one search and what they may be.

    Attributes
    ----------
    points : (m, 2)
        On the plane z = 1, with the focal length as given.
    magnitude : (m,)
        Up to a constant; all alike where they are not known.
    sigma2 : float
        Variance of each direction about an axis normal to it, rad^2.
    shears : (2,)
        Error of a spot relative to its distance from the pair: two tolerances, the wider first.
    focal_range, half_step : float
        How far the focal length may be off, relative, and for which part of that a template serves.
    stars : float
        Of the sky, on which a spot may fall by chance.
    depth : float
        Their faintest magnitude.
    known, faintest, contrast : float
        Pairs whose fainter star is not fainter than `known` or fainter than `faintest` are passed over, and those whose
        difference of magnitude is farther than `contrast` from that of the spots.
    """

    points: Matrix
    magnitude: Vector
    sigma2: float
    shears: Vector
    focal_range: float
    half_step: float
    stars: float
    depth: float
    known: float
    faintest: float
    contrast: float


@kernel
def scale_of_pair(points: Matrix, i: int, j: int, angle: float) -> float:
    """Factor by which the plane points i and j are to be moved out to stand at `angle` from one another."""
    x, y, p, q = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
    dot, a, c = x * p + y * q, x * x + y * y, p * p + q * q
    scale = 1.0
    for _ in range(6):  # the angle is almost proportional to the scale
        s2 = scale * scale
        cosine = (1.0 + s2 * dot) / math.sqrt((1.0 + s2 * a) * (1.0 + s2 * c))
        scale *= angle / math.acos(min(1.0, cosine))
    return scale


@kernel
def frame_of_pair(spots: Spots, i: int, j: int, scale: float, axes: Matrix) -> None:
    """Write what spots i and j span, moved out: axes (6, 3), the last three divided by their squares.

    Rows: sum, product and difference of their directions, then each so that its product with a direction is the
    coordinate along it.
    """
    x, y, u, v = (
        scale * spots.points[i, 0],
        scale * spots.points[i, 1],
        scale * spots.points[j, 0],
        scale * spots.points[j, 1],
    )
    f, g = 1.0 / math.sqrt(1.0 + x * x + y * y), 1.0 / math.sqrt(1.0 + u * u + v * v)
    frame_of_directions(x * f, y * f, f, u * g, v * g, g, axes)
    for r in range(3):
        square = axes[r, 0] ** 2 + axes[r, 1] ** 2 + axes[r, 2] ** 2
        for k in range(3):
            axes[3 + r, k] = axes[r, k] / square


@kernel
def frame_of_directions(x: float, y: float, z: float, u: float, v: float, w: float, axes: Matrix) -> None:
    """Write sum, product and difference of two unit vectors into the first rows of axes."""
    axes[0, 0], axes[0, 1], axes[0, 2] = x + u, y + v, z + w
    axes[1, 0], axes[1, 1], axes[1, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    axes[2, 0], axes[2, 1], axes[2, 2] = x - u, y - v, z - w


@kernel
def tolerance2(spots: Spots, along2: float, m2: float, shear: float) -> float:
    """Square of the tolerance for a spot: that of its noise and of its share of an unknown distortion.

    `along2` is that of its product with the unit vector to the pair's middle, `m2` that of the sum of the pair.
    """
    d2 = max(0.0, 1.0 - along2)
    return spread_chord2(spots.sigma2, d2, m2) + shear * shear * d2


@kernel
def nearest_first(points: Matrix, i: int, j: int, beside: float, order: Codes) -> None:
    """Write the other spots, those nearest to the middle of i and j first, into order (m,).

    Last come those closer than `beside` to i or j: a star is there under every attitude, that of the pair itself.
    """
    x, y, row = 0.5 * (points[i, 0] + points[j, 0]), 0.5 * (points[i, 1] + points[j, 1]), 0
    for way in range(2):
        begin = row
        for k in range(points.shape[0]):
            if k in (i, j) or (min(apart2(points, k, i), apart2(points, k, j)) < beside * beside) != (way == 1):
                continue
            d2, place = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2, row
            while (
                place > begin and (points[order[place - 1], 0] - x) ** 2 + (points[order[place - 1], 1] - y) ** 2 > d2
            ):
                order[place] = order[place - 1]
                place -= 1
            order[place] = k
            row += 1


@kernel
def apart2(points: Matrix, i: int, j: int) -> float:
    """Square of the distance of two points."""
    return float((points[i, 0] - points[j, 0]) ** 2 + (points[i, 1] - points[j, 1]) ** 2)


@kernel
def write_template(
    spots: Spots, levels: Levels, scale: float, axes: Matrix, order: Codes, first: int, last: int, template: Matrix
) -> None:
    """Write rows of spots, by their places in `order`, in the frame of a pair."""
    m2 = axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2
    for row in range(first, last):
        k = order[row]
        x, y = scale * spots.points[k, 0], scale * spots.points[k, 1]
        z = 1.0 / math.sqrt(1.0 + x * x + y * y)
        x, y = x * z, y * z
        for r in range(3):
            template[row, r] = axes[3 + r, 0] * x + axes[3 + r, 1] * y + axes[3 + r, 2] * z
        along2 = max(0.0, template[row, ALONG]) ** 2 * m2
        template[row, LOOSE2] = tolerance2(spots, along2, m2, spots.shears[0])
        template[row, TIGHT2] = tolerance2(spots, along2, m2, spots.shears[1])
        template[row, LEVEL], template[row, HALF] = float(levels.reach.shape[0]), 0.0
        for level in range(levels.reach.shape[0]):
            if template[row, LOOSE2] <= levels.reach[level] ** 2:
                template[row, LEVEL], template[row, HALF] = float(level), levels.half[level]
                break


@kernel
def write_chances(spots: Spots, count: int, template: Matrix) -> None:
    """Write the logarithms of the probability that a spot thrown over the sky falls on a star, from the tolerances."""
    for row in range(count):
        template[row, LOG_LOOSE] = math.log(min(1.0, 0.25 * spots.stars * template[row, LOOSE2]))
        template[row, LOG_TIGHT] = math.log(min(1.0, 0.25 * spots.stars * template[row, TIGHT2]))
