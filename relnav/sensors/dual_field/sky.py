"""The sky prepared for identification: stars in a grid of cells, and the table of bright pairs."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.catalogue import StarCatalogue
from relnav.sensors.dual_field.pair_table import Indices, PairTable, build_pair_table

Bits = NDArray[np.uint8]

BRIGHTEST_MAG, MAG_STEP = -2.0, 1.0 / 32.0
"""Magnitudes at which stars are counted."""

GRID = 40
"""Cells along each axis of the cube around the unit sphere: 2.9 deg, one to three stars in an occupied cell, and the
table of cells fits a processor's cache."""

NEAR = 1e-3
"""A point farther than this, rad, from every star is refused by one look at `SkyArrays.near`, as 97 in 100 are."""

FINE, NEAR_BITS = 512, 1 << 21
"""Cells of that table along each axis, wider than 2 `NEAR`, and places that they share, hashed."""

BLEND_RAD = math.radians(60.0 / 3600.0)
"""Stars closer than this make one spot whose centre is neither: pairs of the table are not built on them."""


class SkyArrays(NamedTuple):
    """What the kernels read of a sky.

    Attributes
    ----------
    stars : (n, 4)
        Direction and magnitude, sorted by cell.
    cells : (GRID^3 + 1,)
        Where each cell's stars begin.
    near : (NEAR_BITS / 8,)
        Bits: whether a star is within `NEAR` of any point of a fine cell.
    brighter : (m,)
        Stars not fainter than `BRIGHTEST_MAG` + i `MAG_STEP`; the last one counts all.
    cosines, pairs, k, line : (p,), (p, 2), (p + 1,), (2,)
        The pair table, its stars as rows of `stars`.
    """

    stars: Matrix
    cells: Indices
    near: Bits
    brighter: Vector
    cosines: Vector
    pairs: Indices
    k: Indices
    line: Vector


@dataclass(frozen=True, eq=False)
class Sky:
    """Stars as the search wants them.

    Attributes
    ----------
    arrays : SkyArrays
        What the kernels read.
    hip : (n,)
        Hipparcos numbers, in the order of `arrays.stars`.
    pairs : PairTable
        Pairs of the brighter stars within the field's width.
    magnitudes : (n,)
        Of all stars, ascending.
    """

    arrays: SkyArrays
    hip: NDArray[np.int32]
    pairs: PairTable
    magnitudes: Vector

    def __len__(self) -> int:
        return len(self.hip)


def build_sky(
    directions: Matrix, magnitude: Vector, hip: NDArray[np.int32], *, pair_count: int, low_rad: float, high_rad: float
) -> Sky:
    """Prepare unit vectors (n, 3): pairs from `low_rad` to `high_rad` of the `pair_count` brightest, grid of all."""
    cell = np.minimum(((directions + 1.0) * (0.5 * GRID)).astype(np.int64), GRID - 1) @ np.array([GRID * GRID, GRID, 1])
    order = np.argsort(cell, kind="stable")
    stars = np.ascontiguousarray(np.column_stack([directions, magnitude])[order])
    cells = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=GRID**3))]).astype(np.int32)
    bright = np.sort(np.argsort(stars[:, 3], kind="stable")[:pair_count])
    bright = bright[_alone(stars, bright)]
    table = build_pair_table(stars[bright, :3], low_rad, high_rad)
    pairs = PairTable(table.cos, bright.astype(np.int32)[table.stars], table.k, table.line)
    steps = BRIGHTEST_MAG + MAG_STEP * np.arange(math.ceil((float(magnitude.max()) - BRIGHTEST_MAG) / MAG_STEP) + 2)
    ascending = np.sort(magnitude)
    brighter = np.searchsorted(ascending, steps, side="right").astype(np.float64)
    near = np.zeros(NEAR_BITS // 8, dtype=np.uint8)
    mark_near(stars, near)
    arrays = SkyArrays(stars, cells, near, brighter, pairs.cos, pairs.stars, pairs.k, pairs.line)
    return Sky(arrays, np.ascontiguousarray(hip[order]), pairs, ascending)


@kernel
def place_of_cell(ix: int, iy: int, iz: int) -> int:
    """Where a fine cell stands in `SkyArrays.near`: the hash of Teschner et al. (2003), section 3."""
    return ((ix * 73856093) ^ (iy * 19349663) ^ (iz * 83492791)) & (NEAR_BITS - 1)


@kernel
def mark_near(stars: Matrix, near: Bits) -> None:
    """Set the bits of `SkyArrays.near`: a cube of 2 `NEAR` about a star touches the cells of its corners, no others."""
    half = 0.5 * FINE
    for s in range(stars.shape[0]):
        for corner in range(8):
            dx, dy, dz = (
                (NEAR if corner & 1 else -NEAR),
                (NEAR if corner & 2 else -NEAR),
                (NEAR if corner & 4 else -NEAR),
            )
            x, y, z = stars[s, 0] + dx + 1.0, stars[s, 1] + dy + 1.0, stars[s, 2] + dz + 1.0
            place = place_of_cell(int(x * half), int(y * half), int(z * half))
            near[place >> 3] |= 1 << (place & 7)


def _alone(stars: Matrix, chosen: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of the chosen stars have no neighbour within the blend distance less than two magnitudes fainter."""
    from scipy.spatial import cKDTree

    alone = np.ones(len(stars), dtype=bool)
    for i, j in cKDTree(stars[:, :3]).query_pairs(2.0 * math.sin(0.5 * BLEND_RAD)):
        faint, bright = (i, j) if stars[i, 3] > stars[j, 3] else (j, i)
        alone[faint] = False
        alone[bright] &= stars[faint, 3] > stars[bright, 3] + 2.0
    return alone[chosen]


@lru_cache(maxsize=8)
def prepare_sky(
    catalogue: StarCatalogue,
    epoch_jyear: float,
    faintest: float,
    faintest_pair: float,
    low_rad: float,
    high_rad: float,
    velocity_km_s: tuple[float, float, float] | None = None,
) -> Sky:
    """The sky of a catalogue at an epoch, made once: stars down to `faintest`, pairs down to `faintest_pair`, mag.

    With a velocity the directions are apparent ones. The default search needs no such sky: it takes the velocity
    itself, so that a sky serves a whole orbit.
    """
    count = int(np.searchsorted(catalogue.hp_mag, faintest, side="right"))
    pair_count = int(np.searchsorted(catalogue.hp_mag[:count], faintest_pair, side="right"))
    part = slice(0, count)
    return build_sky(
        catalogue.directions(epoch_jyear, velocity_km_s=velocity_km_s, stars=part),
        np.asarray(catalogue.hp_mag[part], dtype=np.float64),
        catalogue.hip[part],
        pair_count=pair_count,
        low_rad=low_rad,
        high_rad=high_rad,
    )


@kernel
def none_near(near: Bits, x: float, y: float, z: float, chord2: float) -> bool:
    """Whether it is plain that no star is closer than the chord squared to the unit vector (x, y, z)."""
    half = 0.5 * FINE
    place = place_of_cell(int((x + 1.0) * half), int((y + 1.0) * half), int((z + 1.0) * half))
    return bool(chord2 <= NEAR * NEAR and ((near[place >> 3] >> (place & 7)) & 1) == 0)


@kernel
def nearest_star(
    stars: Matrix, cells: Indices, x: float, y: float, z: float, chord2: float, magnitude: float, gate: float
) -> int:
    """The star nearest to the unit vector (x, y, z), closer than the chord squared and within the gate; -1 if none."""
    half = 0.5 * GRID
    r = math.sqrt(chord2)
    best, best2 = -1, chord2
    for ix in range(max(0, int((x - r + 1.0) * half)), min(GRID - 1, int((x + r + 1.0) * half)) + 1):
        for iy in range(max(0, int((y - r + 1.0) * half)), min(GRID - 1, int((y + r + 1.0) * half)) + 1):
            for iz in range(max(0, int((z - r + 1.0) * half)), min(GRID - 1, int((z + r + 1.0) * half)) + 1):
                cell = (ix * GRID + iy) * GRID + iz
                for s in range(cells[cell], cells[cell + 1]):
                    dx, dy, dz = stars[s, 0] - x, stars[s, 1] - y, stars[s, 2] - z
                    d2 = dx * dx + dy * dy + dz * dz
                    if d2 < best2 and abs(stars[s, 3] - magnitude) <= gate:
                        best, best2 = s, d2
    return best
