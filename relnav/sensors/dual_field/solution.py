"""What the star sensor returns: the attitude with its covariance, which spot is which star, and a status."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.star_places import radec


class StarStatus(StrEnum):
    """Outcome of one frame."""

    OK = "ok"
    SINGLE_FIELD = "single_field"
    """Tracking with two fields found stars of one of them only, or so few of the other that chance may have put them
    there: the prior attitude told which, but the roll is an order of magnitude worse than promised; look at the fold's
    alignment and for glare."""
    AMBIGUOUS = "ambiguous"
    """Two attitudes explain the spots: as well as one another, or as field 0 and as field 1 of a two-field sensor of
    which only one field is seen."""
    NO_MATCH = "no_match"
    """No attitude explains the spots better than chance would."""
    TOO_FEW = "too_few"
    """Too few spots to tell a match from chance."""


def which_way(distortion: tuple[float, float]) -> str:
    """To be said after the word in a reason: whose coefficients are meant, if there are any."""
    return " (here from spot to ray, the inverse of OpenCV's)" if any(distortion) else ""


@dataclass(frozen=True)
class StarLens:
    """The camera that goes with a solution, as known or as estimated with it.

    Attributes
    ----------
    focal_length_px, principal_point_px, distortion : float, (2,), (2,)
        As of `StarCamera`: px, px, and factors without unit.
    dcm_from_icrs : (3, 3)
        Attitude of the axes whose z is the optical axis. A solution's own z looks through the picture's centre where
        the principal point is estimated.
    """

    focal_length_px: float
    principal_point_px: tuple[float, float]
    distortion: tuple[float, float]
    dcm_from_icrs: Matrix


@dataclass(frozen=True)
class StarSolution:
    """Inertial attitude from one frame of star spots.

    Attributes
    ----------
    status : StarStatus
        Unless it is OK or SINGLE_FIELD all numbers are NaN, and no spot is matched.
    reason : str
        One sentence for a frame that has no attitude.
    dcm_cam_from_icrs : (3, 3)
        v_cam = dcm @ v_icrs; camera x right, y down, z boresight of field 0.
    covariance : (3, 3)
        Of the attitude's error, camera axes, rad^2: dcm_true = exp(-[theta x]) dcm.
    hip, field : (n,)
        Of each spot, in the order of the call: Hipparcos number (0: no star), field 0 or 1 (-1: no star).
    residual_rad : (n,)
        Angle from each spot to its star; NaN without one.
    log10_false_alarm : float
        Decimal logarithm of a bound on the probability that chance gave this solution.
    tried : int
        Attitudes tried.
    focal_length_px : float
        As given, or as estimated where it was not known.
    lens : StarLens or None
        The whole camera, where it was estimated.
    """

    status: StarStatus
    reason: str
    dcm_cam_from_icrs: Matrix
    covariance: Matrix
    hip: NDArray[np.int32]
    field: Codes
    residual_rad: Vector
    log10_false_alarm: float
    tried: int
    focal_length_px: float
    lens: StarLens | None = None

    @property
    def ok(self) -> bool:
        """Whether attitude and covariance can be used."""
        return self.status in (StarStatus.OK, StarStatus.SINGLE_FIELD)

    @property
    def matches(self) -> int:
        """Number of spots that are stars."""
        return int(np.sum(self.hip > 0))

    @property
    def matches_per_field(self) -> tuple[int, int]:
        """The same for each field."""
        return int(np.sum(self.field == 0)), int(np.sum(self.field == 1))

    @property
    def sigma_rad(self) -> Vector:
        """1-sigma about the camera axes x, y, z, (3,) rad."""
        sigma: Vector = np.sqrt(np.diagonal(self.covariance))
        return sigma

    @property
    def ra_dec_roll_rad(self) -> tuple[float, float, float]:
        """Right ascension and declination of the boresight, and roll = atan2(-A[0, 2], A[1, 2]).

        Roll is the position angle of the image's up direction (-y), from north, as turned about the boresight.
        """
        A = self.dcm_cam_from_icrs
        right_ascension, declination = radec(A[2])
        return right_ascension, declination, math.atan2(-A[0, 2], A[1, 2])


def no_solution(
    status: StarStatus, reason: str, spots: int, *, tried: int = 0, focal_length_px: float = math.nan
) -> StarSolution:
    """A solution without an attitude."""
    return StarSolution(
        status=status,
        reason=reason,
        dcm_cam_from_icrs=np.full((3, 3), np.nan),
        covariance=np.full((3, 3), np.nan),
        hip=np.zeros(spots, dtype=np.int32),
        field=np.full(spots, -1, dtype=np.int64),
        residual_rad=np.full(spots, np.nan),
        log10_false_alarm=math.nan,
        tried=tried,
        focal_length_px=focal_length_px,
    )
