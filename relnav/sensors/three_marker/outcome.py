"""What a measurement of relative position and attitude says, and when it says nothing."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.sensors.measurement import Status
from relnav.sensors.three_marker.pose import Pose, Root

AMBIGUITY_LIMIT = 2.0 * math.log(1e4)
"""Twice the log of the odds, ten thousand to one, at which the first root is believed alone."""
MISFIT_PROBABILITY = 1e-6
"""Probability with which spots of four markers or more misfit so much by chance that no pose is believed."""
NO_POSE = Pose(np.full(3, np.nan), np.full((3, 3), np.nan), np.full((6, 6), np.nan))


@dataclass(frozen=True)
class PoseMeasurement:
    """Relative position and attitude from one image.

    Attributes
    ----------
    position_m : (3,)
        The target's centre of mass from the camera, camera axes; NaN unless `status` is OK.
    dcm_cam_from_target : (3, 3)
        v_cam = dcm @ v_target; NaN unless `status` is OK.
    covariance : (6, 6)
        Of (position error in camera axes, m; attitude error in target axes, rad); NaN unless `status` is OK.
    status : Status
        Why there is no value, if there is none. OUTSIDE_DOMAIN: another pose explains the spots as well (`roots`).
        DEGENERATE: so near a singular view that no covariance describes the error. NO_CONVERGENCE: no pose explains
        the spots, or the best one misfits four spots or more by more than one in a million would by chance.
    ambiguity : float
        Twice the log of the odds of the first pose against the next under spots and prior; infinite if there is no
        other. Below 18.4 (odds of ten thousand) the status is OUTSIDE_DOMAIN.
    root_gap_rad : float
        Angle from the first root to the nearest other one.
    misfit, dof : float, int
        Chi-square of the spots about the pose, and its degrees of freedom, 2 n - 6.
    roots : tuple of Root
        Every pose that explains the spots, the most likely first, each with its covariance.
    labels : (k,)
        Marker of each spot of the call, -1 for a spot not used.
    """

    position_m: Vector
    dcm_cam_from_target: Matrix
    covariance: Matrix
    status: Status
    ambiguity: float
    root_gap_rad: float
    misfit: float
    dof: int
    roots: tuple[Root, ...]
    labels: tuple[int, ...]

    @property
    def ok(self) -> bool:
        """Whether value and covariance can be used."""
        return self.status is Status.OK

    @property
    def pose(self) -> Pose:
        """Position, attitude and covariance as one value."""
        return Pose(self.position_m, self.dcm_cam_from_target, self.covariance)


@cache
def largest_misfit(dof: int) -> float:
    """Chi-square of so many degrees of freedom that chance exceeds once in a million times."""
    from scipy.special import chdtri  # half a second for those who only load a model

    return float(chdtri(dof, MISFIT_PROBABILITY))


def judged(
    roots: list[Root], labels: list[int], count: int, gap_rad: float, *, gaussian: bool, gated: bool = True
) -> PoseMeasurement:
    """Measurement of ranked roots: the first one's value if it can be believed.

    count: spots used; gap_rad: angle from the first root to the nearest other one; gaussian: whether the first root's
    covariance describes its error; gated: whether a large misfit is a reason not to believe it.
    """
    if not roots:
        return no_measurement(Status.NO_CONVERGENCE, labels)
    best, dof = roots[0].pose, 2 * count - 6
    ambiguity = roots[1].score - roots[0].score if len(roots) > 1 else math.inf
    status = Status.OK
    if gated and dof > 0 and roots[0].misfit > largest_misfit(dof):
        status = Status.NO_CONVERGENCE
    elif ambiguity < AMBIGUITY_LIMIT:
        status = Status.OUTSIDE_DOMAIN
    elif not gaussian:
        status = Status.DEGENERATE
    if status is not Status.OK:
        best = NO_POSE
    position, dcm, covariance = best.position_m, best.dcm_cam_from_target, best.covariance
    for array in (position, dcm, covariance):
        array.setflags(write=False)
    return PoseMeasurement(
        position,
        dcm,
        covariance,
        status,
        ambiguity,
        gap_rad,
        roots[0].misfit,
        dof,
        tuple(roots),
        tuple(labels),
    )


def no_measurement(status: Status, labels: list[int]) -> PoseMeasurement:
    """No value, and why."""
    nan = math.nan
    return PoseMeasurement(
        NO_POSE.position_m, NO_POSE.dcm_cam_from_target, NO_POSE.covariance, status, nan, nan, nan, 0, (), tuple(labels)
    )
