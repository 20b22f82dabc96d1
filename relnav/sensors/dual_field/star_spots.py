"""From a picture of the sky to its star spots: background, hot and full pixels, centroids with covariance.

Background and noise are clipped means over boxes, as of Bertin, Arnouts (1996), "SExtractor: Software for source
extraction". Every peak of the lightly smoothed picture that stands out of its noise is a candidate. Its centre is where
the light under a Gaussian window is balanced, a window as wide as this picture's stars (SExtractor's "windowed
positional parameters"); what is not as wide as a star is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from relnav.arrays import Flags, Matrix, Stack, Vector, number, numbers
from relnav.sensors.dual_field.sky_background import Dark, subtract_background
from relnav.sensors.dual_field.star_peaks import PEAK_PX, find_peaks, without_doubles
from relnav.sensors.dual_field.star_smear import FEWEST, SMEARED, Smear, pooled, shapes_from

FIRST_PIXEL_PX = 0.0
"""Coordinate of the centre of a picture's first pixel, here and in all of relnav."""

NO_COUNTS = 1e15
"""No detector counts so far; squares of what is below stay within single precision."""
MOST_STARS = 1000
HOT = 0.3
"""Of the brightest pixel: its eight neighbours together hold more in any picture that a lens makes."""
SMOOTH_NOISE = 0.375
"""Noise of the smoothed picture, of a pixel's: sqrt(1 + 4 + 1)/4 along each axis, where neighbours have their own."""
LARGE = 0.25
"""Of the brightest pixel: along the border of a star's stamp there is less on average; beside the Moon is more."""
BESIDE, BESIDE_HEIGHT = 3.5, 0.05
"""Two peaks within so many window radii, one so high in terms of the other, are two stars in one."""
WIDE, LEAN = 1.5, 0.2
"""Light moments under the window, of a typical star's: a spot beyond is no star; a difference along and across, of
their sum: a spot beyond is two stars, or moved."""
NARROWEST_PX, WIDEST_PX, LEAST_WINDOW_PX, FIRST_WINDOW_PX = 0.45, 4.0, 1.0, 1.5
"""1-sigma radius of a star: limits; of a window: least, and where the search begins."""
UNEVEN_ERROR_PX = 0.005
"""1-sigma of a centre from pixels that respond unequally."""
FULL_ERROR_PX = 0.15
"""The same for a star whose top is cut off by full pixels."""
FLAT = 1e-3
"""Least balance 1 - m / sigma^2 along a streak: of one longer than the window nothing tells where its middle is."""
ITERATIONS = 12
REFINED = 4
"""Passes that fit the window to a smear: each lets it grow twofold, from 1 px to the longest."""
LONG_REACH = 2.5
"""Half side of a stamp by the longest 1-sigma length of its windows: a streak ends at 1.7, its Gaussian at 3.5."""


@dataclass(frozen=True)
class FoundStars:
    """Spots of one picture, brightest first.

    Attributes
    ----------
    spots_px : (n, 2)
        Centres x, y from the picture's centre, x right, y down, as `relnav.dual_field.measure` takes them.
    covariance_px2 : (n, 2, 2)
        Of each.
    flux : (n,)
        Counts above the background; too low where `saturated`.
    signal_to_noise : (n,)
        Flux over its 1-sigma.
    saturated, blended : (n,)
        A pixel is saturated; the spot is elongated: two stars, or a moving one. Where the picture's bright stars are
        smeared, all are.
    size_px : (2,)
        Width and height of the picture.
    radius_px : float
        1-sigma radius of a star, across a common smear; NaN without one.
    """

    spots_px: Matrix
    covariance_px2: Stack
    flux: Vector
    signal_to_noise: Vector
    saturated: Flags
    blended: Flags
    size_px: tuple[int, int]
    radius_px: float

    @property
    def in_picture_px(self) -> Matrix:
        """Centres (n, 2) that count from the corner: column and row, the first pixel's centre is (0, 0)."""
        return self.spots_px + picture_centre(self.size_px)


def picture_centre(size_px: tuple[float, float], first_pixel_px: float = FIRST_PIXEL_PX) -> Vector:
    """Centre (2,) of a picture of so many columns and rows; `first_pixel_px` is the coordinate of its first pixel."""
    return np.array([0.5 * (size_px[0] - 1.0) + first_pixel_px, 0.5 * (size_px[1] - 1.0) + first_pixel_px])


def find_stars(
    image: ArrayLike,
    *,
    threshold_sigma: float = 5.0,
    saturation: float | None = None,
    electrons_per_count: float | None = None,
    most: int = MOST_STARS,
) -> FoundStars:
    """Star spots of a picture of the sky, each with its covariance and its flags.

    Parameters
    ----------
    image : (rows, columns)
        Counts; pixels that are not finite, beyond 1e15, or masked, are dead.
    threshold_sigma : float
        Least height of a star's peak above the smoothed background, in sigmas of its noise.
    saturation : float, optional
        Counts of a saturated pixel; if left out the largest value of an integer type (255, 65535), of floats none.
    electrons_per_count : float, optional
        Gain, for the shot noise of the stars' own light; not counted if left out.
    most : int
        Largest number of spots that are returned, the brightest.

    Returns
    -------
    FoundStars
        Empty if the picture shows no star.

    Raises
    ------
    ValueError
        For an image that has not two axes of 8 pixels or more, or is not of real numbers; for options out of range.

    Notes
    -----
    With noise n, a window w of 1-sigma sigma, distances d from the centre and the light's moment
    m = sum(w I d^2) / sum(w I), a centre moves by sum(w n d) / (sum(w I) (1 - m / sigma^2)). This is the derivative of
    sum(w I d) = 0. Its covariance follows. In an elongated spot m is the matrix of moments, so that a centre is known
    worse along a streak, and what the last iteration leaves of sum(w I d) is added to the noise.

    Where the bright stars are smeared alike, by a turn of the camera, the window of every star is as long as the smear
    at its place. All of this is then done with distances along it divided by its stretch, in which stars are round.
    Where they are smeared, but not alike (two fields on one detector), m is the matrix of moments for every star.
    """
    counts, most_counts = _checked(image, threshold_sigma, saturation, electrons_per_count, most)
    dead, full = ~(np.abs(counts) < NO_COUNTS), counts >= most_counts
    dark = subtract_background(counts, dead)
    places = find_peaks(counts, dead, dark, threshold_sigma, 4 * most)
    size = (counts.shape[1], counts.shape[0])
    if len(places) == 0:
        return _stars(np.empty((0, 9)), size, np.nan)

    def settled(places: NDArray[np.intp], window_px: float, smear: Smear | None = None) -> _Stamps:
        return _Stamps(counts, dark, places, window_px, full, electrons_per_count, threshold_sigma, smear).settle()

    stamps = settled(places, FIRST_WINDOW_PX)
    radius = stamps.typical_radius()
    stamps = settled(places[stamps.lit], max(radius, LEAST_WINDOW_PX))
    smear, asked = stamps.smear(size), stamps.places[stamps.clear]
    stamps.smeared = smear is not None
    for _ in range(REFINED):
        if smear is not None:
            smear = settled(asked, max(smear.radius_px, LEAST_WINDOW_PX), smear).smear(size)
    if smear is not None and smear.alike:
        radius = float(np.clip(smear.radius_px, NARROWEST_PX, WIDEST_PX))
        stamps = settled(places, max(radius, LEAST_WINDOW_PX), smear)
    return _stars(stamps.stars(radius, most), size, radius)


def _stars(rows: Matrix, size: tuple[int, int], radius_px: float) -> FoundStars:
    """Rows of x, y, xx, xy, yy, flux, signal to noise, saturated, blended as the result."""
    xx, xy, yy = rows[:, 2], rows[:, 3], rows[:, 4]
    return FoundStars(
        spots_px=rows[:, :2] - picture_centre(size),
        covariance_px2=np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2),
        flux=rows[:, 5].copy(),
        signal_to_noise=rows[:, 6].copy(),
        saturated=rows[:, 7] > 0.0,
        blended=rows[:, 8] > 0.0,
        size_px=size,
        radius_px=radius_px,
    )


def _checked(
    image: ArrayLike, threshold_sigma: float, saturation: float | None, gain: float | None, most: int
) -> tuple[NDArray[np.float32], float]:
    """The counts as floats of their own, and how many make a full pixel."""
    given: NDArray[Any] = image if type(image) is np.ndarray and image.dtype.kind in "iuf" else numbers("image", image)
    if given.ndim != 2 or min(given.shape) < 8:
        raise ValueError(f"a picture has two axes (rows, columns) of 8 pixels or more; got shape {given.shape}")
    optional = {"saturation": saturation, "electrons_per_count": gain}
    options = {"threshold_sigma": threshold_sigma} | {
        name: value for name, value in optional.items() if value is not None
    }
    for name, value in options.items():
        if not 1e-12 < number(name, value) < 1e12:
            raise ValueError(f"{name} is a number above zero, of a credible size; got {value}")
    if not 1 <= number("most", most) < np.inf:
        raise ValueError(f"most is one star or more; got {most}")
    full = np.inf if given.dtype.kind == "f" else float(np.iinfo(given.dtype).max)
    with np.errstate(over="ignore", invalid="ignore"):  # beyond the largest float: a dead pixel
        return given.astype(np.float32), full if saturation is None else float(saturation)


class _Stamps:
    """Small windows of the picture about every candidate, all alike in size, worked on together."""

    def __init__(
        self,
        counts: NDArray[np.float32],
        dark: Dark,
        places: NDArray[np.intp],
        window_px: float,
        full: Flags,
        gain: float | None,
        threshold_sigma: float,
        smear: Smear | None = None,
    ) -> None:
        self.places, self.window_px = places, window_px
        self.start = places[:, ::-1].astype(np.float64)
        self.stretch, longest = None, 0.0
        if smear is not None:
            self.stretch, self.left = smear.stretch(self.start, window_px)
            longest = window_px * float(np.linalg.norm(self.stretch, axis=(1, 2)).max())
        half = max(3, int(np.ceil(3.5 * window_px)), int(np.ceil(LONG_REACH * longest)))
        span = np.arange(-half, half + 1)
        row = np.clip(places[:, 0, None] + span, 0, counts.shape[0] - 1)
        column = np.clip(places[:, 1, None] + span, 0, counts.shape[1] - 1)
        at = row[:, :, None], column[:, None, :]
        self.light = counts[at].astype(np.float64)
        self.y, self.x = (places[:, 0, None] + span)[:, :, None], (places[:, 1, None] + span)[:, None, :]
        noise, core = dark.noise_at(places), slice(half - 1, half + 2)
        # what stands all along two sides of a stamp is background that the boxes did not follow
        sides = [self.light[:, 0], self.light[:, -1], self.light[:, :, 0], self.light[:, :, -1]]
        middle, upper = np.sort(np.quantile(np.stack(sides), (0.5, 0.75), axis=2), axis=1)[:, 2]
        level = np.where(middle > noise, upper, middle)
        smooth = np.einsum("nij,i,j->n", self.light[:, core, core], (0.25, 0.5, 0.25), (0.25, 0.5, 0.25))
        self.stands_out = smooth - level > threshold_sigma * SMOOTH_NOISE * noise
        self.saturated = full[at][:, core, core].any(axis=(1, 2))
        peak = self.light[:, half, half]
        self.sharp = self.light[:, core, core].sum(axis=(1, 2)) - peak < HOT * peak
        rim = np.ones((len(span), len(span)), dtype=bool)
        rim[1:-1, 1:-1] = False
        self.large = self.light[:, rim].mean(axis=1) > LARGE * self.light[:, core, core].max(axis=(1, 2))
        self.variance = noise[:, None, None] ** 2 + (0.0 if gain is None else np.maximum(self.light, 0.0) / gain)
        self.centre, self.smeared = self.start.copy(), smear is not None

    def settle(self) -> _Stamps:
        """Move every window until the light under it is balanced, and take its moments."""
        for _ in range(ITERATIONS):
            w, dx, dy = self._window()
            self.lit = (self.total > 0.0) & (self.moment < 0.9 * self.window_px**2)
            step = np.stack([(w * dx).sum(axis=(1, 2)), (w * dy).sum(axis=(1, 2))], axis=-1)
            scale = np.where(self.lit, self.total * (1.0 - self.moment / self.window_px**2), np.inf)
            self.centre += self._stretched(np.clip(step / scale[:, None], -1.0, 1.0))
        self._window()
        self.w2 = self.w**2 * self.variance
        self.noise = np.sqrt(self.w2.sum(axis=(1, 2)))
        near = np.hypot(*self._shrunk(*(self.centre - self.start).T)) < PEAK_PX
        self.lit = (self.total > 0.0) & (self.moment > 0.0) & near & self.stands_out & ~(self.sharp | self.large)
        return self

    def _shrunk(self, dx: Any, dy: Any) -> tuple[Any, Any]:
        """Distances (n, ...) as they are where smeared stars are round."""
        if self.stretch is None:
            return dx, dy
        xx, xy, _, yy = np.linalg.inv(self.stretch).reshape(-1, 4).T.reshape(4, -1, *[1] * (dx.ndim - 1))
        return xx * dx + xy * dy, xy * dx + yy * dy

    def _stretched(self, vectors: Matrix) -> Matrix:
        """Vectors (n, 2) from there, as they are in the picture."""
        return vectors if self.stretch is None else np.einsum("nij,nj->ni", self.stretch, vectors)

    def _distances(self) -> tuple[Any, Any]:
        """From the centres, shrunk, to each pixel."""
        return self._shrunk(self.x - self.centre[:, 0, None, None], self.y - self.centre[:, 1, None, None])

    def _window(self) -> tuple[Stack, Stack, Stack]:
        """Windowed light (n, s, s) and distances from the centres; sets total and moments."""
        dx, dy = self._distances()
        self.w = np.exp(-0.5 * (dx**2 + dy**2) / self.window_px**2)
        light = self.w * self.light
        self.total = light.sum(axis=(1, 2))
        safe = np.where(self.total > 0.0, self.total, 1.0)
        self.xx, self.yy = (light * dx**2).sum(axis=(1, 2)) / safe, (light * dy**2).sum(axis=(1, 2)) / safe
        self.xy = (light * dx * dy).sum(axis=(1, 2)) / safe
        self.moment = 0.5 * (self.xx + self.yy)
        return light, dx, dy

    def typical_radius(self) -> float:
        """1-sigma radius r of this picture's stars: 1/m = 1/r^2 + 1/s^2 of Gaussian star and window."""
        clear = self._clear()
        if not np.any(clear):
            return FIRST_WINDOW_PX
        m = self.moment[clear][:50]
        r2 = np.median(1.0 / (1.0 / m - 1.0 / self.window_px**2))
        return float(np.clip(np.sqrt(r2), NARROWEST_PX, WIDEST_PX))

    def _clear(self) -> Flags:
        """Stars bright enough for their moments to be known to a tenth: moment by noise is flux by noise."""
        clear: Flags = self.lit & ~self.saturated & (self.total > 10.0 * self.noise)
        clear &= self.moment < 0.95 * self.window_px**2
        return clear

    def _lean(self) -> Vector:
        """Difference of the moments along and across, of their sum."""
        lean: Vector = np.hypot(self.xx - self.yy, 2.0 * self.xy) / (2.0 * self.moment)
        return lean

    def smear(self, size: tuple[int, int]) -> Smear | None:
        """What smears the stars of a picture of this size alike."""
        clear = self.clear = self._clear()
        if np.count_nonzero(clear) < FEWEST:
            return None
        lean = self._lean()
        by_noise2 = 2.0 * (self.noise[clear] / self.total[clear]) ** 2
        if self.stretch is None and np.median(lean[clear] ** 2 - by_noise2) < SMEARED**2:
            return None
        moments = np.stack([self.xx, self.xy, self.xy, self.yy], axis=-1).reshape(-1, 2, 2)
        shapes = shapes_from(moments[clear], self.window_px)
        elongated, share = self.lit & (lean > LEAN), 1.0
        if self.stretch is not None:
            shapes = self.stretch[clear] @ shapes @ self.stretch[clear]
            elongated, share = self.lit, float(np.mean(clear))
        return pooled(self.centre[clear], shapes, self.centre[elongated], share, picture_centre(size), self.window_px)

    def stars(self, radius_px: float, most: int) -> Matrix:
        """Those that are stars, brightest first: rows as `_stars` takes them."""
        w2, (dx, dy) = self.w2, self._distances()
        total = np.where(self.lit, self.total, 1.0)
        snr = total / self.noise
        typical = 1.0 / (1.0 / radius_px**2 + 1.0 / self.window_px**2)
        moment_noise = np.sqrt((w2 * (0.5 * (dx**2 + dy**2) - typical) ** 2).sum(axis=(1, 2))) / total
        is_star = self.lit & (self.saturated | (self.moment < WIDE * typical + 3.0 * moment_noise))
        is_star &= self.moment < 0.95 * self.window_px**2
        elongated = self._lean() > LEAN + 6.0 * moment_noise / typical
        elongated |= self.smeared and self.stretch is None
        blended = elongated | self._beside_another() | self.smeared
        floor = np.where(self.saturated, FULL_ERROR_PX, np.hypot(UNEVEN_ERROR_PX, self._sampling(typical))) ** 2
        noise = [(w2 * product).sum(axis=(1, 2)) for product in (dx**2, dx * dy, dy**2)]
        gx, gy = (self.w * self.light * dx).sum(axis=(1, 2)), (self.w * self.light * dy).sum(axis=(1, 2))
        left = [np.where(elongated, product, 0.0) for product in (gx * gx, gx * gy, gy * gy)]
        noise = [one + other for one, other in zip(noise, left, strict=True)]
        xx, xy, yy = self._moved_by(noise, total, elongated)
        if self.stretch is not None:
            moved = np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)
            xx, xy, _, yy = (self.stretch @ moved @ self.stretch + self.left).reshape(-1, 4).T
        xx, yy = xx + floor, yy + floor
        rows = np.column_stack(
            [self.centre, xx, xy, yy, total * (1.0 + (radius_px / self.window_px) ** 2), snr, self.saturated, blended]
        )[is_star]
        rows = rows[np.argsort(-rows[:, 5], kind="stable")]
        return without_doubles(rows)[:most]

    def _moved_by(self, noise: list[Vector], total: Vector, elongated: Flags) -> tuple[Vector, Vector, Vector]:
        """Covariance xx, xy, yy of the centres by that of sum(w n d): see the notes of `find_stars`."""
        w2, n_xx, n_xy, n_yy = self.window_px**2, *noise
        a, b, c = (
            np.where(elongated, own, same)
            for own, same in ((self.xx, self.moment), (self.xy, 0.0), (self.yy, self.moment))
        )
        a, b, c = 1.0 - a / w2, -b / w2, 1.0 - c / w2
        det = np.maximum(a * c - b * b, FLAT * (a + c)) * total
        p, q, r = c / det, -b / det, a / det
        xx = p * p * n_xx + 2.0 * p * q * n_xy + q * q * n_yy
        xy = p * q * n_xx + (p * r + q * q) * n_xy + q * r * n_yy
        return xx, xy, q * q * n_xx + 2.0 * q * r * n_xy + r * r * n_yy

    def _beside_another(self) -> Flags:
        """Whether another peak stands so near and high that the centre is of both."""
        from scipy.spatial import cKDTree

        height, flagged = self.light.max(axis=(1, 2)), np.zeros(len(self.start), dtype=bool)
        for one, other in cKDTree(self.start).query_pairs(BESIDE * self.window_px):
            for k, beside in ((one, other), (other, one)):
                own = self.light[beside, self.light.shape[1] // 2, self.light.shape[2] // 2]
                flagged[k] |= self.lit[beside] and own > BESIDE_HEIGHT * height[k]
        both: Flags = flagged & ~self.saturated
        return both

    def _sampling(self, moment: float) -> float:
        """1-sigma error of a centre from sampling, px: see the notes of `find_stars`."""
        amplitude = 4.0 * np.pi * moment * np.exp(-2.0 * np.pi**2 * moment) / (1.0 - moment / self.window_px**2)
        return float(amplitude * np.sqrt(0.5))
