"""Fit attitude, focal length and distortion to a frame's matches, and judge whether chance could have made them."""

import math
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection
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
    principal_px: Vector
    principal_known: bool
    dcm: Matrix
    focal_px: float
    distortion: Vector
    variance: float
    """Of each coordinate of a ray, rad^2."""

    def rays(self, spots_px: Matrix | None = None) -> Matrix:
        spots = self.spots_px if spots_px is None else spots_px
        return rays(plane_points(spots, self.focal_px, self.principal_px, self.distortion))

    @property
    def lens(self) -> StarLens:
        """As the solution tells it."""
        (x, y), (k1, k2) = self.principal_px.tolist(), self.distortion.tolist()
        return StarLens(self.focal_px, (x, y), (k1, k2), self.dcm.copy())

    @property
    def reach(self) -> float:
        """Distance of the farthest spot from the image's centre, px."""
        return float(np.max(np.hypot(*self.spots_px.T)))

    def moved(self, step: Vector) -> "_Camera":
        """With log focal length, k1, k2 and principal point (in focal lengths) changed by step (5,)."""
        focal = self.focal_px * math.exp(float(np.clip(step[0], -0.1, 0.1)))
        principal = self.principal_px + self.focal_px * step[3:]
        return replace(self, focal_px=focal, principal_px=principal, distortion=self.distortion + step[1:3])

    def improve(self, star: Codes, stars: Matrix, free: int) -> Matrix:
        """One Gauss-Newton step over the matches; the covariance (8, 8) of all unknowns, zero for those kept.

        Unknowns: three rotations, log focal length, k1, k2, the first `free` of them; and the principal point.
        """
        used = star >= 0
        w, q = self.rays(self.spots_px[used]), stars[star[used], :3] @ self.dcm.T
        fitted = np.flatnonzero([*(np.arange(6) < free), *[not self.principal_known] * 2])
        J = np.zeros((len(w), 3, 8))
        J[:, :, :3] = cross_matrix(q)  # w = q - d x q
        for column, step in enumerate(np.diag([1e-6, 1e-4, 1e-3, 1e-6, 1e-6])):
            changed = self.moved(step).rays(self.spots_px[used])
            J[:, :, 3 + column] = (w - changed) / step.max()  # the ray moves the other way than its prediction
        flat, r = J.reshape(-1, 8)[:, fitted], (w - q).ravel()
        prior = np.zeros(8)
        prior[6:] = 1.0 / (AXIS_OFFSET * self.reach / self.focal_px) ** 2
        normal, gradient = flat.T @ flat / self.variance, flat.T @ r / self.variance
        normal[np.diag_indices(len(fitted))] += prior[fitted]
        at = np.concatenate([np.zeros(6), self.principal_px / self.focal_px])
        inverse, d, covariance = np.linalg.pinv(normal, hermitian=True), np.zeros(8), np.zeros((8, 8))
        d[fitted] = inverse @ (gradient - prior[fitted] * at[fitted])
        covariance[np.ix_(fitted, fitted)] = inverse
        turn(self.dcm, *(float(angle) for angle in d[:3]))
        after = self.moved(d[3:])
        self.focal_px, self.principal_px, self.distortion = after.focal_px, after.principal_px, after.distortion
        return covariance

    def about_centre(self, covariance: Matrix) -> tuple[Matrix, Matrix]:
        """Attitude (3, 3) and covariance (3, 3) of the axes whose z looks through the image's centre.

        For a known principal point, those of the camera. Else they are turned by rho = m x z, m the centre's ray, so
        that m comes to lie on z: exp([rho x]) dcm. A principal point off by g focal lengths changes rho by (-g_y, g_x).
        """
        if self.principal_known:
            return self.dcm, covariance[:3, :3]
        m = self.rays(np.zeros((1, 2)))[0]
        dcm = self.dcm.copy()
        turn(dcm, -float(m[1]), float(m[0]), 0.0)
        T = np.zeros((3, 8))
        T[:, :3], T[0, 7], T[1, 6] = np.eye(3), 1.0, -1.0
        return dcm, T @ covariance @ T.T


def _match(w: Matrix, dcm: Matrix, stars: Matrix, tolerance_rad: float) -> tuple[Codes, Vector]:
    """Nearest star of each ray within the tolerance, each star once; -1 and NaN for none."""
    from scipy.spatial import cKDTree

    centre = w.mean(axis=0) @ dcm
    centre /= np.linalg.norm(centre)
    reach = np.min(w @ dcm @ centre)
    near = np.flatnonzero(stars[:, :3] @ centre > math.cos(math.acos(min(1.0, max(-1.0, reach))) + 0.02))
    star, residual = np.full(len(w), -1, dtype=np.int64), np.full(len(w), np.nan)
    if len(near) == 0:
        return star, residual
    distance, index = cKDTree(stars[near, :3]).query(w @ dcm, distance_upper_bound=tolerance_rad)
    taken: set[int] = set()
    found, which = np.atleast_1d(distance), near[np.minimum(np.atleast_1d(index), len(near) - 1)]
    for k in np.argsort(found):
        if np.isfinite(found[k]) and int(which[k]) not in taken:
            taken.add(int(which[k]))
            star[k], residual[k] = which[k], found[k]
    return star, residual


def fit_camera(
    spots_px: Matrix,
    stars: Matrix,
    first_match: Codes,
    *,
    dcm: Matrix,
    focal_px: float,
    principal_px: tuple[float, float],
    distortion: tuple[float, float],
    lens_known: bool,
    tried: float,
) -> CameraFit | None:
    """Fit and judge, from the first matches of the brightest spots; None if it comes to nothing.

    Parameters
    ----------
    spots_px : (n, 2)
        All spots, brightest first.
    stars : (m, 4)
        Directions and magnitudes of the sky.
    first_match : (k,)
        Stars of the first k spots, -1 none.
    dcm, focal_px, principal_px, distortion, lens_known
        Where the fit starts, and whether the last two are those of the camera.
    tried : float
        Attitudes tried so far.
    """
    camera = _Camera(
        spots_px,
        np.array(principal_px, dtype=np.float64),
        lens_known,
        dcm,
        focal_px,
        np.array(distortion, dtype=np.float64),
        (FIRST_NOISE_PX / focal_px) ** 2,
    )
    star = np.full(len(spots_px), -1, dtype=np.int64)
    star[: len(first_match)] = first_match
    found = _settle(camera, star, stars, focal_px)
    for _ in range(GROWTHS):
        if found is None:
            return None
        wider = _match(found.camera.rays(), found.camera.dcm, stars, GROWTH * found.tolerance)[0]
        grown = _settle(replace(found.camera, dcm=found.camera.dcm.copy()), wider, stars, focal_px)
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

    def log_false_alarm(self, stars: Matrix, tried: float) -> float:
        """Logarithm of a bound on the number of fits as good by chance."""
        return _log_false_alarm(self.star, stars[:, 3], self.tolerance, self.free, tried)


def _settle(camera: _Camera, star: Codes, stars: Matrix, focal_px: float) -> _Settled | None:
    """Fit and match by turns, the tolerance that of what the fit leaves and never growing; None if it falls apart."""
    residual, free, tolerance = np.full(len(star), np.nan), 4, math.inf
    wide = float(np.max(np.hypot(*(camera.spots_px - camera.principal_px).T))) / focal_px > 0.25
    for passes in range(8):
        count = int(np.sum(star >= 0))
        if count < LEAST_MATCHES:
            return None
        free = 4 if camera.principal_known or count < 9 or passes == 0 else 6 if wide and count >= 14 else 5
        for _ in range(3):
            camera.improve(star, stars, free)
        if not (0.5 < camera.focal_px / focal_px < 2.0 and np.all(np.abs(camera.distortion) < 5.0)):
            return None
        d = camera.rays()[star >= 0] - stars[star[star >= 0], :3] @ camera.dcm.T
        spread = 1.4826 * float(np.median(np.linalg.norm(d, axis=1))) / 1.1774  # per axis, robust
        camera.variance = max(spread, LEAST_NOISE_PX / focal_px) ** 2
        tolerance = min(tolerance, max(5.0 * spread, 0.5 / focal_px))
        star, residual = _match(camera.rays(), camera.dcm, stars, tolerance)
    return _Settled(camera, star, residual, free, tolerance)


def _judge(found: _Settled, stars: Matrix, tried: float) -> CameraFit | None:
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
    covariance = camera.improve(star, stars, free)
    dcm, covariance = camera.about_centre(covariance)
    return CameraFit(
        dcm=dcm,
        focal_px=camera.focal_px,
        distortion=camera.distortion,
        star=star,
        residual_rad=residual,
        covariance=covariance,
        log10_false_alarm=log / math.log(10.0),
        lens=camera.lens,
    )


def _log_false_alarm(star: Codes, magnitude: Vector, tolerance: float, free: int, tried: float) -> float:
    """Logarithm of a bound on the expected number of fits as good by chance, brightness counted.

    Of the first m spots c have a star among the s brightest of the sky. Thrown at random over it, c given spots fall so
    close to such stars with probability p^c, p = s tolerance^2 / 4, and there are C(m, c) choices of them. Fitted lens
    parameters take half a match each. The least over m = n, n/sqrt 2, n/2, ... and s counts once for each that was
    tried.
    """
    from scipy.special import gammaln

    n, matched = len(star), star >= 0
    rank = np.where(matched, np.searchsorted(np.sort(magnitude), magnitude[star], side="right"), len(magnitude) + 1)
    shares = 0.5 ** (0.5 * np.arange(max(1, round(2.0 * math.log2(n / LEAST_MATCHES)) + 1)))
    first, least = np.maximum(np.round(n * shares), LEAST_MATCHES), math.inf
    for halvings in range(DEPTHS):
        bright = len(magnitude) / 2.0**halvings
        c = np.cumsum(rank <= bright)[first.astype(np.int64) - 1]
        choices = gammaln(first + 1.0) - gammaln(c + 1.0) - gammaln(first - c + 1.0)
        log = choices + (c - 0.5 * free) * math.log(min(1.0, 0.25 * CLUSTERING * bright * tolerance**2))
        least = min(least, float(np.min(log[c >= LEAST_MATCHES], initial=math.inf)))
    return math.log(tried * len(first) * DEPTHS) + least


def _bright_stars_are_there(camera: _Camera, stars: Matrix, star: Codes) -> bool:
    """Whether enough of the stars brighter than the median match, where matches lie about, are matched.

    Within the convex hull of the matched spots: of a sky partly hidden by a roof the rest shows no star.
    """
    from scipy.spatial import Delaunay, QhullError

    used = star[star >= 0]
    bright = stars[stars[:, 3] <= np.median(stars[used, 3])]
    v = bright[:, :3] @ camera.dcm.T
    v = v[v[:, 2] > 0.1]
    p, corners = central_projection(v), central_projection(camera.rays()[star >= 0])
    try:
        inside = Delaunay(corners).find_simplex(p) >= 0
    except QhullError:  # all on one line
        return False
    return int(np.sum(stars[used, 3] <= np.median(stars[used, 3]))) >= LEAST_BRIGHT_SEEN * int(np.sum(inside))
