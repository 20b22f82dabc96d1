"""What the target-attitude filter says of one epoch, and of the target's rotation relative to the chaser."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Record, Vector, frozen, numbers, vector
from relnav.estimation.attitude import ATTITUDE_TRACK, CHASER, COMPARED, LASTING, TURNING
from relnav.estimation.factored import compose
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation import is_rotation
from relnav.navigation.arguments import not_negative
from relnav.navigation.status import EpochStatus

NOT_COMPARED = np.full(1, np.nan, COMPARED).tobytes()
NOT_KNOWN = np.full(1, np.nan, ATTITUDE_TRACK).tobytes()


@dataclass(frozen=True)
class RelativeAttitude:
    """The target's rotation relative to the chaser.

    Attributes
    ----------
    dcm_target_from_chaser : (3, 3)
        v_target = dcm @ v_chaser.
    rate_rad_s : (3,)
        Of the target relative to the chaser, target axes.
    covariance : (6, 6)
        Of (theta, rate error), rad and rad/s, target axes: the true attitude of the target, seen from the
        chaser, is dcm^T exp([theta x]).
    """

    dcm_target_from_chaser: Matrix
    rate_rad_s: Vector
    covariance: Matrix


class AttitudeRecord:
    """The target's rotation after one epoch. It is a copy: later steps do not change it; its arrays are read-only.

    Attributes
    ----------
    t_s : float
        Time of the epoch.
    accepted : bool
        Whether the attitude measured here is in the state. One whose own NIS is small is not where the latest
        innovations together say that the track is off.
    rejections : int
        Measured attitudes rejected in a row up to here.
    """

    def __init__(
        self,
        t_s: float,
        status: int,
        accepted: bool,
        rejections: int,
        track: bytes,
        compared: bytes,
        mean_motion_rad_s: float,
        chaser_sigma_rad: float,
    ) -> None:
        """Take what the filter says, an ATTITUDE_TRACK and a COMPARED, and the orbit and chaser that it says it of."""
        self.t_s, self._status, self.accepted, self.rejections = t_s, status, accepted, rejections
        self._of_track, self._of_comparison = track, compared
        self._mean_motion, self._chaser_sigma = mean_motion_rad_s, chaser_sigma_rad

    @cached_property
    def _track(self) -> Record:
        return np.frombuffer(self._of_track, ATTITUDE_TRACK)[0]

    @cached_property
    def _compared(self) -> Record:
        return np.frombuffer(self._of_comparison, COMPARED)[0]

    @property
    def dcm_lvlh_from_target(self) -> Matrix:
        """Attitude of the target, (3, 3); NaN with the rest while WAITING."""
        return frozen(self._track["dcm"].copy())

    @property
    def rate_rad_s(self) -> Vector:
        """Inertial rate of the target, target axes, (3,)."""
        return frozen(self._track["rate"].copy())

    @cached_property
    def covariance(self) -> Matrix:
        """Of (theta, rate error), rad and rad/s, target axes, (6, 6): the true attitude is dcm exp([theta x])."""
        track = self._track
        return frozen(compose(track["ld"]) + track["lasting"] @ track["lasting"].T)

    @property
    def innovation_rad(self) -> Vector:
        """Rotation vector from prediction to measured attitude, (3,); NaN with the next two where none was compared."""
        return frozen(self._compared["innovation"].copy())

    @property
    def innovation_covariance(self) -> Matrix:
        """What was expected of it, rad^2, (3, 3)."""
        return frozen(self._compared["innovation_covariance"].copy())

    @property
    def nis(self) -> float:
        """Of the innovation, before the gate; NaN where nothing was measured, and while a start is looked for."""
        return float(self._compared["nis"])

    @property
    def dof(self) -> int:
        """Degrees of freedom of `nis`: 3, or 0 where it is NaN."""
        return 3 if self.nis == self.nis else 0

    @property
    def status(self) -> EpochStatus:
        """Outcome of the epoch.

        WAITING: no state; UPDATED; STARTED, anew or for the first time; PREDICTED: nothing was measured; REJECTED: the
        latest measured attitude contradicts the state, which is a prediction and must not be used. It stays so over
        epochs without a measurement.
        """
        return EpochStatus(self._status)

    def relative(
        self,
        dcm_chaser_from_lvlh: ArrayLike,
        chaser_rate_rad_s: ArrayLike | None = None,
        *,
        chaser_rate_sigma_rad_s: float = 0.0,
    ) -> RelativeAttitude:
        """The target's rotation relative to the chaser at this epoch; NaN while WAITING.

        A lasting error of the chaser's attitude drops out as far as it turned the measured attitudes alike: the
        relative attitude is what was measured, and is known better than the target's in `lvlh_ccsds`.

        Parameters
        ----------
        dcm_chaser_from_lvlh : (3, 3)
            The chaser's attitude, from the same source as in the measured attitudes.
        chaser_rate_rad_s : (3,), optional
            Its inertial rate, chaser axes; that of a chaser held in `lvlh_ccsds` if left out.
        chaser_rate_sigma_rad_s : float
            1-sigma of that rate, each axis.

        Raises
        ------
        ValueError
            For an attitude that is no rotation, or a rate of another shape or not finite.
        """
        chaser = np.array(numbers("dcm_chaser_from_lvlh", dcm_chaser_from_lvlh))
        if not is_rotation(chaser):
            raise ValueError(f"dcm_chaser_from_lvlh must be a rotation matrix (3, 3); got {chaser.tolist()}")
        rate_sigma = not_negative("chaser_rate_sigma_rad_s", chaser_rate_sigma_rad_s)
        held = chaser_rate_rad_s is None
        given = -self._mean_motion * chaser[:, 1] if chaser_rate_rad_s is None else chaser_rate_rad_s
        own = vector("chaser_rate_rad_s", given, (3,))
        track = self._track
        dcm = chaser @ track["dcm"]
        turning, lasting = dcm.T @ own, track["lasting"].copy()
        carried = np.eye(TURNING)
        carried[3:, :3] = -cross_matrix(turning)
        by_chaser = np.zeros((TURNING, LASTING))
        by_chaser[:3, CHASER] = -self._chaser_sigma * dcm.T
        # a rate in chaser axes is seen from the target through the relative attitude, that of lvlh through its own
        lasting = carried @ lasting + by_chaser if held else carried @ (lasting + by_chaser)
        covariance = carried @ compose(track["ld"]) @ carried.T + lasting @ lasting.T
        covariance[3:, 3:] += rate_sigma**2 * np.eye(3)
        rate = track["rate"] - turning
        return RelativeAttitude(frozen(dcm.T.copy()), frozen(rate), frozen(0.5 * (covariance + covariance.T)))

    def __repr__(self) -> str:
        """One line for the console."""
        if self.status == EpochStatus.WAITING:
            return f"AttitudeRecord(t_s={self.t_s:.12g}, WAITING)"
        sigma = np.degrees(np.sqrt(np.diagonal(self.covariance)[:3]).max())
        return f"AttitudeRecord(t_s={self.t_s:.12g}, {self.status.name}, attitude to {sigma:.3g} deg)"
