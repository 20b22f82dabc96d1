"""A pair of spots taken for pairs of stars, at any scale: what a search without a focal length spends its time on.

Almost every pair of stars is a wrong one. Every spot is written once in the frame of its pair, along the sum, the
product and the difference of the two directions, none of them normed: in the same frame of two stars it then stands
where its star should be, whatever their distance, without a root or a quotient. Three spots near the pair are asked
first, of a block of pairs of stars at a time; whoever is left is asked more.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.evidence import log_choices
from relnav.sensors.dual_field.pair_table import k_range
from relnav.sensors.dual_field.screening import FEW_SPOTS
from relnav.sensors.dual_field.sky import SkyArrays, cell_of, nearest_star, place_of
from relnav.sensors.dual_field.spot_template import (
    ACROSS,
    ALONG,
    APART,
    HALF,
    LEVEL,
    LOG_LOOSE,
    LOG_TIGHT,
    LOOSE2,
    SPOT_NUMBERS,
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
from relnav.sensors.dual_field.star_levels import (
    LAST_WORD,
    Levels,
    bucket_of,
    nearest_chord2,
    nearest_of_list,
    noted,
    word_and_mask,
)

Places = NDArray[np.int64]

LEAST_FOUND = 3
"""Spots that must find a star beside the pair before a candidate is looked at."""

ASKED, ASKED_AGAIN, LEAST_AGAIN = 3, 10, 2
"""Of more than `FEW_SPOTS` spots the three nearest to the pair are asked first, as distortion moves them least: one
must find a star, then two of ten, before all are asked. Of 430 narrow frames, 180 of them half hidden, those solved
are the same as where one of three others was enough; with two of seven one real frame with many false spots is lost."""

BESIDE = 4.0
"""A spot closer to one of the pair than so many tolerances comes last: the pair's own star sets the bits of cells up to
that far away."""

FAINT = 30.0
"""A magnitude beyond all."""

BLOCK = 128
"""Pairs of stars that are asked the first questions together, so that no answer is waited for: their frames take up a
quarter of a processor's first cache."""

TURNED = 16
STRAIGHT = (1 << TURNED) - 1
"""Bits of a pair taken the other way round stand so much higher: no more than `FEW_SPOTS` are asked."""

PAIR, BIT, LIST, END = range(4)
ASKS = 2 * ASKED * BLOCK
"""Rows of `asks`: a pair of a block, the bit of `found` in question, and where in `Levels.star` its list begins and
ends; and how many questions there may be, one more being written before it is known whether it is one."""

TRIED, CHANCE, BEST_PAIR, SIGN, SHEAR, BEST_NUMBERS = range(6)
"""Entries of `best`: attitudes tried so far, and of the best one the logarithm of its false alarm probability, its pair
in the table, 1 or -1 for its order, and the tolerance under which it is the best."""


class Work(NamedTuple):
    """Scratch, and what the best is.

    Attributes
    ----------
    order : (m,)
        Spots in the order in which they are asked.
    template : (m, SPOT_NUMBERS)
        As of `spot_template`.
    own, axes : (6, 3), (3, 3)
        As of `frame_of_pair`, and the frame of one pair of stars.
    pair, allowed, found : (BLOCK,)
        Pairs of stars, which of their orders are to be tried, and which spots may have found a star.
    frames, places : (9, BLOCK), (4, BLOCK)
        Their frames, a row for each number, and the cells in which stars are looked for, both ways round.
    best : (BEST_NUMBERS,)
        See there.
    """

    order: Codes
    template: Matrix
    own: Matrix
    axes: Matrix
    pair: Codes
    allowed: Codes
    found: Codes
    some: Codes
    frames: Matrix
    places: Places
    asks: Places
    at: Matrix
    best: Vector


def new_work(spots: int) -> Work:
    """Scratch for so many spots."""
    pair, allowed, found, some = np.empty((4, BLOCK), dtype=np.int64)
    order, template, own = np.empty(spots, dtype=np.int64), np.empty((spots, SPOT_NUMBERS)), np.empty((6, 3))
    axes, best, frames = np.empty((3, 3)), np.zeros(BEST_NUMBERS), np.empty((9, BLOCK))
    places, asks = np.empty((4, BLOCK), dtype=np.int64), np.empty((4, ASKS + 1), dtype=np.int64)
    at = np.empty((5, ASKS + 1))
    return Work(order, template, own, axes, pair, allowed, found, some, frames, places, asks, at, best)


class Asked(NamedTuple):
    """How many spots are asked first, and then, how many of those must find a star, and how many of all spots."""

    first: int
    then: int
    least: int
    needed: int


@kernel
def ask(template: Matrix, row: int, levels: Levels, frames: Matrix, count: int, places: Places, found: Codes) -> None:
    """Whether a star may be where a spot should see it, for the first pairs of stars of a block.

    Sets bit `row` of `found` for a pair as it stands, and that `TURNED` up for it taken the other way round. Places
    come first, in a loop of nothing but arithmetic, so that several pairs are done in one instruction.
    """
    half = template[row, HALF]
    a, b, c = half * template[row, ALONG], half * template[row, ACROSS], half * template[row, APART]
    words = levels.words[int(template[row, LEVEL])]
    for k in range(count):
        x, y, z = half + a * frames[0, k], half + a * frames[1, k], half + a * frames[2, k]
        u = b * frames[3, k] + c * frames[6, k]
        v = b * frames[4, k] + c * frames[7, k]
        w = b * frames[5, k] + c * frames[8, k]
        places[0, k], places[1, k] = word_and_mask(place_of(int(x + u), int(y + v), int(z + w)))
        places[2, k], places[3, k] = word_and_mask(place_of(int(x - u), int(y - v), int(z - w)))
    for k in range(count):
        there = words[places[0, k] & LAST_WORD] & places[1, k] == places[1, k]
        turned = words[places[2, k] & LAST_WORD] & places[3, k] == places[3, k]
        found[k] |= (int(there) << row) | (int(turned) << (row + TURNED))


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
def list_questions(template: Matrix, row: int, way: int, some: int, q: int, levels: Levels, work: Work) -> int:
    """Add to the first q questions those of a spot, one way round, of `some` pairs: how many there are then."""
    frames, found, bit, sign = work.frames, work.found, row + TURNED * way, 1.0 - 2.0 * way
    a, b, c = template[row, ALONG], sign * template[row, ACROSS], sign * template[row, APART]
    first = q
    for s in range(some):
        k = work.some[s]
        work.asks[PAIR, q], work.asks[BIT, q] = k, bit
        q += (found[k] >> bit) & 1
    for s in range(first, q):
        k = work.asks[PAIR, s]
        x = a * frames[0, k] + b * frames[3, k] + c * frames[6, k]
        y = a * frames[1, k] + b * frames[4, k] + c * frames[7, k]
        z = a * frames[2, k] + b * frames[5, k] + c * frames[8, k]
        work.asks[LIST, s] = bucket_of(cell_of(levels.wide, x, y, z))
        work.at[0, s], work.at[1, s], work.at[2, s], work.at[3, s] = x, y, z, template[row, LOOSE2]
    return q


@kernel
def look_up(asked: Asked, some: int, spots: Spots, sky: SkyArrays, levels: Levels, work: Work) -> None:
    """Take away those bits of the first spots that no star within the wider tolerance is behind, of `some` pairs.

    All lists of stars are asked for before the first is read, so that many are waited for at once.
    """
    asks, at, found, q = work.asks, work.at, work.found, 0
    for row in range(asked.first):
        if work.template[row, LEVEL] < levels.reach.shape[0]:  # else no list reaches far enough, and the bit stays
            for way in range(2):
                q = list_questions(work.template, row, way, some, q, levels, work)
    for s in range(q):
        bucket = asks[LIST, s]
        asks[LIST, s], asks[END, s] = levels.begin[bucket], levels.begin[bucket + 1]
    for s in range(q):
        at[4, s] = sky.stars[levels.star[asks[LIST, s]], 0]
    for s in range(q):
        d2 = nearest_of_list(levels, sky.stars, spots.depth, asks[LIST, s], asks[END, s], at[0, s], at[1, s], at[2, s])
        found[asks[PAIR, s]] &= ~(int(d2 >= at[3, s]) << asks[BIT, s])


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
def write_frames(sky: SkyArrays, work: Work, count: int) -> None:
    """Write the frames of the first `count` pairs of stars of a block."""
    for k in range(count):
        a, c = sky.stars[sky.pairs[work.pair[k], 0]], sky.stars[sky.pairs[work.pair[k], 1]]
        x, y, z, u, v, w = a[0], a[1], a[2], c[0], c[1], c[2]
        frames = work.frames
        frames[0, k], frames[1, k], frames[2, k] = x + u, y + v, z + w
        frames[3, k], frames[4, k], frames[5, k] = y * w - z * v, z * u - x * w, x * v - y * u
        frames[6, k], frames[7, k], frames[8, k] = x - u, y - v, z - w


@kernel
def take_frame(work: Work, k: int) -> None:
    """Write the frame of one pair of a block into `axes`."""
    for number in range(9):
        work.axes[number // 3, number % 3] = work.frames[number, k]


@kernel
def keep_pair(work: Work, k: int, to: int) -> None:
    """Move a pair of a block to an earlier place, with what it has found."""
    work.pair[to], work.allowed[to], work.found[to] = work.pair[k], work.allowed[k], work.found[k]
    for number in range(9):
        work.frames[number, to] = work.frames[number, k]


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
    if asked.first <= ASKED:
        look_up(asked, some, spots, sky, levels, work)
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
def orders_of(spots: Spots, sky: SkyArrays, fainter: float, pair: int) -> int:
    """In which orders the brightness of a pair of stars fits spots of which the second is `fainter`: 1, 2, both, 0."""
    a, c = sky.stars[sky.pairs[pair, 0], 3], sky.stars[sky.pairs[pair, 1], 3]
    step, faintest = c - a, max(a, c)
    straight, crossed = abs(step - fainter) <= spots.contrast, abs(step + fainter) <= spots.contrast
    within = int(spots.known < faintest) & int(faintest <= spots.faintest)
    return within & int(straight) | (within & int(crossed)) << 1


@kernel
def collect(spots: Spots, sky: SkyArrays, fainter: float, pair: int, last: int, work: Work) -> tuple[int, int]:
    """Fill a block with pairs of stars whose brightness fits, from `pair` to before `last`.

    Returns the first pair that is not in it, and how many are. Without a branch on the stars, which are waited for.
    """
    count, tried, pairs, allowed = 0, 0, work.pair, work.allowed
    while pair < last and count < BLOCK:
        orders = orders_of(spots, sky, fainter, pair)
        pairs[count], allowed[count] = pair, (orders & 1) * STRAIGHT | (orders >> 1) * (STRAIGHT << TURNED)
        tried += (orders & 1) + (orders >> 1)
        count += int(orders != 0)
        pair += 1
    work.best[TRIED] += tried
    return pair, count


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
def try_pairs(spots: Spots, sky: SkyArrays, levels: Levels, pairs: Codes, start: int, enough: float, work: Work) -> int:
    """Try pairs of spots (p, 2) from `start` on until one has a chance below `enough`: which, or p; sets `best`."""
    for number in range(start, pairs.shape[0]):
        work.best[CHANCE] = enough
        try_scaled_pair(spots, sky, levels, pairs[number, 0], pairs[number, 1], work)
        if work.best[CHANCE] < enough:
            return number
    return int(pairs.shape[0])


@kernel
def read_best(spots: Spots, sky: SkyArrays, i: int, j: int, work: Work, A: Matrix, star: Codes) -> float:
    """Write the attitude (3, 3) of the best and each spot's star (m,), -1 for none; returns its scale."""
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
    return scale
