"""Where stars are near, at a look: for a search that asks it of a million directions with one of a few tolerances.

A cell of the sphere has three bits of a hashed table for each tolerance. Where they are set the stars about the cell
are listed, and their distances decide.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.sensors.dual_field.pair_table import Indices
from relnav.sensors.dual_field.sky import Stars, cell_of, touched

WORDS, BUCKETS = 1 << 16, 1 << 17
"""Words of a table, half a megabyte, and lists of stars, named by the upper bits of `sky.place_of`. A cell has three
bits of one word, one of each sixteen (a blocked Bloom filter: Putze, Sanders and Singler 2007), so that chance sets
those of one cell in a hundred."""

LAST_WORD = WORDS - 1
"""A word's number lies within these bits; to say so spares a compiled loop the question whether it is negative."""

PADDED, BESIDE = 1.05, 0.3
"""A table is made for tolerances wider by this, and for directions beside the sphere by so many of them: what is looked
up is not normed."""

FINEST = 200.0
"""Cells along each axis of the grid that lists stars, at the most: there are fewer stars than it has cells."""


class Levels(NamedTuple):
    """Where the stars of a sky are.

    Attributes
    ----------
    words, reach, half : (l + 1, WORDS), (l,), (l,)
        A table of bits for each of some growing tolerances, rad, and half as many cells as along an axis. The last
        table says of everything that a star may be near.
    begin, star : (BUCKETS + 1,), (s + 1,)
        Rows of the stars within the largest tolerance of a cell, cells hashed: where a list begins, and all lists. One
        more row is for whoever reads where a list begins without asking whether it has any.
    wide : float
        Half as many cells as along an axis of that grid.
    """

    words: Codes
    reach: Vector
    half: Vector
    begin: Indices
    star: Indices
    wide: float


@lru_cache(maxsize=8)
def levels_for(stars: Stars, reach_rad: tuple[float, ...]) -> Levels:
    """Tables of some stars for tolerances that ascend, made once."""
    reach, places = PADDED * np.array(reach_rad), np.empty(8, dtype=np.int64)
    words = np.zeros((len(reach) + 1, WORDS), dtype=np.int64)
    words[-1] = -1
    for near, far in zip(words[:-1], reach, strict=True):
        note_near(stars.arrays, 0.5 / far, far, near, places)
    far = float(reach[-1])
    wide = 0.5 * min(FINEST, 1.0 / far)
    begin = np.zeros(BUCKETS + 1, dtype=np.int32)
    count_touched(stars.arrays, wide, far, begin, places)
    begin = np.cumsum(begin, dtype=np.int32)
    star = np.zeros(int(begin[-1]) + 1, dtype=np.int32)
    fill_touched(stars.arrays, wide, far, begin[:-1].copy(), star, places)
    return Levels(words, np.array(reach_rad), 0.5 / reach, begin, star, wide)


@kernel
def word_and_mask(place: int) -> tuple[int, int]:
    """Which word of a table a cell has, and its three bits of it: `place` as of `sky.place_of`."""
    mask = (1 << ((place >> 43) & 15)) | (1 << (16 + ((place >> 39) & 15)))
    return place >> 47, mask | (1 << (32 + ((place >> 35) & 15)))


@kernel
def noted(words: Codes, place: int) -> int:
    """1 where a star may be near a cell, else 0; `place` as of `sky.place_of`."""
    word, mask = word_and_mask(place)
    return int(words[word] & mask == mask)


@kernel
def bucket_of(place: int) -> int:
    """Which list of stars a cell has."""
    return place >> 46


@entry
def note_near(stars: Matrix, half: float, reach: float, words: Codes, places: Codes) -> None:
    """Note all cells, 2 `half` along each axis, that have a point of the sphere within reach of a star; places (8,)."""
    for s in range(stars.shape[0]):
        for k in range(touched(stars[s], half, reach, BESIDE * reach, places)):
            word, mask = word_and_mask(places[k])
            words[word] |= mask


@entry
def count_touched(stars: Matrix, half: float, reach: float, count: Indices, places: Codes) -> None:
    """Add up in count (BUCKETS + 1,), from its second entry on, how many stars each list gets; places (8,) scratch."""
    for s in range(stars.shape[0]):
        for k in range(touched(stars[s], half, reach, BESIDE * reach, places)):
            count[1 + bucket_of(places[k])] += 1


@entry
def fill_touched(stars: Matrix, half: float, reach: float, begin: Indices, out: Indices, places: Codes) -> None:
    """Write those lists, each from its place in begin (BUCKETS,) on, which is moved."""
    for s in range(stars.shape[0]):
        for k in range(touched(stars[s], half, reach, BESIDE * reach, places)):
            bucket = bucket_of(places[k])
            out[begin[bucket]] = s
            begin[bucket] += 1


@kernel
def nearest_chord2(levels: Levels, stars: Matrix, depth: float, x: float, y: float, z: float) -> float:
    """Square of the distance of the nearest listed star not fainter than `depth`; 5 where none is listed."""
    bucket = bucket_of(cell_of(levels.wide, x, y, z))
    return nearest_of_list(levels, stars, depth, levels.begin[bucket], levels.begin[bucket + 1], x, y, z)


@kernel
def nearest_of_list(
    levels: Levels, stars: Matrix, depth: float, first: int, last: int, x: float, y: float, z: float
) -> float:
    """The same of the stars of one list."""
    best2 = 5.0
    for item in range(first, last):
        v = stars[levels.star[item]]
        d2 = (v[0] - x) ** 2 + (v[1] - y) ** 2 + (v[2] - z) ** 2
        best2 = min(best2, d2 if v[3] <= depth else 5.0)
    return float(best2)
