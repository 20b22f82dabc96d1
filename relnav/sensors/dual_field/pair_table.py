"""Star pairs sorted by the cosine of their angle, with a K-vector to find a range of it without a search.

Pairs on a sphere are uniform in the cosine, so the K-vector's straight line (Mortari 1997) fits it everywhere. Table
one of the patent holds the pairs of one field, table two those across two fields.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel

Indices = NDArray[np.int32]

MOST_CELLS = 64
"""Along each axis of the cube around the sphere, in which neighbours are looked for."""


@dataclass(frozen=True, eq=False)
class PairTable:
    """All pairs of stars whose angle lies in a range.

    Attributes
    ----------
    cos : (p,)
        Cosines, ascending.
    stars : (p, 2)
        The two stars of each pair, as indices into the directions it was built from.
    k : (b + 1,)
        K-vector: k[i] pairs have a cosine below `start + i * step`, up to rounding.
    line : (2,)
        start, step.
    """

    cos: Vector
    stars: Indices
    k: Indices
    line: Vector

    def __len__(self) -> int:
        return len(self.cos)

    def query(self, low_rad: float, high_rad: float) -> Indices:
        """Pairs (m, 2) with an angle from low to high."""
        first, last = k_range(self.cos, self.k, self.line, float(np.cos(high_rad)), float(np.cos(low_rad)))
        return self.stars[first:last]


def build_pair_table(directions: Matrix, low_rad: float, high_rad: float) -> PairTable:
    """Table of all pairs of the unit vectors (n, 3) with an angle from low to high, 0 <= low < high <= pi.

    Raises
    ------
    ValueError
        For another range.
    """
    if not 0.0 <= low_rad < high_rad <= np.pi:
        raise ValueError(f"a range of angles 0 <= low < high <= pi is expected; got {low_rad} to {high_rad} rad")
    low, high = float(np.cos(high_rad)), float(np.cos(low_rad))
    across = min(MOST_CELLS, max(1, int(2.0 / max(2.0 * np.sin(0.5 * high_rad), 1e-9) * (1.0 - 1e-9))))
    cell = np.minimum(((directions + 1.0) * (0.5 * across)).astype(np.int64), across - 1)
    place = cell @ np.array([across * across, across, 1])
    order = np.argsort(place, kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(place, minlength=across**3))])
    v = np.ascontiguousarray(directions[order])
    expected = max(1, int(0.06 * len(v) ** 2 * (high - low)))
    line, k = np.array([low, max((high - low) / expected, 1e-15)]), np.zeros(expected + 1, dtype=np.int32)
    walk_pairs(v, begin, across, low, high, line, k, NO_COSINES, NO_PAIRS)
    k = np.concatenate([[0], np.cumsum(k[:-1])]).astype(np.int32)
    cosine, pairs = np.empty(k[-1]), np.empty((k[-1], 2), dtype=np.int32)
    walk_pairs(v, begin, across, low, high, line, k[:-1].copy(), cosine, pairs)
    sort_buckets(k, cosine, pairs)
    return PairTable(cosine, order.astype(np.int32)[pairs], k, line)


NO_COSINES, NO_PAIRS = np.empty(0), np.empty((0, 2), dtype=np.int32)


@kernel
def walk_pairs(
    v: Matrix,
    begin: Codes,
    across: int,
    low: float,
    high: float,
    line: Vector,
    at: Indices,
    cosines: Vector,
    pairs: Indices,
) -> None:
    """Go through the pairs of unit vectors (n, 3), sorted by cell, with low <= cosine <= high.

    Counts them in `at` (b + 1,), by where their cosine stands on `line`; with cosines (p,) and pairs (p, 2) it writes
    them instead, each to its place in `at`, which is moved.
    """
    last, write = at.shape[0] - 2 if cosines.shape[0] == 0 else at.shape[0] - 1, cosines.shape[0] > 0
    scale = 1.0 / line[1]
    for cell in range(across * across * across):
        x, y, z = cell // (across * across), cell // across % across, cell % across
        for a in range(begin[cell], begin[cell + 1]):
            a0, a1, a2 = v[a, 0], v[a, 1], v[a, 2]
            for near in range(13, 27):  # itself and half of its neighbours: every pair of cells once
                p, q, r = x + near // 9 - 1, y + near // 3 % 3 - 1, z + near % 3 - 1
                if p >= across or q < 0 or q >= across or r < 0 or r >= across:
                    continue
                other = (p * across + q) * across + r
                for b in range(a + 1 if near == 13 else begin[other], begin[other + 1]):
                    cosine = a0 * v[b, 0] + a1 * v[b, 1] + a2 * v[b, 2]
                    if low <= cosine <= high:
                        bucket = min(int((cosine - line[0]) * scale), last)
                        if write:
                            cosines[at[bucket]], pairs[at[bucket], 0], pairs[at[bucket], 1] = cosine, a, b
                        at[bucket] += 1


@kernel
def sort_buckets(k: Indices, cosines: Vector, pairs: Indices) -> None:
    """Sort cosines and their pairs, in buckets that ascend, within each bucket."""
    for bucket in range(k.shape[0] - 1):
        for place in range(k[bucket] + 1, k[bucket + 1]):
            cosine, a, b, to = cosines[place], pairs[place, 0], pairs[place, 1], place
            while to > k[bucket] and cosines[to - 1] > cosine:
                cosines[to], pairs[to, 0], pairs[to, 1] = cosines[to - 1], pairs[to - 1, 0], pairs[to - 1, 1]
                to -= 1
            cosines[to], pairs[to, 0], pairs[to, 1] = cosine, a, b


@kernel
def k_range(cosines: Vector, k: Indices, line: Vector, low: float, high: float) -> tuple[int, int]:
    """First and one past the last pair with low <= cosine <= high."""
    n, steps = cosines.shape[0], k.shape[0] - 1
    if n == 0 or high < cosines[0] or low > cosines[n - 1] or low > high:
        return 0, 0
    first, last = 0, n
    if low > cosines[0]:
        first = k[min(steps, max(0, int((low - line[0]) / line[1]) - 1))]
        while first > 0 and cosines[first - 1] >= low:
            first -= 1
        while first < n and cosines[first] < low:
            first += 1
    if high < cosines[n - 1]:
        last = k[min(steps, max(0, int((high - line[0]) / line[1]) + 1))]
        while last < n and cosines[last] <= high:
            last += 1
        while last > 0 and cosines[last - 1] > high:
            last -= 1
    return first, last
