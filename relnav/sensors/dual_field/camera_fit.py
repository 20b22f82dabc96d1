"""Fit attitude, focal length and distortion to a frame's matches, and judge whether chance could have made them."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection
from relnav.sensors.dual_field.matching import turn
from relnav.sensors.dual_field.optics import plane_points, rays
from relnav.sensors.dual_field.sky import Sky
from relnav.sensors.dual_field.solution import StarSolution, StarStatus

CLUSTERING = 2.0
LEAST_MATCHES = 6
LEAST_BRIGHT_SEEN = 0.4
"""Share of the bright stars that should be in the frame that must be among the spots."""


@dataclass(frozen=True)
class CameraFit:
    """A fitted camera.

    Attributes
    ----------
    dcm, focal_px, distortion : (3, 3), float, (2,)
        The fit.
    star : (n,)
        Star of each spot, -1 none.
    residual_rad : (n,)
        NaN without a star.
    covariance : (3, 3)
        Of the attitude, with focal length and distortion as unknowns, from the residuals' own spread.
    log10_false_alarm : float
        That chance made it.
    """

    dcm: Matrix
    focal_px: float
    distortion: Vector
    star: Codes
    residual_rad: Vector
    covariance: Matrix
    log10_false_alarm: float

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
        )


@dataclass
class _Camera:
    """The unknowns and what they are fitted to."""

    spots_px: Matrix
    principal_px: tuple[float, float]
    dcm: Matrix
    focal_px: float
    distortion: Vector

    def rays(self) -> Matrix:
        return rays(plane_points(self.spots_px, self.focal_px, self.principal_px, self.distortion))

    def improve(self, star: Codes, stars: Matrix, free: int) -> Matrix:
        """One Gauss-Newton step over the matches; the inverse normal matrix (free, free), for unit variance in rad^2.

        Unknowns: three rotations, log focal length, k1, k2, the first `free` of them.
        """
        used = star >= 0
        w, q = self.rays()[used], stars[star[used], :3] @ self.dcm.T
        J = np.zeros((len(w), 3, free))
        J[:, :, :3] = cross_matrix(q)  # w = q - d x q
        for column, (log_f, k1, k2) in zip(range(3, free), ((1e-6, 0, 0), (0, 1e-4, 0), (0, 0, 1e-3)), strict=False):
            step = max(log_f, k1, k2)
            changed = _Camera(
                self.spots_px[used],
                self.principal_px,
                self.dcm,
                self.focal_px * math.exp(log_f),
                self.distortion + np.array([k1, k2]),
            )
            J[:, :, column] = (w - changed.rays()) / step  # the ray moves the other way than its prediction
        flat, r = J.reshape(-1, free), (w - q).ravel()
        inverse = np.linalg.pinv(flat.T @ flat)
        d = inverse @ (flat.T @ r)
        turn(self.dcm, *(float(angle) for angle in d[:3]))
        if free > 3:
            self.focal_px *= math.exp(float(np.clip(d[3], -0.1, 0.1)))
        change = np.zeros(2)
        change[: max(free - 4, 0)] = d[4:free]
        self.distortion = self.distortion + change
        return np.asarray(inverse, dtype=np.float64)


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
    distortion_known: bool,
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
    dcm, focal_px, principal_px, distortion, distortion_known
        Where the fit starts, and what of it is known.
    tried : float
        Attitudes tried so far.
    """
    camera = _Camera(spots_px, principal_px, dcm, focal_px, np.array(distortion, dtype=np.float64))
    star = np.full(len(spots_px), -1, dtype=np.int64)
    star[: len(first_match)] = first_match
    residual = np.full(len(spots_px), np.nan)
    inverse = np.eye(4)
    wide = float(np.max(np.hypot(*(spots_px - principal_px).T))) / focal_px > 0.25
    tolerance = math.inf
    for passes in range(8):
        count = int(np.sum(star >= 0))
        if count < LEAST_MATCHES:
            return None
        free = 4 if distortion_known or count < 9 or passes == 0 else 6 if wide and count >= 14 else 5
        for _ in range(3):
            inverse = camera.improve(star, stars, free)
        if not (0.5 < camera.focal_px / focal_px < 2.0 and np.all(np.abs(camera.distortion) < 5.0)):
            return None
        d = camera.rays()[star >= 0] - stars[star[star >= 0], :3] @ camera.dcm.T
        spread = 1.4826 * float(np.median(np.linalg.norm(d, axis=1))) / 1.1774  # per axis, robust
        tolerance = min(tolerance, max(5.0 * spread, 0.5 / focal_px))
        star, residual = _match(camera.rays(), camera.dcm, stars, tolerance)
    return _judge(camera, stars, star, residual, inverse, tolerance, tried)


def _judge(
    camera: _Camera, stars: Matrix, star: Codes, residual: Vector, inverse: Matrix, tolerance: float, tried: float
) -> CameraFit | None:
    """The fit with its false alarm probability; None if the bright stars that should be there are not."""
    n, matched = len(star), star >= 0
    count = int(np.sum(matched))
    if count < LEAST_MATCHES or not _bright_stars_are_there(camera, stars, star):
        return None
    chance = 0.25 * CLUSTERING * len(stars) * tolerance**2
    choices = math.lgamma(n + 1) - math.lgamma(count + 1) - math.lgamma(n - count + 1)
    free = len(inverse)
    log = math.log(tried) + choices + (count - 0.5 * free) * math.log(min(1.0, chance))
    variance = max(float(np.nansum(residual**2)) / max(2 * count - free, 1), (0.03 / camera.focal_px) ** 2)
    return CameraFit(
        dcm=camera.dcm,
        focal_px=camera.focal_px,
        distortion=camera.distortion,
        star=star,
        residual_rad=residual,
        covariance=inverse[:3, :3] * variance,
        log10_false_alarm=log / math.log(10.0),
    )


def _bright_stars_are_there(camera: _Camera, stars: Matrix, star: Codes) -> bool:
    """Whether enough of the stars brighter than the median match, inside the spots' rectangle, are matched."""
    used = star[star >= 0]
    bright = stars[stars[:, 3] <= np.median(stars[used, 3])]
    v = bright[:, :3] @ camera.dcm.T
    v = v[v[:, 2] > 0.1]
    p, edge = central_projection(v), central_projection(camera.rays())
    inside = np.all((p > edge.min(axis=0)) & (p < edge.max(axis=0)), axis=1)
    return int(np.sum(stars[used, 3] <= np.median(stars[used, 3]))) >= LEAST_BRIGHT_SEEN * int(np.sum(inside))
