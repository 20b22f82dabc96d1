"""What every sensor returns: a value, its covariance, and a status that says why when there is neither."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.geometry.facing import roll_pitch_yaw, roll_pitch_yaw_jacobian
from relnav.geometry.rotation import quaternion_from_dcm
from relnav.geometry.spherical import position_from_angles, position_from_angles_jacobian


class Status(IntEnum):
    """Outcome of one measurement; the compiled code carries the integer."""

    OK = 0
    NOT_SEEN = 1
    """A spot that the closed form needs is missing (NaN)."""
    OFF_DETECTOR = 2
    """A spot lies where the detector has no surface."""
    DEGENERATE = 3
    """Spots coincide or line up so that no position follows from them."""
    NO_CONVERGENCE = 4
    """The iteration did not settle: no pose near the docking axis explains the spots."""
    OUTSIDE_DOMAIN = 5
    """A pose was found, but where another pose could explain the same spots."""
    SWAPPED = 6
    """The image is turned by more than 90 deg from the stated attitude: beacons A and B look swapped."""
    BEHIND = 7
    """A spot is seen of a beacon that the predicted state puts behind the camera."""
    MISALIGNED = 8
    """The image contradicts the stated attitude of the camera: a glint, a wrong attitude, or a target that turns."""
    SATURATED = 9
    """Too many of the spot's pixels are at full scale: its centre cannot be trusted."""
    AT_EDGE = 10
    """The spot touches the border of its window: part of it is cut off."""
    OUTSIDE_FIELD = 11
    """The direction lies outside the field that was calibrated."""
    TOO_LATE = 12
    """The image arrived longer after its exposure than a filter goes back."""


# The same numbers as plain integers, for compiled code.
OK = int(Status.OK)
NOT_SEEN = int(Status.NOT_SEEN)
OFF_DETECTOR = int(Status.OFF_DETECTOR)
DEGENERATE = int(Status.DEGENERATE)
NO_CONVERGENCE = int(Status.NO_CONVERGENCE)
OUTSIDE_DOMAIN = int(Status.OUTSIDE_DOMAIN)
SWAPPED = int(Status.SWAPPED)
BEHIND = int(Status.BEHIND)
MISALIGNED = int(Status.MISALIGNED)
TOO_LATE = int(Status.TOO_LATE)


@dataclass(frozen=True)
class ImpliedPose:
    """What an image implies.

    Attributes
    ----------
    dcm_cam_from_dock : (3, 3)
        Attitude of the camera, v_cam = R v_dock.
    covariance : (6, 6)
        Of (position m, theta rad).
    """

    dcm_cam_from_dock: Matrix
    covariance: Matrix


NOT_IMPLIED = ImpliedPose(np.full((3, 3), np.nan), np.full((6, 6), np.nan))


@dataclass(frozen=True)
class Measurement:
    """Position of the sensor in the target's docking frame, from one image, and the attitude that the image implies.

    What is not an attribute is computed on request. All of it is NaN unless `status` is OK.

    Attributes
    ----------
    range_m, azimuth_rad, elevation_rad : float
        Eq. (13) of Cai, Zhao, Sun, Qiao, Dai (1996),
        "Determination of target relative position and range by PSD optical sensor system"; NaN unless
        `status` is OK.
    covariance : (3, 3)
        Of (range m, azimuth rad, elevation rad); NaN unless `status` is OK.
    status : Status
        Why there is no value, if there is none.
    """

    range_m: float
    azimuth_rad: float
    elevation_rad: float
    covariance: Matrix
    status: Status
    _implied: Callable[[Vector], ImpliedPose] | None = field(default=None, repr=False, compare=False)

    @property
    def ok(self) -> bool:
        """Whether value and covariance can be used."""
        return self.status is Status.OK

    @property
    def value(self) -> Vector:
        """The three numbers as one array (3,): range m, azimuth rad, elevation rad."""
        return np.array([self.range_m, self.azimuth_rad, self.elevation_rad])

    @cached_property
    def position_m(self) -> Vector:
        """The sensor's coordinates (x', y', z') in the docking frame, m, (3,): the paper's (12), r times (x, y, z)."""
        out = np.empty(3)
        position_from_angles(self.value, out)
        return out

    @property
    def position_covariance(self) -> Matrix:
        """Covariance of `position_m`, m^2, (3, 3)."""
        by_angles = np.empty((3, 3))
        if not position_from_angles_jacobian(self.position_m, by_angles):
            return np.full((3, 3), np.nan)
        out: Matrix = by_angles @ self.covariance @ by_angles.T
        return out

    @cached_property
    def _pose(self) -> ImpliedPose:
        return NOT_IMPLIED if self._implied is None else self._implied(self.position_m)

    @property
    def dcm_cam_from_dock(self) -> Matrix:
        """Attitude of the camera that the image implies, v_cam = dcm @ v_dock, (3, 3).

        Camera axes: x right, y down in the image, z to the target. NaN with `projection="parallel"` too: the position
        of the printed form does not fit the image of a lens, and no attitude makes it fit.
        """
        return self._pose.dcm_cam_from_dock

    @property
    def q_cam_from_dock(self) -> Vector:
        """`dcm_cam_from_dock` as a unit quaternion, scalar last, (4,)."""
        dcm = self.dcm_cam_from_dock
        return quaternion_from_dcm(dcm) if np.isfinite(dcm).all() else np.full(4, np.nan)

    @property
    def pose_covariance(self) -> Matrix:
        """Of the errors of (position m, theta rad), docking axes, (6, 6): the true attitude is dcm exp([theta x])."""
        return self._pose.covariance

    @property
    def roll_pitch_yaw_rad(self) -> Vector:
        """Roll, pitch and yaw of the camera, (3,), from one that looks along the docking axis, y along the dock's z.

        Yaw about down (y), then pitch about right (x), then roll about forward (z), as of aircraft (3-2-1): positive to
        the right, up, and right side down.
        """
        return roll_pitch_yaw(self.dcm_cam_from_dock)

    @property
    def roll_pitch_yaw_covariance(self) -> Matrix:
        """Covariance of `roll_pitch_yaw_rad`, rad^2, (3, 3); NaN where the camera looks straight up or down."""
        by_turn = roll_pitch_yaw_jacobian(self.roll_pitch_yaw_rad)
        out: Matrix = by_turn @ self.pose_covariance[3:, 3:] @ by_turn.T
        return out
