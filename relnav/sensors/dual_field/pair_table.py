"""Star pairs sorted by the cosine of their angle, with a K-vector to find a range of it without a search.

Pairs on a sphere are uniform in the cosine, so the K-vector's straight line (Mortari 1997) fits it everywhere. Table
one of the patent holds the pairs of one field, table two those across two fields.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import entry, kernel

Indices = NDArray[np.int32]

MOST_CELLS = 64
"""Along each axis of the cube around the sphere, in which neighbours are looked for."""

CROWDED = 1.5
"""Room for pairs, in those of as many stars spread evenly; where it is not enough they are looked for again."""


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


def build_pair_table(directions: Matrix, low_rad: float, high_rad: float, names: Indices | None = None) -> PairTable:
    """Table of all pairs of the unit vectors (n, 3) with an angle from low to high, 0 <= low < high <= pi.

    Its stars are rows of `directions`, or what `names` (n,) calls them.

    Raises
    ------
    ValueError
        For another range.
    """
    if not 0.0 <= low_rad < high_rad <= np.pi:
        raise ValueError(f"a range of angles 0 <= low < high <= pi is expected; got {low_rad} to {high_rad} rad")
    low, high, n = float(np.cos(high_rad)), float(np.cos(low_rad)), len(directions)
    across = min(MOST_CELLS, max(1, int(2.0 / max(2.0 * np.sin(0.5 * high_rad), 1e-9) * (1.0 - 1e-9))))
    cell = np.minimum(((directions + 1.0) * (0.5 * across)).astype(np.int64), across - 1)
    place = cell @ np.array([across * across, across, 1])
    order = np.argsort(place, kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(place, minlength=across**3))])
    v, names = np.ascontiguousarray(directions[order].T), order.astype(np.int32) if names is None else names[order]
    uniform = 0.25 * n**2 * (high - low)
    count, room = 1, 0
    while count > room:  # once, unless the stars crowd more than was allowed for
        room = min(n * n // 2, max(count, int(CROWDED * uniform)))
        cosines, pairs = np.empty(room + 1), np.empty((room + 1, 2), dtype=np.int32)
        count = find_pairs(v, names, begin, across, low, high, np.empty(n), cosines, pairs)
    expected = max(1, int(0.25 * uniform))
    line, k = np.array([low, max((high - low) / expected, 1e-15)]), np.zeros(expected + 1, dtype=np.int32)
    cosine, found = np.empty(count), np.empty((count, 2), dtype=np.int32)
    sort_pairs(cosines[:count], pairs[:count], line, k, cosine, found)
    return PairTable(cosine, found, k, line)


@entry
def find_pairs(
    v: Matrix,
    names: Indices,
    begin: Codes,
    across: int,
    low: float,
    high: float,
    dots: Vector,
    cosines: Vector,
    pairs: Indices,
) -> int:
    """Write pairs of unit vectors (3, n), sorted by cell, with low <= cosine <= high; returns how many there are.

    Those for which there is no room are counted alone; dots (n,) is scratch. A pair is written before it is known
    whether it is one: nothing waits for that.
    """
    count, room = 0, cosines.shape[0] - 1
    for cell in range(across * across * across):
        if begin[cell] == begin[cell + 1]:
            continue
        x, y, z = cell // (across * across), cell // across % across, cell % across
        for near in range(5):  # half of its neighbours, so that every pair of cells comes once: rows of them along z
            p, q = x + (near >= 2), y + (0, 1, -1, 0, 1)[near]
            if p >= across or q < 0 or q >= across:
                continue
            row = (p * across + q) * across
            first, last = begin[row + max(z - 1, 0)], begin[row + min(z + 1, across - 1) + 1]
            for a in range(begin[cell], begin[cell + 1]):
                a0, a1, a2, name = v[0, a], v[1, a], v[2, a], names[a]
                start = a + 1 if near == 0 else first  # of its own row those that come after it
                for b in range(last - start):
                    dots[b] = a0 * v[0, start + b] + a1 * v[1, start + b] + a2 * v[2, start + b]
                for b in range(last - start):
                    at = min(count, room)
                    cosines[at], pairs[at, 0], pairs[at, 1] = dots[b], name, names[start + b]
                    count += int(low <= dots[b]) & int(dots[b] <= high)
    return count


@entry
def sort_pairs(
    cosines: Vector, pairs: Indices, line: Vector, k: Indices, sorted_cosines: Vector, sorted_pairs: Indices
) -> None:
    """Write cosines and their pairs in ascending order, and fill k (b + 1,), zeros before."""
    last, scale, total = k.shape[0] - 2, 1.0 / line[1], 0
    for place in range(cosines.shape[0]):
        k[min(int((cosines[place] - line[0]) * scale), last)] += 1
    for bucket in range(k.shape[0]):
        total += k[bucket]
        k[bucket] = total
    for back in range(cosines.shape[0]):
        place = cosines.shape[0] - 1 - back
        bucket = min(int((cosines[place] - line[0]) * scale), last)
        k[bucket] -= 1
        to = k[bucket]
        sorted_cosines[to], sorted_pairs[to, 0], sorted_pairs[to, 1] = cosines[place], pairs[place, 0], pairs[place, 1]
    sort_buckets(k, sorted_cosines, sorted_pairs)


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
