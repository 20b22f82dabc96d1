"""The sky prepared for identification: stars in a grid of cells, and the table of bright pairs."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import entry, kernel
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


@dataclass(frozen=True, eq=False)
class Stars:
    """Stars of a sky sorted by cell, as `SkyArrays` and `Sky` have them; `arrays` is `SkyArrays.stars`."""

    arrays: Matrix
    cells: Indices
    near: Bits
    brighter: Vector
    hip: NDArray[np.int32]
    magnitudes: Vector


def sort_stars(directions: Matrix, magnitude: Vector, hip: NDArray[np.int32]) -> Stars:
    """Sort unit vectors (n, 3) into the grid."""
    cell = np.minimum(((directions + 1.0) * (0.5 * GRID)).astype(np.int64), GRID - 1) @ np.array([GRID * GRID, GRID, 1])
    order = np.argsort(cell, kind="stable")
    stars = np.ascontiguousarray(np.column_stack([directions, magnitude])[order])
    cells = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=GRID**3))]).astype(np.int32)
    steps = BRIGHTEST_MAG + MAG_STEP * np.arange(math.ceil((float(magnitude.max()) - BRIGHTEST_MAG) / MAG_STEP) + 2)
    ascending = np.sort(magnitude)
    brighter = np.searchsorted(ascending, steps, side="right").astype(np.float64)
    near = np.zeros(NEAR_BITS // 8, dtype=np.uint8)
    mark_near(stars, near, 0.5 * FINE, NEAR, np.empty(8, dtype=np.int64))
    return Stars(stars, cells, near, brighter, np.ascontiguousarray(hip[order]), ascending)


def build_sky(stars: Stars, *, pair_count: int, low_rad: float, high_rad: float) -> Sky:
    """Add pairs from `low_rad` to `high_rad` of the `pair_count` brightest, and those as bright."""
    bright = np.flatnonzero(stars.arrays[:, 3] <= stars.magnitudes[min(pair_count, len(stars.magnitudes)) - 1])
    alone = np.empty(len(bright), dtype=np.uint8)
    mark_alone(stars.arrays, stars.cells, bright, (2.0 * math.sin(0.5 * BLEND_RAD)) ** 2, alone)
    bright = bright[alone > 0]
    pairs = build_pair_table(stars.arrays[bright, :3], low_rad, high_rad, bright.astype(np.int32))
    grid = stars.arrays, stars.cells, stars.near, stars.brighter
    return Sky(SkyArrays(*grid, pairs.cos, pairs.stars, pairs.k, pairs.line), stars.hip, pairs, stars.magnitudes)


@kernel
def place_of(ix: int, iy: int, iz: int) -> int:
    """Where a cell stands in a hashed table, 63 bits of which the upper ones are spread best.

    The factors are the odd ones at 2^63 over g, g^2 and g^3, g^4 = g + 1, which keep cells of a small box far apart
    (Roberts 2018; of Knuth's golden ratio two powers add up to the third, and whole rows of cells fall together).
    """
    return (ix * 7555532853418227329 + iy * 6189284837581903361 + iz * 5070092016526739179) & 0x7FFFFFFFFFFFFFFF


@kernel
def touched(star: Vector, half: float, reach: float, beside: float, places: Codes) -> int:
    """Write the places of the cells within reach of a star, before they are cut to a table, into places (8,); how many.

    Cells, 2 `half` along each axis, are not narrower than 2 `reach`: the cube about the star touches those of its
    corners and no others. Of them count those that have a point beside the sphere by no more than `beside`.
    """
    width, count = 1.0 / half, 0
    inner, outer = (1.0 - beside) ** 2, (1.0 + beside) ** 2
    x_first, x_last = int((star[0] - reach + 1.0) * half), int((star[0] + reach + 1.0) * half)
    y_first, y_last = int((star[1] - reach + 1.0) * half), int((star[1] + reach + 1.0) * half)
    z_first, z_last = int((star[2] - reach + 1.0) * half), int((star[2] + reach + 1.0) * half)
    for x in range(x_first, min(x_first + 1, x_last) + 1):
        x_apart2, x_least2, x_most2 = of_cell(star[0], x * width - 1.0, width)
        for y in range(y_first, min(y_first + 1, y_last) + 1):
            y_apart2, y_least2, y_most2 = of_cell(star[1], y * width - 1.0, width)
            for z in range(z_first, min(z_first + 1, z_last) + 1):
                apart2, least2, most2 = of_cell(star[2], z * width - 1.0, width)
                near = int(x_apart2 + y_apart2 + apart2 <= reach * reach)
                places[count] = place_of(x, y, z)  # before it is known whether it counts: nothing waits for that
                count += near & int(x_least2 + y_least2 + least2 <= outer) & int(x_most2 + y_most2 + most2 >= inner)
    return count


@kernel
def of_cell(at: float, low: float, width: float) -> tuple[float, float, float]:
    """Along one axis of a cell from `low` on, squared: its distance from `at`, its least and most from the origin."""
    return max(0.0, low - at, at - low - width) ** 2, max(0.0, low, -low - width) ** 2, max(low + width, -low) ** 2


@entry
def mark_near(stars: Matrix, near: Bits, half: float, reach: float, places: Codes) -> None:
    """Set the bits of all cells, 2 `half` along each axis, that have a point within reach of a star; places (8,)."""
    for s in range(stars.shape[0]):
        for k in range(touched(stars[s], half, reach, reach, places)):
            place = (places[k] >> 40) & (8 * near.shape[0] - 1)
            near[place >> 3] |= 1 << (place & 7)


@kernel
def cell_of(half: float, x: float, y: float, z: float) -> int:
    """The place of the cell of the unit vector (x, y, z), before it is cut to a table."""
    return place_of(int(x * half + half), int(y * half + half), int(z * half + half))


@kernel
def marked(near: Bits, half: float, x: float, y: float, z: float) -> int:
    """The bit of the cell of the unit vector (x, y, z); `half` as many cells as there are along each axis."""
    place = (cell_of(half, x, y, z) >> 40) & (8 * near.shape[0] - 1)
    return int((near[place >> 3] >> (place & 7)) & 1)


@entry
def mark_alone(stars: Matrix, cells: Indices, chosen: Codes, chord2: float, alone: Bits) -> None:
    """Write for the chosen stars whether no neighbour within the chord squared is less than two magnitudes fainter."""
    half, reach = 0.5 * GRID, math.sqrt(chord2)
    for k in range(chosen.shape[0]):
        s, near = chosen[k], 0
        x, y, z = stars[s, 0], stars[s, 1], stars[s, 2]
        for ix in range(max(0, int((x - reach + 1.0) * half)), min(GRID - 1, int((x + reach + 1.0) * half)) + 1):
            for iy in range(max(0, int((y - reach + 1.0) * half)), min(GRID - 1, int((y + reach + 1.0) * half)) + 1):
                for iz in range(
                    max(0, int((z - reach + 1.0) * half)), min(GRID - 1, int((z + reach + 1.0) * half)) + 1
                ):
                    cell = (ix * GRID + iy) * GRID + iz
                    for t in range(cells[cell], cells[cell + 1]):
                        d2 = (stars[t, 0] - x) ** 2 + (stars[t, 1] - y) ** 2 + (stars[t, 2] - z) ** 2
                        near += t != s and d2 <= chord2 and stars[t, 3] <= stars[s, 3] + 2.0
        alone[k] = near == 0


@lru_cache(maxsize=8)
def prepare_stars(
    catalogue: StarCatalogue,
    epoch_jyear: float,
    faintest: float,
    velocity_km_s: tuple[float, float, float] | None = None,
) -> Stars:
    """The stars of a catalogue at an epoch down to a magnitude, made once; with a velocity as they are seen."""
    part = slice(0, int(np.searchsorted(catalogue.hp_mag, faintest, side="right")))
    return sort_stars(
        catalogue.directions(epoch_jyear, velocity_km_s=velocity_km_s, stars=part),
        np.asarray(catalogue.hp_mag[part], dtype=np.float64),
        catalogue.hip[part],
    )


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
    stars = prepare_stars(catalogue, epoch_jyear, faintest, velocity_km_s)
    pair_count = int(np.searchsorted(stars.magnitudes, faintest_pair, side="right"))
    return build_sky(stars, pair_count=pair_count, low_rad=low_rad, high_rad=high_rad)


@kernel
def none_near(near: Bits, x: float, y: float, z: float, chord2: float) -> bool:
    """Whether it is plain that no star is closer than the chord squared to the unit vector (x, y, z)."""
    return bool(chord2 <= NEAR * NEAR and marked(near, 0.5 * FINE, x, y, z) == 0)


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
