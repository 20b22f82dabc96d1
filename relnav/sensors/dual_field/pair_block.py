"""Pairs of stars by the block: whether stars are where the spots of a frame should see them, of a hundred at a time.

A pair of stars costs the time in which its numbers come from memory, unless there is other work meanwhile. So every
question is asked of a whole block before an answer is used, in loops without branches; those that are left are moved
together before the next.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.sky import SkyArrays, cell_of, place_of
from relnav.sensors.dual_field.spot_template import (
    ACROSS,
    ALONG,
    APART,
    HALF,
    LEVEL,
    LOOSE2,
    SPOT_NUMBERS,
    Spots,
)
from relnav.sensors.dual_field.star_levels import LAST_WORD, Levels, bucket_of, nearest_of_list, word_and_mask

Places = NDArray[np.int64]

BLOCK = 128
"""Pairs of stars in a block: their frames take up a quarter of a processor's first cache."""

TURNED = 16
STRAIGHT = (1 << TURNED) - 1
"""Bits of a pair taken the other way round stand so much higher: no more than `FEW_SPOTS` are asked."""

LOOKED_UP = 3
"""Spots whose stars are looked up of a whole block."""

PAIR, BIT, LIST, END = range(4)
QUESTIONS = 2 * LOOKED_UP * BLOCK
"""Rows of `asks`: a pair of a block, the bit of `found` in question, and where in `Levels.star` its list begins and
ends; and how many questions there may be, one more being written before it is known whether it is one."""

TRIED, CHANCE, BEST_PAIR, SIGN, SHEAR, SCALE, BEST_NUMBERS = range(7)
"""Entries of `best`: attitudes tried so far, and of the best one the logarithm of its false alarm probability, its pair
in the table, 1 or -1 for its order, the tolerance under which it is the best, and the scale of its spots."""


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
    pair, allowed, found, some : (BLOCK,)
        Pairs of stars, which of their orders are to be tried, which spots may have found a star, and the places in the
        block of those of which any has.
    frames, places : (9, BLOCK), (4, BLOCK)
        Their frames, a row for each number; word and bits of the cell in which a star is looked for, and again for the
        pair the other way round.
    asks, at : (4, QUESTIONS + 1), (5, QUESTIONS + 1)
        What is looked up, and where: direction, square of the tolerance, and a number that is read for nothing but to
        be at hand.
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
    places, asks = np.empty((4, BLOCK), dtype=np.int64), np.empty((4, QUESTIONS + 1), dtype=np.int64)
    at = np.empty((5, QUESTIONS + 1))
    return Work(order, template, own, axes, pair, allowed, found, some, frames, places, asks, at, best)


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
def look_up(rows: int, some: int, spots: Spots, sky: SkyArrays, levels: Levels, work: Work) -> None:
    """Take away those bits of the first spots that no star within the wider tolerance is behind, of `some` pairs.

    All lists of stars are asked for before the first is read, so that many are waited for at once.
    """
    asks, at, found, q = work.asks, work.at, work.found, 0
    for row in range(rows):
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
