"""A pair of spots taken for pairs of stars, at any scale: what a search without a focal length spends its time on.

Almost every pair of stars is a wrong one. Every spot is written once in the frame of its pair, along the sum, the
product and the difference of the two directions, none of them normed: in the same frame of two stars it then stands
where its star should be, whatever their distance, without a root or a quotient. Three spots near the pair are asked
first, of a block of pairs of stars at a time; whoever is left is asked more.
"""

import math
from typing import NamedTuple

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel, long_entry
from relnav.sensors.dual_field.evidence import log_choices
from relnav.sensors.dual_field.pair_block import (
    BEST_PAIR,
    CHANCE,
    LOOKED_UP,
    SCALE,
    SHEAR,
    SIGN,
    STRAIGHT,
    TRIED,
    TURNED,
    Places,
    Work,
    ask,
    collect,
    keep_pair,
    look_up,
    orders_of,
    take_frame,
    write_frames,
)
from relnav.sensors.dual_field.pair_table import Indices, k_range
from relnav.sensors.dual_field.screening import FEW_SPOTS
from relnav.sensors.dual_field.sky import Bits, SkyArrays, cell_of, nearest_star
from relnav.sensors.dual_field.spot_template import (
    ACROSS,
    ALONG,
    APART,
    HALF,
    LEVEL,
    LOG_LOOSE,
    LOG_TIGHT,
    LOOSE2,
    TIGHT2,
    Spots,
    frame_of_directions,
    frame_of_pair,
    nearest_first,
    scale_of_pair,
    tolerance2,
    write_chances,
    write_template,
)
from relnav.sensors.dual_field.star_levels import Levels, nearest_chord2, noted

LEAST_FOUND = 3
"""Spots that must find a star beside the pair before a candidate is looked at."""

ASKED, ASKED_AGAIN, LEAST_AGAIN = LOOKED_UP, 10, 2
"""Of more than `FEW_SPOTS` spots the three nearest to the pair are asked first, as distortion moves them least: one
must find a star, then two of ten, before all are asked. Of 430 narrow frames, 180 of them half hidden, those solved
are the same as where one of three others was enough; with two of seven one real frame with many false spots is lost."""

BESIDE = 4.0
"""A spot closer to one of the pair than so many tolerances comes last: the pair's own star sets the bits of cells up to
that far away."""

FAINT = 30.0
"""A magnitude beyond all."""


class Asked(NamedTuple):
    """How many spots are asked first, and then, how many of those must find a star, and how many of all spots."""

    first: int
    then: int
    least: int
    needed: int


@kernel
def count_bits(bits: int) -> int:
    """How many are set."""
    count = 0
    while bits != 0:
        bits &= bits - 1
        count += 1
    return count


@kernel
def distance2(
    template: Matrix, row: int, known: bool, spots: Spots, sky: SkyArrays, levels: Levels, axes: Matrix, sign: float
) -> float:
    """Square of the distance of a spot from the nearest star; 5 where there is none within the wider tolerance.

    `known` says that its bits are set.
    """
    a, b, c = template[row, ALONG], sign * template[row, ACROSS], sign * template[row, APART]
    x = a * axes[0, 0] + b * axes[1, 0] + c * axes[2, 0]
    y = a * axes[0, 1] + b * axes[1, 1] + c * axes[2, 1]
    z = a * axes[0, 2] + b * axes[1, 2] + c * axes[2, 2]
    level = int(template[row, LEVEL])
    if level < levels.reach.shape[0]:
        if known or noted(levels.words[level], cell_of(template[row, HALF], x, y, z)) != 0:
            return nearest_chord2(levels, sky.stars, spots.depth, x, y, z)
        return 5.0
    s = nearest_star(sky.stars, sky.cells, x, y, z, template[row, LOOSE2], -FAINT, spots.depth + FAINT)
    if s < 0:
        return 5.0
    return float((sky.stars[s, 0] - x) ** 2 + (sky.stars[s, 1] - y) ** 2 + (sky.stars[s, 2] - z) ** 2)


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
    asked: Asked,
    where: int,
    spots: Spots,
    sky: SkyArrays,
    levels: Levels,
    template: Matrix,
    axes: Matrix,
    sign: float,
    best: Vector,
) -> bool:
    """Count the stars of all spots under one attitude, with both tolerances; whether it is the best so far."""
    n = spots.points.shape[0] - 2
    loose, tight, log_loose, log_tight = 0, 0, 0.0, 0.0
    for row in range(n):
        if (row == asked.then and loose < asked.least) or loose + n - row < asked.needed:
            return False
        if row < asked.then and (where >> row) & 1 == 0:
            continue
        d2 = distance2(template, row, row < asked.then, spots, sky, levels, axes, sign)
        if d2 < template[row, LOOSE2]:
            loose, log_loose = loose + 1, log_loose + template[row, LOG_LOOSE]
            if d2 < template[row, TIGHT2]:
                tight, log_tight = tight + 1, log_tight + template[row, LOG_TIGHT]
    if loose < asked.needed:
        return False
    better, tried = False, math.log(best[TRIED])
    chance = tried + log_choices(float(n), float(loose)) + log_loose
    if chance < best[CHANCE]:
        better, best[CHANCE], best[SHEAR] = True, chance, spots.shears[0]
    chance = tried + log_choices(float(n), float(tight)) + log_tight
    if tight >= LEAST_FOUND and chance < best[CHANCE]:
        better, best[CHANCE], best[SHEAR] = True, chance, spots.shears[1]
    return better


@kernel
def try_block(asked: Asked, count: int, scale: float, spots: Spots, sky: SkyArrays, levels: Levels, work: Work) -> None:
    """Try the first `count` pairs of stars of a block, whose template the first spots have; sets `best`."""
    n, template, found, axes, best = spots.points.shape[0] - 2, work.template, work.found, work.axes, work.best
    write_frames(sky, work, count)
    for k in range(count):
        found[k] = 0
    for row in range(asked.first):
        ask(template, row, levels, work.frames, count, work.places, found)
    some = 0
    for k in range(count):
        found[k] &= work.allowed[k]
        work.some[some] = k
        some += int(found[k] != 0)
    if asked.first <= LOOKED_UP:
        look_up(asked.first, some, spots, sky, levels, work)
    left = 0
    for s in range(some):
        if found[work.some[s]] != 0:
            keep_pair(work, work.some[s], left)
            left += 1
    for row in range(asked.first, asked.then):
        ask(template, row, levels, work.frames, left, work.places, found)
    whole = False
    for k in range(left):
        bits = found[k] & work.allowed[k]
        straight, turned = bits & STRAIGHT, bits >> TURNED
        if max(count_bits(straight), count_bits(turned)) < asked.least:
            continue
        if not whole:
            write_template(spots, levels, scale, work.own, work.order, asked.then, n, template)
            whole = True
        take_frame(work, k)
        if count_bits(straight) >= asked.least and judge(
            asked, straight, spots, sky, levels, template, axes, 1.0, best
        ):
            best[BEST_PAIR], best[SIGN] = work.pair[k], 1.0
        if count_bits(turned) >= asked.least and judge(asked, turned, spots, sky, levels, template, axes, -1.0, best):
            best[BEST_PAIR], best[SIGN] = work.pair[k], -1.0


@kernel
def first_above(ascending: Vector, first: int, last: int, value: float) -> int:
    """Index of the first number above a value from `first` to before `last`, else `last`."""
    while first < last:
        middle = (first + last) // 2
        if ascending[middle] > value:
            last = middle
        else:
            first = middle + 1
    return first


@kernel
def try_scaled_pair(spots: Spots, sky: SkyArrays, levels: Levels, i: int, j: int, work: Work) -> None:
    """The best attitude of one pair of spots: sets `best` where it is better than that was."""
    points, n, template, best = spots.points, spots.points.shape[0] - 2, work.template, work.best
    x, y, u, v = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
    cosine = (1.0 + x * u + y * v) / math.sqrt((1.0 + x * x + y * y) * (1.0 + u * u + v * v))
    angle = math.acos(min(1.0, cosine))
    low, high = math.cos(angle * (1.0 + spots.focal_range)), math.cos(angle * (1.0 - spots.focal_range))
    pair, last = k_range(sky.cosines, sky.k, sky.line, low, high)
    fainter, scale = spots.magnitude[j] - spots.magnitude[i], 1.0
    nearest_first(points, i, j, BESIDE * max(levels.reach[0], 0.5 * spots.shears[0] * angle), work.order)
    frame_of_pair(spots, i, j, scale, work.own)
    write_template(spots, levels, scale, work.own, work.order, 0, n, template)
    write_chances(spots, n, template)
    needed = least_matches(template, n, best)
    few = n + 2 <= FEW_SPOTS
    asked = Asked(ASKED, ASKED_AGAIN, LEAST_AGAIN, needed)
    if few:  # of so many, one at the least must find a star
        asked = Asked(n - needed + 1, n, needed, needed)
    while pair < last:
        if orders_of(spots, sky, fainter, pair) == 0:
            pair += 1
            continue
        angle = math.acos(sky.cosines[pair]) * (1.0 - spots.half_step)
        scale = scale_of_pair(points, i, j, angle)
        frame_of_pair(spots, i, j, scale, work.own)
        write_template(spots, levels, scale, work.own, work.order, 0, asked.then, template)
        step = first_above(sky.cosines, pair, last, math.cos(angle * (1.0 - spots.half_step)))
        while pair < step:
            pair, count = collect(spots, sky, fainter, pair, step, work)
            try_block(asked, count, scale, spots, sky, levels, work)


@kernel
def read_best(spots: Spots, sky: SkyArrays, i: int, j: int, work: Work, A: Matrix, star: Codes) -> None:
    """Write the attitude (3, 3) of the best, each spot's star (m,), -1 for none, and its scale."""
    pair, sign, shear = int(work.best[BEST_PAIR]), work.best[SIGN], work.best[SHEAR]
    p, q = sky.pairs[pair, 0], sky.pairs[pair, 1]
    seen, true, v, w = work.own, work.axes, sky.stars[p], sky.stars[q]
    scale = scale_of_pair(spots.points, i, j, math.acos(sky.cosines[pair]))
    frame_of_pair(spots, i, j, scale, seen)
    frame_of_directions(v[0], v[1], v[2], w[0], w[1], w[2], true)
    for axis in range(3):  # normed here, as their lengths agree to the accuracy of the scale alone
        own2 = seen[axis, 0] ** 2 + seen[axis, 1] ** 2 + seen[axis, 2] ** 2
        weight = 1.0 / math.sqrt(own2 * (true[axis, 0] ** 2 + true[axis, 1] ** 2 + true[axis, 2] ** 2))
        for r in range(3):
            for k in range(3):
                before = 0.0 if axis == 0 else A[r, k]
                A[r, k] = before + (weight if axis == 0 else sign * weight) * seen[axis, r] * true[axis, k]
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
    work.best[SCALE] = scale


@kernel
def promising(
    spots: Spots,
    sky: SkyArrays,
    levels: Levels,
    work: Work,
    pairs: Codes,
    start: int,
    enough: float,
    A: Matrix,
    star: Codes,
) -> int:
    """`try_pairs` of kernels."""
    for number in range(start, pairs.shape[0]):
        i, j, work.best[CHANCE] = pairs[number, 0], pairs[number, 1], enough
        try_scaled_pair(spots, sky, levels, i, j, work)
        if work.best[CHANCE] < enough:
            read_best(spots, sky, i, j, work, A, star)
            return number
    return int(pairs.shape[0])


@long_entry
def try_numbers(
    tried: Codes,
    start: int,
    enough: float,
    A: Matrix,
    match: Codes,
    points: Matrix,
    magnitude: Vector,
    sigma2: float,
    shears: Vector,
    focal_range: float,
    half_step: float,
    count: float,
    depth: float,
    known: float,
    faintest: float,
    contrast: float,
    stars: Matrix,
    cells: Indices,
    near: Bits,
    brighter: Vector,
    cosines: Vector,
    pairs: Indices,
    k: Indices,
    line: Vector,
    words: Codes,
    reach: Vector,
    half: Vector,
    begin: Indices,
    star: Indices,
    wide: float,
    order: Codes,
    template: Matrix,
    own: Matrix,
    axes: Matrix,
    pair: Codes,
    allowed: Codes,
    found: Codes,
    some: Codes,
    frames: Matrix,
    places: Places,
    asks: Places,
    at: Matrix,
    best: Vector,
) -> int:
    """`try_pairs` with all members one by one: finished code that Python calls takes numbers and arrays alone."""
    spots = Spots(points, magnitude, sigma2, shears, focal_range, half_step, count, depth, known, faintest, contrast)
    sky = SkyArrays(stars, cells, near, brighter, cosines, pairs, k, line)
    levels = Levels(words, reach, half, begin, star, wide)
    work = Work(order, template, own, axes, pair, allowed, found, some, frames, places, asks, at, best)
    return promising(spots, sky, levels, work, tried, start, enough, A, match)


def try_pairs(
    spots: Spots,
    sky: SkyArrays,
    levels: Levels,
    work: Work,
    pairs: Codes,
    start: int,
    enough: float,
    A: Matrix,
    star: Codes,
) -> int:
    """Try pairs of spots (p, 2) from `start` on until one has a chance below `enough`: which, or p.

    Sets `Work.best`, and of that one the attitude (3, 3) and each spot's star (m,), -1 for none.
    """
    members = (*spots, *sky, *levels, *work)
    return try_numbers(pairs, start, enough, A, star, *members)
