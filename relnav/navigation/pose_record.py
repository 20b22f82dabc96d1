"""What the marker filter says of one epoch, and of a whole log."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Record, Stack, Vector, frozen
from relnav.dynamics.error_state import MOTION, POSE
from relnav.estimation.consistency import Consistency, nis_consistency
from relnav.mission import VisionMission
from relnav.navigation.docking_port import DockingState, docking_states
from relnav.navigation.lasting_words import marker_words
from relnav.navigation.pose_call import AS_STATED
from relnav.navigation.pose_epoch import EPOCH, covariances_of
from relnav.navigation.presented import Presented
from relnav.navigation.record import real_at, whole_at
from relnav.navigation.status import Alarm, EpochStatus
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT

_FLOAT = np.dtype(np.float64)
_AT = {name: place for name, (_, place, *_) in EPOCH.fields.items()}  # type: ignore[union-attr]  # it has fields
_PARTIAL, _REJECTED = int(EpochStatus.PARTIAL), int(EpochStatus.REJECTED)


class PoseRecord:
    """What is known after one epoch. It is a copy: later steps do not change it.

    Attributes are worked out when asked for, and read-only.
    """

    def __init__(self, memory: bytes, mission: VisionMission, chaser: Matrix, chaser_rate: Vector | None) -> None:
        """Take what `pose_call.new_report` holds, and the chaser's attitude and rate at it."""
        self._memory, self._mission, self._chaser, self._chaser_rate = memory, mission, chaser, chaser_rate

    @property
    def epoch(self) -> Record:
        """All of it as one record, `pose_epoch.EPOCH`."""
        epoch: Record = np.frombuffer(self._memory, EPOCH, 1)[0]
        return epoch

    @property
    def t_s(self) -> float:
        """Time of the epoch."""
        return real_at(self._memory, _AT["t"])[0]

    @property
    def state(self) -> Vector:
        """Chaser's centre of mass from the target's, m and m/s, `lvlh_ccsds`, (6,); NaN with the rest while WAITING."""
        return np.ndarray((MOTION,), _FLOAT, self._memory, _AT["motion"])

    @property
    def dcm_lvlh_from_target(self) -> Matrix:
        """Attitude of the target, (3, 3)."""
        return np.ndarray((3, 3), _FLOAT, self._memory, _AT["dcm"])

    @property
    def rate_rad_s(self) -> Vector:
        """Inertial rate of the target, target axes, (3,)."""
        return np.ndarray((3,), _FLOAT, self._memory, _AT["rate"])

    @property
    def covariance(self) -> Matrix:
        """Of (position, velocity, theta, rate), (12, 12), the true attitude being dcm exp([theta x]), target axes."""
        return np.ndarray((POSE, POSE), _FLOAT, self._memory, EPOCH.itemsize)

    @cached_property
    def docking(self) -> DockingState | None:
        """Port from port, with joint covariance; None while there is no state."""
        if self.hypotheses == 0:
            return None
        rate = None if self._chaser_rate is None else self._chaser_rate[None]
        whole = docking_states(
            self.state[None],
            self.dcm_lvlh_from_target[None],
            self.rate_rad_s[None],
            self.covariance[None],
            self._mission,
            self._chaser[None],
            np.array([self.t_s]),
            rate,
            np.ndarray((1, 3, POSE), _FLOAT, self._memory, _AT["by_chaser"]),
        )
        return DockingState(*(frozen(values[0]) for values in vars(whole).values()))

    @property
    def nis(self) -> float:
        """Of everything seen, before the gate; NaN where nothing was, and while a start is looked for.

        Spots off the image, or of a marker that should be behind the camera, are refused without.
        """
        return real_at(self._memory, _AT["nis"])[0]

    @property
    def dof(self) -> int:
        """Degrees of freedom of `nis`."""
        return whole_at(self._memory, _AT["dof"])[0]

    @property
    def accepted(self) -> Flags:
        """Which markers' spots were used, (n,)."""
        return frozen(np.frombuffer(self._memory, _FLOAT, offset=EPOCH.itemsize + 8 * POSE * POSE) > 0.0)

    @property
    def status(self) -> EpochStatus:
        """Outcome of the epoch."""
        return EpochStatus(whole_at(self._memory, _AT["status"])[0])

    @property
    def alarm(self) -> Alarm:
        """What monitors say, or an image shows: unless it is NONE (0) do not use the state."""
        return Alarm(whole_at(self._memory, _AT["alarm"])[0])

    @property
    def too_late(self) -> bool:
        """The image was older than the window and was not used."""
        return whole_at(self._memory, _AT["too_late"])[0] > 0

    @property
    def hypotheses(self) -> int:
        """How many poses are still possible: beyond one, the state is that of the most credible alone."""
        return whole_at(self._memory, _AT["hypotheses"])[0]

    @property
    def ambiguity(self) -> float:
        """Twice the log of the odds of that one against the next; infinite if there is no other.

        Below 18.4 (odds of ten thousand, as in `PoseMeasurement`) do not use the attitude.
        """
        return real_at(self._memory, _AT["ambiguity"])[0]

    @property
    def observable(self) -> bool:
        """False while the markers used within the model's limit are fewer than three, or stand on one line.

        A turn about it is then hardly seen, and the covariance may be too small.
        """
        return whole_at(self._memory, _AT["observable"])[0] > 0

    def __repr__(self) -> str:
        """One line for the console."""
        if self.hypotheses == 0:
            return f"PoseRecord(t_s={self.t_s:.12g}, {self.status.name})"
        x, y, z = self.state[:3]
        doubts = [
            f", {self.hypotheses} poses possible" if self.hypotheses > 1 else "",
            f", AMBIGUOUS ({self.ambiguity:.1f})" if self.ambiguity < AMBIGUITY_LIMIT else "",
            "" if self.observable else ", NOT OBSERVABLE",
            f", ALARM {self.alarm.words}" if self.alarm else "",
        ]
        where = f"position {x:.4f}, {y:.4f}, {z:.4f} m"
        return f"PoseRecord(t_s={self.t_s:.12g}, {self.status.name}, {where}{''.join(doubts)})"


@dataclass(frozen=True, repr=False)
class PoseSolution(Presented):
    """Estimates over the n epochs of a log, NaN while there was none; arrays are worked out when asked for.

    Attributes
    ----------
    mission : VisionMission
        What made it.
    epochs : (n,)
        Records of type `pose_epoch.EPOCH`.
    smoothed : bool
        Whether states rest on the images after them too; NIS and what follows it is the filter's either way.
    metadata : dict
        What else a reader should know.
    spots_px : (n, markers, 2) or None
        What was seen, for innovations (`pose_innovations`); None where an image does not belong to its row's time.
    spot_covariance_px2 : (n, markers, 2, 2), or AS_STATED
        Of each spot, likewise; the camera's noise.
    """

    mission: VisionMission
    epochs: Any
    smoothed: bool = False
    metadata: dict[str, Any] = field(default_factory=dict)
    spots_px: Stack | None = None
    spot_covariance_px2: Stack = field(default_factory=lambda: AS_STATED)

    def __len__(self) -> int:
        """Epochs."""
        return len(self.epochs)

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.mission.name

    def part(self, begin: int, end: int) -> "PoseSolution":
        """Epochs begin .. end - 1 as a solution of their own (views, not copies)."""
        spots = None if self.spots_px is None else self.spots_px[begin:end]
        own = self.spot_covariance_px2
        own = own[begin:end] if own.shape[1] else own
        return replace(self, epochs=self.epochs[begin:end], spots_px=spots, spot_covariance_px2=own)

    @property
    def t_s(self) -> Vector:
        """Times, (n,)."""
        return np.asarray(self.epochs["t"])

    @property
    def state(self) -> Matrix:
        """Chaser's centre of mass from the target's, `lvlh_ccsds`, (n, 6)."""
        return np.asarray(self.epochs["motion"])

    @property
    def dcm_lvlh_from_target(self) -> Stack:
        """Attitudes of the target, (n, 3, 3)."""
        return np.asarray(self.epochs["dcm"])

    @property
    def rate_rad_s(self) -> Matrix:
        """Inertial rates of the target, target axes, (n, 3)."""
        return np.asarray(self.epochs["rate"])

    @cached_property
    def covariance(self) -> Stack:
        """Of (position, velocity, theta, rate), as in `PoseRecord`, (n, 12, 12)."""
        return covariances_of(self.epochs["factor"])

    @cached_property
    def docking(self) -> DockingState:
        """Port from port, a leading axis for the epochs."""
        return docking_states(
            self.state,
            self.dcm_lvlh_from_target,
            self.rate_rad_s,
            self.covariance,
            self.mission,
            self.epochs["chaser"],
            self.t_s,
            by_chaser=self.epochs["by_chaser"],
        )

    @property
    def port_m(self) -> Matrix:
        """Port from port, target axes, (n, 3)."""
        return self.docking.position_m

    @property
    def port_velocity_m_s(self) -> Matrix:
        """Its velocity as seen in the turning target, (n, 3)."""
        return self.docking.velocity_m_s

    @property
    def dcm_target_from_chaser(self) -> Stack:
        """Relative attitudes, (n, 3, 3)."""
        return self.docking.dcm_target_from_chaser

    @property
    def relative_rate_rad_s(self) -> Matrix:
        """Of the target relative to the chaser, target axes, (n, 3)."""
        return self.docking.rate_rad_s

    @property
    def docking_covariance(self) -> Stack:
        """As in `DockingState`, (n, 12, 12)."""
        return self.docking.covariance

    @property
    def nis(self) -> Vector:
        """Of everything seen, before the gate, (n,)."""
        return np.asarray(self.epochs["nis"])

    @property
    def dof(self) -> Codes:
        """Degrees of freedom of `nis`, (n,)."""
        return np.asarray(self.epochs["dof"])

    @property
    def used(self) -> Codes:
        """Spots used, (n,)."""
        return np.asarray(self.epochs["used"])

    @property
    def status(self) -> Codes:
        """Codes of EpochStatus, (n,)."""
        return np.asarray(self.epochs["status"])

    @property
    def hypotheses(self) -> Codes:
        """Poses still possible, (n,)."""
        return np.asarray(self.epochs["hypotheses"])

    @property
    def ambiguity(self) -> Vector:
        """Infinite where one pose is left; below 18.4 do not use the attitude, (n,)."""
        return np.asarray(self.epochs["ambiguity"])

    @property
    def observable(self) -> Flags:
        """As in `PoseRecord`, (n,)."""
        flags: Flags = self.epochs["observable"] > 0
        return flags

    @property
    def alarm(self) -> Codes:
        """Codes of `Alarm`, (n,)."""
        return np.asarray(self.epochs["alarm"])

    @property
    def too_late(self) -> Flags:
        """As in `PoseRecord`, (n,)."""
        flags: Flags = self.epochs["too_late"] > 0
        return flags

    @property
    def refused(self) -> Flags:
        """Epochs with a spot rejected, (n,)."""
        refused: Flags = (self.status == _PARTIAL) | (self.status == _REJECTED)
        return refused

    def nis_consistency(self, probability: float = 0.95) -> Consistency:
        """NIS of the epochs whose spots were all accepted; the others are left out.

        Without an interval where the tolerances of the model are considered, which are the same in every epoch.
        """
        whole = (self.dof > 0) & ~self.refused
        lasting = bool(marker_words(self.mission))
        return nis_consistency(self.nis[whole], self.dof[whole], probability, lasting=lasting)
