"""A pair of spots taken for pairs of stars, at any scale: what a search without a focal length spends its time on.

Almost every pair of stars is a wrong one. Every spot is written once in the frame of its pair, along the sum, the
product and the difference of the two directions, none of them normed: in the same frame of two stars it then stands
where its star should be, whatever their distance, without a root or a quotient. One look into a table of bits mostly
says that nothing is there.
"""

import math
from typing import NamedTuple

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.evidence import log_choices
from relnav.sensors.dual_field.matching import LOOSEST_CHORD2
from relnav.sensors.dual_field.pair_table import Indices, k_range
from relnav.sensors.dual_field.screening import FEW_SPOTS
from relnav.sensors.dual_field.sky import SkyArrays, cell_of, nearest_star, place_of, touched

ALONG, ACROSS, APART, LOOSE2, TIGHT2, LOG_LOOSE, LOG_TIGHT, LEVEL, HALF, SPOT_NUMBERS = range(10)
"""Columns of a template (spots, SPOT_NUMBERS): coordinates in the frame of the pair, the squares of both tolerances and
the logarithms of their chances, and which table of bits is asked (-1: none), with half as many cells as it has."""

LEAST_FOUND = 3
"""Spots that must find a star beside the pair before a candidate is looked at."""

ASKED, ASKED_AGAIN, LEAST_AGAIN = 3, 7, 2
"""Of more than `FEW_SPOTS` one of the first spots must find a star, then so many of a few more, before all are asked."""

FAINT = 30.0
"""A magnitude beyond all."""

TRIED, CHANCE, STAR_PAIR, SIGN, SHEAR, BEST_NUMBERS = range(6)
"""Entries of `best`: attitudes tried so far, and of the best one the logarithm of its false alarm probability, its pair
in the table, 1 or -1 for its order, and the tolerance under which it is the best."""


WORDS = 1 << 16
"""Words of a table of bits: each cell has three bits of one word, one of each 16 (a blocked Bloom filter, Putze,
Sanders and Singler 2007)."""

BESIDE = 0.3
"""How far beside the sphere, in reaches, a spot is looked up: a template is not normed."""


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


class Levels(NamedTuple):
    """Where stars are, for tolerances that are small beside a field.

    Attributes
    ----------
    words, reach, half : (l, WORDS), (l,), (l,)
        Tables of bits for growing tolerances: each its tolerance, rad, and half as many cells as along an axis.
    begin, star : (BUCKETS + 1,), (s,)
        The stars within the largest reach of each cell of a grid, cells hashed: where a cell's begin, and all of them.
    wide : float
        Half as many cells as along an axis of that grid.
    """

    words: Codes
    reach: Vector
    half: Vector
    begin: Indices
    star: Indices
    wide: float


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
    """Square of the tolerance for a spot, as `matching.loose_chord2`.

    `along2` is that of its product with the unit vector to the pair's middle, `m2` that of the sum of the pair.
    """
    d2 = max(0.0, 1.0 - along2)
    return float(min(LOOSEST_CHORD2, 16.0 * spots.sigma2 * (1.5 + 2.0 * d2 / (4.0 - m2))) + shear * shear * d2)


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


@kernel
def word_and_bits(place: int) -> tuple[int, int, int, int]:
    """Which word of a table a cell has, and which three of its bits: `place` as of `sky.place_of`."""
    return (place >> 48) & (WORDS - 1), (place >> 44) & 15, 16 + ((place >> 40) & 15), 32 + ((place >> 36) & 15)


@kernel
def noted(words: Codes, place: int) -> int:
    """1 where a star may be near a cell, else 0; `place` as of `sky.place_of`."""
    word, a, b, c = word_and_bits(place)
    bits = words[word]
    return (bits >> a) & (bits >> b) & (bits >> c) & 1


@kernel
def note_near(stars: Matrix, half: float, reach: float, words: Codes, places: Codes) -> None:
    """Note all cells, 2 `half` along each axis, that have a point of the sphere within reach of a star; places (8,)."""
    for s in range(stars.shape[0]):
        for k in range(touched(stars[s], half, reach, BESIDE * reach, places)):
            word, a, b, c = word_and_bits(places[k])
            words[word] |= (1 << a) | (1 << b) | (1 << c)


@kernel
def marks(template: Matrix, row: int, levels: Levels, axes: Matrix) -> tuple[int, int]:
    """Whether a star may be where a spot should see it, for a pair of stars and for the same pair turned round."""
    half, a, b, c = template[row, HALF], template[row, ALONG], template[row, ACROSS], template[row, APART]
    a, b, c = half * a, half * b, half * c
    x, y, z = half + a * axes[0, 0], half + a * axes[0, 1], half + a * axes[0, 2]
    u = b * axes[1, 0] + c * axes[2, 0]
    v = b * axes[1, 1] + c * axes[2, 1]
    w = b * axes[1, 2] + c * axes[2, 2]
    near = levels.words[int(template[row, LEVEL])]
    return (
        noted(near, place_of(int(x + u), int(y + v), int(z + w))),
        noted(near, place_of(int(x - u), int(y - v), int(z - w))),
    )


@kernel
def distance2(
    template: Matrix, row: int, known: bool, spots: Spots, sky: SkyArrays, levels: Levels, axes: Matrix, sign: float
) -> float:
    """Square of the distance of a spot from the nearest star; 5 where there is none within the wider tolerance.

    `known` says that its bit is set.
    """
    a, b, c = template[row, ALONG], sign * template[row, ACROSS], sign * template[row, APART]
    x = a * axes[0, 0] + b * axes[1, 0] + c * axes[2, 0]
    y = a * axes[0, 1] + b * axes[1, 1] + c * axes[2, 1]
    z = a * axes[0, 2] + b * axes[1, 2] + c * axes[2, 2]
    level, best2 = int(template[row, LEVEL]), 5.0
    if level == levels.reach.shape[0]:
        s = nearest_star(sky.stars, sky.cells, x, y, z, template[row, LOOSE2], -FAINT, spots.depth + FAINT)
        if s >= 0:
            best2 = (sky.stars[s, 0] - x) ** 2 + (sky.stars[s, 1] - y) ** 2 + (sky.stars[s, 2] - z) ** 2
        return float(best2)
    if known or noted(levels.words[level], cell_of(template[row, HALF], x, y, z)) != 0:
        place = (cell_of(levels.wide, x, y, z) >> 40) & (levels.begin.shape[0] - 2)
        for item in range(levels.begin[place], levels.begin[place + 1]):
            v = sky.stars[levels.star[item]]
            d2 = (v[0] - x) ** 2 + (v[1] - y) ** 2 + (v[2] - z) ** 2
            if d2 < best2 and v[3] <= spots.depth:
                best2 = d2
    return float(best2)


@kernel
def least_matches(template: Matrix, spots: int, best: Vector) -> int:
    """How many of the spots must find a star, were all as close as the tighter tolerance, to be better than `best`."""
    surest = 0.0
    for row in range(spots):
        surest = min(surest, template[row, LOG_TIGHT])
    tried = math.log(best[TRIED] + 1.0)
    for count in range(LEAST_FOUND, spots):
        if tried + log_choices(float(spots), float(count)) + count * surest < best[CHANCE]:
            return count
    return spots


@kernel
def judge(
    template: Matrix,
    asked: int,
    where: int,
    least: int,
    needed: int,
    spots: Spots,
    sky: SkyArrays,
    levels: Levels,
    axes: Matrix,
    sign: float,
    best: Vector,
) -> bool:
    """Count the stars of all spots under one attitude, with both tolerances; whether it is the best so far."""
    n = spots.points.shape[0] - 2
    loose, tight, log_loose, log_tight = 0, 0, 0.0, 0.0
    for row in range(n):
        if (row == asked and loose < least) or loose + n - row < needed:
            return False
        if row < asked and (where >> row) & 1 == 0:
            continue
        d2 = distance2(template, row, row < asked, spots, sky, levels, axes, sign)
        if d2 < template[row, LOOSE2]:
            loose, log_loose = loose + 1, log_loose + template[row, LOG_LOOSE]
            if d2 < template[row, TIGHT2]:
                tight, log_tight = tight + 1, log_tight + template[row, LOG_TIGHT]
    if loose < needed:
        return False
    better, tried = False, math.log(best[TRIED])
    if loose >= LEAST_FOUND:
        chance = tried + log_choices(float(n), float(loose)) + log_loose
        if chance < best[CHANCE]:
            better, best[CHANCE], best[SHEAR] = True, chance, spots.shears[0]
    if tight >= LEAST_FOUND:
        chance = tried + log_choices(float(n), float(tight)) + log_tight
        if chance < best[CHANCE]:
            better, best[CHANCE], best[SHEAR] = True, chance, spots.shears[1]
    return better


@kernel
def nearest_first(points: Matrix, i: int, j: int, order: Codes) -> None:
    """Write the other spots, those nearest to the middle of i and j first, into order (m,)."""
    x, y, row = 0.5 * (points[i, 0] + points[j, 0]), 0.5 * (points[i, 1] + points[j, 1]), 0
    for k in range(points.shape[0]):
        if k in (i, j):
            continue
        d2, place = (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2, row
        while place > 0 and (points[order[place - 1], 0] - x) ** 2 + (points[order[place - 1], 1] - y) ** 2 > d2:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k
        row += 1


@kernel
def try_scaled_pair(
    spots: Spots, sky: SkyArrays, levels: Levels, i: int, j: int, order: Codes, work: Matrix, best: Vector
) -> None:
    """The best attitude of one pair of spots: sets `best`, better than it was; order (m,) and work (m + 12, 10) scratch.

    The spots asked first change with the pair, so that a few bright false ones do not stand in every pair's way.
    """
    points, n = spots.points, spots.points.shape[0]
    template, own, axes = work[: n - 2], work[n : n + 6, :3], work[n + 6 : n + 9, :3]
    nearest_first(points, i, j, order)
    x, y, u, v = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
    cosine = (1.0 + x * u + y * v) / math.sqrt((1.0 + x * x + y * y) * (1.0 + u * u + v * v))
    angle = math.acos(min(1.0, cosine))
    low, high = math.cos(angle * (1.0 + spots.focal_range)), math.cos(angle * (1.0 - spots.focal_range))
    first, last = k_range(sky.cosines, sky.k, sky.line, low, high)
    fainter, written_to, scale, whole = spots.magnitude[j] - spots.magnitude[i], -2.0, 1.0, False
    frame_of_pair(spots, i, j, scale, own)
    write_template(spots, levels, scale, own, order, 0, n - 2, template)
    write_chances(spots, n - 2, template)
    needed = least_matches(template, n - 2, best)
    first_asked, asked, least = (ASKED, ASKED_AGAIN, LEAST_AGAIN) if n > FEW_SPOTS else (n - 2, n - 2, needed)
    for pair in range(first, last):
        p, q = sky.pairs[pair, 0], sky.pairs[pair, 1]
        a, c = sky.stars[p], sky.stars[q]
        step, fainter_star = c[3] - a[3], max(a[3], c[3])
        straight, crossed = abs(step - fainter) <= spots.contrast, abs(step + fainter) <= spots.contrast
        if not spots.known < fainter_star <= spots.faintest or not (straight or crossed):
            continue
        if sky.cosines[pair] > written_to:  # they ascend
            angle = math.acos(sky.cosines[pair]) * (1.0 - spots.half_step)
            written_to = math.cos(angle * (1.0 - spots.half_step))
            scale, whole = scale_of_pair(points, i, j, angle), False
            frame_of_pair(spots, i, j, scale, own)
            write_template(spots, levels, scale, own, order, 0, asked, template)
        best[TRIED] += straight + crossed
        frame_of_directions(a[0], a[1], a[2], c[0], c[1], c[2], axes)
        hits, turned, where, there = 0, 0, 0, 0
        for row in range(first_asked):
            one, other = marks(template, row, levels, axes)
            hits, turned, where, there = hits + one, turned + other, where | (one << row), there | (other << row)
        if max(hits, turned) + asked - first_asked < least or hits + turned == 0:
            continue
        for row in range(first_asked, asked):
            one, other = marks(template, row, levels, axes)
            hits, turned, where, there = hits + one, turned + other, where | (one << row), there | (other << row)
            if max(hits, turned) + asked - row <= least:
                break
        if not (straight and hits >= least) and not (crossed and turned >= least):
            continue
        if not whole:
            write_template(spots, levels, scale, own, order, asked, n - 2, template)
            whole = True
        if straight and hits >= least and judge(
            template, asked, where, least, needed, spots, sky, levels, axes, 1.0, best
        ):
            best[STAR_PAIR], best[SIGN] = pair, 1.0
        if crossed and turned >= least and judge(
            template, asked, there, least, needed, spots, sky, levels, axes, -1.0, best
        ):
            best[STAR_PAIR], best[SIGN] = pair, -1.0


@kernel
def try_pairs(
    spots: Spots,
    sky: SkyArrays,
    levels: Levels,
    pairs: Codes,
    start: int,
    enough: float,
    order: Codes,
    work: Matrix,
    best: Vector,
) -> int:
    """Try pairs of spots (p, 2) from `start` on until one has a chance below `enough`: which, or p; sets `best`."""
    for number in range(start, pairs.shape[0]):
        best[CHANCE] = enough
        try_scaled_pair(spots, sky, levels, pairs[number, 0], pairs[number, 1], order, work, best)
        if best[CHANCE] < enough:
            return number
    return int(pairs.shape[0])


@kernel
def read_best(
    spots: Spots, sky: SkyArrays, i: int, j: int, work: Matrix, best: Vector, A: Matrix, star: Codes
) -> float:
    """Write the attitude (3, 3) of the best and each spot's star (m,), -1 for none; returns its scale."""
    pair, sign, shear = int(best[STAR_PAIR]), best[SIGN], best[SHEAR]
    p, q = sky.pairs[pair, 0], sky.pairs[pair, 1]
    seen, true, v, w = work[0:6, :3], work[6:9, :3], sky.stars[p], sky.stars[q]
    scale = scale_of_pair(spots.points, i, j, math.acos(sky.cosines[pair]))
    frame_of_pair(spots, i, j, scale, seen)
    frame_of_directions(v[0], v[1], v[2], w[0], w[1], w[2], true)
    for r in range(3):
        for k in range(3):
            turned = seen[4, r] * true[1, k] + seen[5, r] * true[2, k]
            A[r, k] = seen[3, r] * true[0, k] + sign * turned
    m2 = seen[0, 0] ** 2 + seen[0, 1] ** 2 + seen[0, 2] ** 2
    for k in range(spots.points.shape[0]):
        x, y = scale * spots.points[k, 0], scale * spots.points[k, 1]
        z = 1.0 / math.sqrt(1.0 + x * x + y * y)
        x, y = x * z, y * z
        t2 = tolerance2(spots, (seen[0, 0] * x + seen[0, 1] * y + seen[0, 2] * z) ** 2 / m2, m2, shear)
        star[k] = nearest_star(
            sky.stars,
            sky.cells,
            A[0, 0] * x + A[1, 0] * y + A[2, 0] * z,
            A[0, 1] * x + A[1, 1] * y + A[2, 1] * z,
            A[0, 2] * x + A[1, 2] * y + A[2, 2] * z,
            t2,
            -FAINT,
            spots.depth + FAINT,
        )
    star[i], star[j] = (p, q) if sign > 0.0 else (q, p)
    return scale


@kernel
def count_touched(stars: Matrix, half: float, reach: float, count: Indices, places: Codes) -> None:
    """Add up in count (b + 1,), from its second entry on, how many stars are within reach of each bucket's cells."""
    for s in range(stars.shape[0]):
        for k in range(touched(stars[s], half, reach, BESIDE * reach, places)):
            count[1 + ((places[k] >> 40) & (count.shape[0] - 2))] += 1


@kernel
def fill_touched(stars: Matrix, half: float, reach: float, begin: Indices, out: Indices, places: Codes) -> None:
    """Write those stars, bucket after bucket, from begin (b,) on, which is moved."""
    for s in range(stars.shape[0]):
        for k in range(touched(stars[s], half, reach, BESIDE * reach, places)):
            bucket = (places[k] >> 40) & (begin.shape[0] - 1)
            out[begin[bucket]] = s
            begin[bucket] += 1
