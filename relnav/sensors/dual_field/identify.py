"""Identify the stars of a frame of unit rays, with known optics: the default method with its preparation."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.star_places import LIGHT_KM_S
from relnav.sensors.dual_field.matching import PRIOR, SHIFT, SLIP_ROWS, Frame
from relnav.sensors.dual_field.search import AMBIGUOUS, FOUND, ONE_FIELD, WORK_ROWS, search_pairs
from relnav.sensors.dual_field.sky import Sky
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution

SINGLE_FIELD_REASON = (
    "stars of one field only were found: the roll is worse than two fields promise; is there glare in the other, or is "
    "the mirror off its place?"
)
ONE_FIELD_REASON = (
    "stars of one field only were found, and in field 0 or field 1 they mean different attitudes: is there glare in "
    "the other, is the mirror off its place (`relnav calibrate fold` finds it), is the focal length another, or is the "
    "image mirrored? With an attitude known to 2 arcmin tracking tells which"
)
OFF_FOLD_REASON = (
    "stars of both fields are found, but the fold is farther off than its stated error: fit it with "
    "`relnav calibrate fold`"
)
LEAST_SPOTS = 4
REST = np.zeros(3)
NO_FOLD = np.eye(3)
NAN = math.nan


@dataclass(frozen=True)
class Limits:
    """When a solution is believed and when the search gives up.

    Attributes
    ----------
    false_alarm_probability : float
        Bound on the probability that a frame of nothing but false spots is given an attitude.
    most_tried : float
        Attitudes tried before the frame is given up; between one and two pairs more may be finished.
    shortest_rad : float
        Pairs closer than this are not started from: they hardly fix the roll.
    least_matches : int
        Fewest matches of a solution.
    """

    false_alarm_probability: float = 1e-7
    most_tried: float = 2e6
    shortest_rad: float = math.radians(0.5)
    least_matches: int = 4

    @property
    def settings(self) -> Vector:
        """As the kernel reads them."""
        chord2 = (2.0 * math.sin(0.5 * self.shortest_rad)) ** 2
        return np.array([math.log(self.false_alarm_probability), self.most_tried, chord2, self.least_matches])


DEFAULT_LIMITS = Limits()


def make_frame(
    u: Matrix,
    sigma_rad: Vector,
    magnitude: Vector | None,
    gate: float,
    fold: Matrix | None,
    velocity_km_s: Vector | None,
    fold_covariance: Matrix | None = None,
    fainter_mag: float = 0.0,
) -> Frame:
    """The kernels' view of rays (n, 3), brightest first; without magnitudes no star is refused for its brightness."""
    slip = np.zeros((SLIP_ROWS, 3))
    if fold_covariance is not None:
        slip[PRIOR : PRIOR + 3] = fold_covariance
    W = np.concatenate([u, u @ fold.T]) if fold is not None else u
    seen = np.zeros(len(u)) if magnitude is None else magnitude
    if fold is not None:
        seen = np.concatenate([seen, seen - fainter_mag])
    return Frame(
        W=np.ascontiguousarray(W),
        sigma2=sigma_rad**2,
        information=np.empty((0, 6)),
        magnitude=seen,
        counts=np.empty(len(seen)),
        beta=REST if velocity_km_s is None else velocity_km_s / LIGHT_KM_S,
        fold=NO_FOLD if fold is None else fold,
        gate=math.inf if magnitude is None else gate,
        fields=1 if fold is None else 2,
        slip=slip,
    )


def identify(
    u: Matrix,
    sky: Sky,
    *,
    sigma_rad: Vector,
    magnitude: Vector | None = None,
    gate: float = 0.6,
    fold: Matrix | None = None,
    fold_covariance: Matrix | None = None,
    fainter_mag: float = 0.0,
    velocity_km_s: Vector | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> StarSolution:
    """Attitude and star of every spot, lost in space.

    Parameters
    ----------
    u : (n, 3)
        Unit rays in the camera frame, brightest first, finite.
    sky : Sky
        At the epoch, without aberration.
    sigma_rad : (n,)
        1-sigma of each ray about an axis normal to it.
    magnitude : (n,), optional
        Of the spots in the catalogue's passband; left out, brightness is not compared.
    gate : float
        Largest difference of magnitude between a spot and its star.
    fold : (3, 3), optional
        Of a two-field sensor (`mirror_fold`).
    fold_covariance : (3, 3), optional
        Of the small turn by which the fold is off (`sensor.Fold.covariance`); left out, it is exact.
    fainter_mag : float
        By how much a star looks fainter in field 1 than in field 0 (`sensor.Fold.fainter_mag`).
    velocity_km_s : (3,), optional
        Observer's barycentric velocity, ICRS; without it no aberration.
    limits : Limits
        When a solution is believed.
    """
    n = len(u)
    if n < LEAST_SPOTS:
        return no_solution(StarStatus.TOO_FEW, f"{n} spots; {LEAST_SPOTS} or more are needed", n)
    frame = make_frame(u, sigma_rad, magnitude, gate, fold, velocity_km_s, fold_covariance, fainter_mag)
    match, A, cov = np.empty((n, 2), dtype=np.int64), np.empty((3, 3)), np.empty((3, 3))
    info = np.empty(2)
    verdict = search_pairs(frame, sky.arrays, limits.settings, match, A, cov, np.empty((WORK_ROWS, 3)), info)
    tried = int(info[1])
    if verdict == AMBIGUOUS:
        return no_solution(StarStatus.AMBIGUOUS, "two attitudes explain the spots equally well", n, tried=tried)
    if verdict == ONE_FIELD:
        return no_solution(StarStatus.AMBIGUOUS, ONE_FIELD_REASON, n, tried=tried)
    if verdict != FOUND:
        return no_solution(StarStatus.NO_MATCH, f"none of {tried} attitudes explains the spots", n, tried=tried)
    return solution_of(frame, sky, match, A, cov, info)


def solution_of(frame: Frame, sky: Sky, match: Codes, A: Matrix, cov: Matrix, info: Vector) -> StarSolution:
    """A settled attitude as a solution."""
    star, matched = match[:, 0], match[:, 0] >= 0
    field = np.where(matched, match[:, 1], -1)
    both = frame.fields == 1 or bool(np.any(field == 1) and np.any(field == 0))
    return StarSolution(
        status=StarStatus.OK if both else StarStatus.SINGLE_FIELD,
        reason="" if both else SINGLE_FIELD_REASON,
        dcm_cam_from_icrs=A,
        covariance=cov,
        hip=np.where(matched, sky.hip[star], 0),
        field=field,
        residual_rad=residuals(frame, sky, match, A),
        log10_false_alarm=float(info[0]) / math.log(10.0),
        tried=int(info[1]),
        focal_length_px=NAN,
    )


def residuals(frame: Frame, sky: Sky, match: Codes, A: Matrix) -> Vector:
    """Angle (n,) from each spot to its star, rad; NaN without one."""
    n, star = len(match), match[:, 0]
    v = sky.arrays.stars[star, :3] + frame.beta  # first order is enough for a residual
    v /= np.sqrt(np.einsum("ij,ij->i", v, v))[:, None]
    second = (match[:, 1] == 1) & (star >= 0)
    w = frame.W[np.arange(n) + n * second]
    w = w + np.cross(frame.slip[SHIFT], w) * second[:, None]
    d = w - v @ A.T
    return np.where(star >= 0, np.sqrt(np.einsum("ij,ij->i", d, d)), np.nan)
