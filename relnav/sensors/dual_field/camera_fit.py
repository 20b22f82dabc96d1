"""Fit attitude, focal length and distortion to a frame's matches, and judge whether chance could have made them."""

import math
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.pinhole import central_projection
from relnav.sensors.dual_field.camera_normal import CX, CY, FOCAL, K1, K2, STEP_ROWS, UNKNOWNS, step_camera
from relnav.sensors.dual_field.matching import turn
from relnav.sensors.dual_field.optics import plane_points, rays
from relnav.sensors.dual_field.sky import Sky
from relnav.sensors.dual_field.solution import StarLens, StarSolution, StarStatus

CLUSTERING = 2.0
AXIS_OFFSET = 0.02
"""1-sigma of the optical axis from the image's centre along x and y, of the distance of the farthest spot: 10 px on an
image of a thousand. Lenses are centred to about as much."""

LEAST_MATCHES = 6
FIRST_NOISE_PX, LEAST_NOISE_PX = 0.5, 0.03
"""Noise of a spot coordinate before residuals tell it, and the least that is believed of them."""

DEPTHS = 8
"""Ways to count the sky's stars when chance is judged: all, the brighter half, the brighter quarter and so on."""

GROWTHS, GROWTH = 4, 4.0
"""How often stars are looked for farther from the spots, and how many times as far, once a fit has settled: it may
have settled on the middle of the field alone."""

SETTLED = 1e-3
"""A fit that moves by fewer sigmas is done with its matches; with all once they stay and the noise changes by less,
relative."""

MARGIN_RAD = 0.1
"""Stars so far beyond a frame's edge are looked at: a fit starts within 5 % of the focal length, and distortion that
moves a ray as far as this is not believed."""

LEAST_BRIGHT_SEEN = 0.4
"""Share of the bright stars that should be in the frame that must be among the spots."""


@dataclass(frozen=True)
class CameraFit:
    """A fitted camera.

    Attributes
    ----------
    dcm, focal_px, distortion : (3, 3), float, (2,)
        The fit; z of the attitude looks through the image's centre unless the principal point is known.
    star : (n,)
        Star of each spot, -1 none.
    residual_rad : (n,)
        NaN without a star.
    covariance : (3, 3)
        Of the attitude, with focal length, distortion and (unless it is known) principal point as unknowns, from the
        residuals' own spread.
    log10_false_alarm : float
        That chance made it.
    lens : StarLens
        The whole camera.
    """

    dcm: Matrix
    focal_px: float
    distortion: Vector
    star: Codes
    residual_rad: Vector
    covariance: Matrix
    log10_false_alarm: float
    lens: StarLens

    def in_order(self, order: Codes) -> "CameraFit":
        """Of spots that were taken in an order (n,), in that of before."""
        back = np.argsort(order)
        return replace(self, star=self.star[back], residual_rad=self.residual_rad[back])

    def solution(self, sky: Sky, tried: int) -> StarSolution:
        """As the sensor's solution."""
        matched = self.star >= 0
        return StarSolution(
            status=StarStatus.OK,
            reason="",
            dcm_cam_from_icrs=self.dcm,
            covariance=self.covariance,
            hip=np.where(matched, sky.hip[self.star], 0),
            field=np.where(matched, 0, -1),
            residual_rad=self.residual_rad,
            log10_false_alarm=self.log10_false_alarm,
            tried=tried,
            focal_length_px=self.focal_px,
            lens=self.lens,
        )


@dataclass
class _Camera:
    """The unknowns and what they are fitted to.

    The optical axis meets the image near its centre only: `principal_px` is fitted with the prior `AXIS_OFFSET`, unless
    it is known.
    """

    spots_px: Matrix
    principal_known: bool
    dcm: Matrix
    lens: Vector
    """As of `camera_normal`: focal length, principal point, k1, k2."""
    variance: float
    """Of each coordinate of a ray, rad^2."""

    def rays(self, spots_px: Matrix | None = None) -> Matrix:
        spots = self.spots_px if spots_px is None else spots_px
        f, x, y, k1, k2 = self.lens.tolist()
        return rays(plane_points(spots, f, (x, y), (k1, k2)))

    @property
    def focal_px(self) -> float:
        """Focal length."""
        return float(self.lens[FOCAL])

    def copy(self) -> "_Camera":
        """To be fitted on its own."""
        return replace(self, dcm=self.dcm.copy(), lens=self.lens.copy())

    @property
    def told(self) -> StarLens:
        """As the solution tells it."""
        f, x, y, k1, k2 = self.lens.tolist()
        return StarLens(f, (x, y), (k1, k2), self.dcm.copy())

    def improve(self, star: Codes, stars: Matrix, free: int, steps: int = 1) -> Matrix:
        """Gauss-Newton steps over the matches until one is `SETTLED`: the covariance (8, 8), zero for what is kept.

        Unknowns: three rotations, log focal length, k1, k2, the first `free` of them; and the principal point.
        """
        axis_px = 0.0 if self.principal_known else AXIS_OFFSET * float(np.max(np.hypot(*self.spots_px.T)))
        covariance, work = np.empty((UNKNOWNS, UNKNOWNS)), np.empty((STEP_ROWS, UNKNOWNS))
        limits = self.variance, free, axis_px, steps, SETTLED
        step_camera(self.spots_px, star, stars, self.dcm, self.lens, *limits, work, covariance)
        return covariance

    def about_centre(self, covariance: Matrix) -> tuple[Matrix, Matrix]:
        """Attitude (3, 3) and covariance (3, 3) of the axes whose z looks through the image's centre.

        For a known principal point, those of the camera. Else they are turned about m x z, m the centre's ray, so that
        m comes to lie on z. m x z has the sine of that angle for its length, and `turn` takes twice the tangent of its
        half, which is 2 / (1 + m_z) times as much. A principal point off by g focal lengths turns them by (-g_y, g_x).
        """
        if self.principal_known:
            return self.dcm, covariance[:3, :3]
        m = self.rays(np.zeros((1, 2)))[0]
        dcm = self.dcm.copy()
        scale = 2.0 / (1.0 + float(m[2]))
        turn(dcm, -scale * float(m[1]), scale * float(m[0]), 0.0)
        T = np.zeros((3, 8))
        T[:, :3], T[0, 7], T[1, 6] = np.eye(3), 1.0, -1.0
        return dcm, T @ covariance @ T.T


class _Stars:
    """The sky's stars (m, 4), magnitudes (m,), ascending, and which are about a frame: found once for all fits."""

    def __init__(self, sky: Sky, faintest: float, w: Matrix, dcm: Matrix) -> None:
        """Down to a magnitude, about rays (n, 3) seen under an attitude."""
        from scipy.spatial import cKDTree

        self.arrays = sky.arrays.stars
        self.magnitudes = sky.magnitudes[: np.searchsorted(sky.magnitudes, faintest, side="right")]
        centre = w.mean(axis=0) @ dcm
        centre /= np.linalg.norm(centre)
        reach = math.acos(min(1.0, max(-1.0, float(np.min(w @ dcm @ centre)))))
        near = np.flatnonzero(self.arrays[:, :3] @ centre > math.cos(min(reach + MARGIN_RAD, math.pi)))
        self.near = near[self.arrays[near, 3] <= faintest]
        self._tree = cKDTree(self.arrays[self.near, :3]) if len(self.near) else None

    def match(self, w: Matrix, dcm: Matrix, tolerance_rad: float) -> tuple[Codes, Vector]:
        """Nearest star of each ray (n, 3) within the tolerance, each star once; -1 and NaN for none."""
        star, residual = np.full(len(w), -1, dtype=np.int64), np.full(len(w), np.nan)
        if self._tree is None:
            return star, residual
        found, index = (np.asarray(part) for part in self._tree.query(w @ dcm, distance_upper_bound=tolerance_rad))
        k = np.flatnonzero(np.isfinite(found))
        k = k[np.argsort(found[k], kind="stable")]
        _, first = np.unique(index[k], return_index=True)
        k = k[first]
        star[k], residual[k] = self.near[index[k]], found[k]
        return star, residual


def fit_camera(
    spots_px: Matrix,
    sky: Sky,
    first_match: Codes,
    *,
    dcm: Matrix,
    focal_px: float,
    principal_px: tuple[float, float],
    distortion: tuple[float, float],
    lens_known: bool,
    tried: float,
    faintest: float,
) -> CameraFit | None:
    """Fit and judge, from the first matches of the brightest spots; None if it comes to nothing.

    Parameters
    ----------
    spots_px : (n, 2)
        All spots, brightest first.
    sky : Sky
        Its stars.
    first_match : (k,)
        Stars of the first k spots, -1 none.
    dcm, focal_px, principal_px, distortion, lens_known
        Where the fit starts, and whether the last two are those of the camera.
    tried : float
        Attitudes tried so far.
    faintest : float
        Down to which magnitude stars are looked at, whatever the sky holds.
    """
    camera = _Camera(
        np.ascontiguousarray(spots_px, dtype=np.float64),
        lens_known,
        dcm,
        np.array([focal_px, *principal_px, *distortion], dtype=np.float64),
        (FIRST_NOISE_PX / focal_px) ** 2,
    )
    star = np.full(len(spots_px), -1, dtype=np.int64)
    star[: len(first_match)] = first_match
    stars = _Stars(sky, faintest, camera.rays(), dcm)
    found = _settle(camera, star, stars, focal_px)
    for _ in range(GROWTHS):
        if found is None:
            return None
        wider = stars.match(found.camera.rays(), found.camera.dcm, GROWTH * found.tolerance)[0]
        if np.array_equal(wider, found.star):
            break
        grown = _settle(found.camera.copy(), wider, stars, focal_px)
        if grown is None or not grown.log_false_alarm(stars, tried) < found.log_false_alarm(stars, tried):
            break
        found = grown
    return None if found is None else _judge(found, stars, tried)


@dataclass(frozen=True)
class _Settled:
    """A camera whose matches are those that it was fitted to; `free` as of `_Camera.improve`."""

    camera: _Camera
    star: Codes
    residual: Vector
    free: int
    tolerance: float

    def log_false_alarm(self, stars: _Stars, tried: float) -> float:
        """Logarithm of a bound on the number of fits as good by chance."""
        return _log_false_alarm(self.star, stars, self.tolerance, self.free, tried)


def _settle(camera: _Camera, star: Codes, stars: _Stars, focal_px: float) -> _Settled | None:
    """Fit and match by turns, the tolerance that of what the fit leaves and never growing; None if it falls apart."""
    residual, free, tolerance = np.full(len(star), np.nan), 4, math.inf
    wide = float(np.max(np.hypot(*(camera.spots_px - camera.lens[CX : CY + 1]).T))) / focal_px > 0.25
    for passes in range(8):
        count = int(np.sum(star >= 0))
        if count < LEAST_MATCHES:
            return None
        before, freed, variance = star, free, camera.variance
        free = 4 if camera.principal_known or count < 9 or passes == 0 else 6 if wide and count >= 14 else 5
        camera.improve(star, stars.arrays, free, steps=3)
        if not (0.5 < camera.focal_px / focal_px < 2.0 and max(abs(camera.lens[K1]), abs(camera.lens[K2])) < 5.0):
            return None
        d = camera.rays()[star >= 0] - stars.arrays[star[star >= 0], :3] @ camera.dcm.T
        spread = 1.4826 * float(np.median(np.linalg.norm(d, axis=1))) / 1.1774  # per axis, robust
        camera.variance = max(spread, LEAST_NOISE_PX / focal_px) ** 2
        tolerance = min(tolerance, max(5.0 * spread, 0.5 / focal_px))
        star, residual = stars.match(camera.rays(), camera.dcm, tolerance)
        same = passes > 0 and free == freed and np.array_equal(star, before)
        if same and abs(camera.variance / variance - 1.0) < SETTLED:
            break
    return _Settled(camera, star, residual, free, tolerance)


def _judge(found: _Settled, stars: _Stars, tried: float) -> CameraFit | None:
    """The fit with its false alarm probability; None if the bright stars that should be there are not."""
    camera, star, residual, free = found.camera, found.star, found.residual, found.free
    count = int(np.sum(star >= 0))
    if count < LEAST_MATCHES or not _bright_stars_are_there(camera, stars, star):
        return None
    log = found.log_false_alarm(stars, tried)
    dof = max(2 * count - free, 3)
    square = float(np.nansum(residual**2)) / (dof - 2)  # mean of the variance's posterior
    floor = (LEAST_NOISE_PX / camera.focal_px) ** 2
    camera.variance = max(square, floor)
    covariance = camera.improve(star, stars.arrays, free)
    dcm, covariance = camera.about_centre(covariance)
    return CameraFit(
        dcm=dcm,
        focal_px=camera.focal_px,
        distortion=camera.lens[K1 : K2 + 1].copy(),
        star=star,
        residual_rad=residual,
        covariance=covariance,
        log10_false_alarm=log / math.log(10.0),
        lens=camera.told,
    )


def _log_false_alarm(star: Codes, stars: _Stars, tolerance: float, free: int, tried: float) -> float:
    """Logarithm of a bound on the expected number of fits as good by chance, brightness counted.

    Of the first m spots c have a star among the s brightest of the sky. Thrown at random over it, c given spots fall so
    close to such stars with probability p^c, p = s tolerance^2 / 4, and there are C(m, c) choices of them. Fitted lens
    parameters take half a match each. The least over m = n, n/sqrt 2, n/2, ... and s counts once for each that was
    tried.
    """
    from scipy.special import gammaln

    n, matched = len(star), star >= 0
    total = len(stars.magnitudes)
    rank = np.where(matched, np.searchsorted(stars.magnitudes, stars.arrays[star, 3], side="right"), total + 1)
    shares = 0.5 ** (0.5 * np.arange(max(1, round(2.0 * math.log2(n / LEAST_MATCHES)) + 1)))
    first, least = np.maximum(np.round(n * shares), LEAST_MATCHES), math.inf
    for halvings in range(DEPTHS):
        bright = total / 2.0**halvings
        c = np.cumsum(rank <= bright)[first.astype(np.int64) - 1]
        choices = gammaln(first + 1.0) - gammaln(c + 1.0) - gammaln(first - c + 1.0)
        log = choices + (c - 0.5 * free) * math.log(min(1.0, 0.25 * CLUSTERING * bright * tolerance**2))
        least = min(least, float(np.min(log[c >= LEAST_MATCHES], initial=math.inf)))
    return math.log(tried * len(first) * DEPTHS) + least


def _bright_stars_are_there(camera: _Camera, stars: _Stars, star: Codes) -> bool:
    """Whether enough of the stars brighter than the median match, where matches lie about, are matched.

    Within the convex hull of the matched spots: of a sky partly hidden by a roof the rest shows no star.
    """
    from scipy.spatial import Delaunay, QhullError

    used, near = stars.arrays[star[star >= 0], 3], stars.arrays[stars.near]
    least = float(np.median(used))
    bright = near[near[:, 3] <= least]
    v = bright[:, :3] @ camera.dcm.T
    v = v[v[:, 2] > 0.1]
    p, corners = central_projection(v), central_projection(camera.rays()[star >= 0])
    try:
        inside = Delaunay(corners).find_simplex(p) >= 0
    except QhullError:  # all on one line
        return False
    return int(np.sum(used <= least)) >= LEAST_BRIGHT_SEEN * int(np.sum(inside))
