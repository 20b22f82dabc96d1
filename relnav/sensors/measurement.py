"""What every sensor returns: a value, its covariance, and a status that says why when there is neither."""

from dataclasses import dataclass
from enum import IntEnum

from relnav.arrays import Matrix, Vector


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


@dataclass(frozen=True)
class Measurement:
    """Position of the sensor in the target's docking frame, from one image.

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

    @property
    def ok(self) -> bool:
        """Whether value and covariance can be used."""
        return self.status is Status.OK

    @property
    def value(self) -> Vector:
        """The three numbers as one array (3,): range m, azimuth rad, elevation rad."""
        import numpy as np

        return np.array([self.range_m, self.azimuth_rad, self.elevation_rad])
