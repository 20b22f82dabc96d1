"""Star pairs sorted by the cosine of their angle, with a K-vector to find a range of it without a search.

Pairs on a sphere are uniform in the cosine, so the K-vector's straight line (Mortari 1997) fits it everywhere. Table
one of the patent holds the pairs of one field, table two those across two fields.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel

Indices = NDArray[np.int32]

WIDE_RAD = 0.7
"""From this angle on all pairs are looked at."""


@dataclass(frozen=True, eq=False)
class PairTable:
    """All pairs of stars whose angle lies in a range.

    Attributes
    ----------
    cos : (p,)
        Cosines, ascending.
    stars : (p, 2)
        The two stars of each pair, as indices into the directions it was built from.
    k : (p + 1,)
        K-vector: k[i] pairs have a cosine of at most `start + i * step`.
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
    pairs = _close_pairs(directions, high_rad) if high_rad < WIDE_RAD else _all_pairs(directions, low_rad, high_rad)
    cosine = np.einsum("ij,ij->i", directions[pairs[:, 0]], directions[pairs[:, 1]])
    kept = (cosine <= np.cos(low_rad)) & (cosine >= np.cos(high_rad))
    pairs, cosine = pairs[kept], cosine[kept]
    order = np.argsort(cosine, kind="stable")
    pairs, cosine = np.ascontiguousarray(pairs[order]), np.ascontiguousarray(cosine[order])
    line = np.array([cosine[0], max(cosine[-1] - cosine[0], 1e-15) / len(cosine)]) if len(cosine) else np.ones(2)
    k = np.searchsorted(cosine, line[0] + line[1] * np.arange(len(cosine) + 1), side="right").astype(np.int32)
    return PairTable(cosine, pairs, k, line)


def _close_pairs(directions: Matrix, high_rad: float) -> Indices:
    from scipy.spatial import cKDTree

    reach = 2.0 * np.sin(0.5 * high_rad) * (1.0 + 1e-9)
    return cKDTree(directions).query_pairs(reach, output_type="ndarray").astype(np.int32)


def _all_pairs(directions: Matrix, low_rad: float, high_rad: float) -> Indices:
    """Pairs by their cosines, block after block: for a band so wide that a tree saves nothing."""
    low, high = np.cos(high_rad) - 1e-12, np.cos(low_rad) + 1e-12
    found = []
    for begin in range(0, len(directions), 512):
        cosine = directions[begin : begin + 512] @ directions[begin:].T
        i, j = np.nonzero((cosine >= low) & (cosine <= high))
        found.append(np.column_stack([i, j])[j > i].astype(np.int32) + np.int32(begin))
    return np.concatenate(found) if found else np.empty((0, 2), dtype=np.int32)


@kernel
def k_range(cosines: Vector, k: Indices, line: Vector, low: float, high: float) -> tuple[int, int]:
    """First and one past the last pair with low <= cosine <= high."""
    n = cosines.shape[0]
    if n == 0 or high < cosines[0] or low > cosines[n - 1] or low > high:
        return 0, 0
    first, last = 0, n
    if low > cosines[0]:
        first = k[min(n, max(0, int((low - line[0]) / line[1]) - 1))]
        while first > 0 and cosines[first - 1] >= low:
            first -= 1
        while first < n and cosines[first] < low:
            first += 1
    if high < cosines[n - 1]:
        last = k[min(n, max(0, int((high - line[0]) / line[1]) + 1))]
        while last < n and cosines[last] <= high:
            last += 1
        while last > 0 and cosines[last - 1] > high:
            last -= 1
    return first, last
