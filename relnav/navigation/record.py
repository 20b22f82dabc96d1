"""What the filter says of one epoch, and of a whole log."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import degrees
from struct import Struct
from typing import Any, ClassVar

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.dynamics.error_state import MOTION
from relnav.estimation.consistency import Consistency, nis_consistency
from relnav.estimation.whiteness import NeighbourSums
from relnav.navigation.docking_view import DOCKING_ROWS, STATE_ROWS, UPPER, symmetric, views
from relnav.navigation.epoch_report import REPORT
from relnav.navigation.lasting_words import in_every_image
from relnav.navigation.presented import Presented
from relnav.navigation.status import STARTED, UPDATED, Alarm, EpochStatus
from relnav.sensors.measurement import Status

PER_EPOCH = ("t_s", "state", "factor", "innovation", "nis", "dof", "status", "measurement_status", "alarm")
DIAGONAL = np.flatnonzero(np.equal(*UPPER))
"""Which of the 21 elements are variances."""


_FLOAT = np.dtype(np.float64)
_AT = {name: place for name, (_, place, *_) in REPORT.fields.items()}  # type: ignore[union-attr]  # it has fields
_T, _NIS, _STATE, _COVARIANCE = _AT["t"], _AT["nis"], _AT["state"], _AT["covariance"]
_JOINT = _AT["docking_covariance"]
_RANGE, _AZIMUTH, _ELEVATION = (_AT["docking"] + 8 * k for k in range(3))
_SIGMA_RANGE, _SIGMA_AZIMUTH, _SIGMA_ELEVATION = (_AT["docking_sigma"] + 8 * k for k in range(3))
real_at: Callable[[bytes, int], tuple[float]] = Struct("d").unpack_from
whole_at: Callable[[bytes, int], tuple[int]] = Struct("q").unpack_from
"""Of a record's bytes, the number at a place."""


class FilterRecord:
    """State of the filter just after one epoch. It is a copy, and read-only: later steps do not change it.

    SI units and radians; NaN as long as there is no state.
    """

    __slots__ = ("_memory",)
    PLACES: ClassVar = {
        "t_s": (_T, ()),
        "state": (_STATE, (MOTION,)),
        "covariance": (_COVARIANCE, (MOTION, MOTION)),
        "range_m": (_RANGE, ()),
        "azimuth_rad": (_AZIMUTH, ()),
        "elevation_rad": (_ELEVATION, ()),
        "docking_covariance": (_JOINT, (3, 3)),
        "sigma_range_m": (_SIGMA_RANGE, ()),
        "sigma_azimuth_rad": (_SIGMA_AZIMUTH, ()),
        "sigma_elevation_rad": (_SIGMA_ELEVATION, ()),
        "nis": (_NIS, ()),
    }
    """What properties read, for `codegen.python_members`: where it is, and its shape."""

    def __init__(self, memory: bytes) -> None:
        """Take what `epoch_report.REPORT` names, and the innovations behind it."""
        self._memory = memory

    @property
    def t_s(self) -> float:
        """Time of the epoch, the log's own clock."""
        return real_at(self._memory, _T)[0]

    @property
    def has_state(self) -> bool:
        """Whether the filter has started."""
        return whole_at(self._memory, _AT["has_state"])[0] > 0

    @property
    def state(self) -> Vector:
        """Chaser relative to target, `lvlh_ccsds`: position m, velocity m/s in the rotating frame, (6,)."""
        return np.ndarray((MOTION,), _FLOAT, self._memory, _STATE)

    @property
    def covariance(self) -> Matrix:
        """Covariance of `state`, (6, 6), the constant error of a calibration included."""
        return np.ndarray((MOTION, MOTION), _FLOAT, self._memory, _COVARIANCE)

    @property
    def range_m(self) -> float:
        """Distance of the camera from O."""
        return real_at(self._memory, _RANGE)[0]

    @property
    def azimuth_rad(self) -> float:
        """Azimuth of the camera in the docking frame, atan2(y, x)."""
        return real_at(self._memory, _AZIMUTH)[0]

    @property
    def elevation_rad(self) -> float:
        """Elevation of the camera in the docking frame, atan2(-z, hypot(x, y))."""
        return real_at(self._memory, _ELEVATION)[0]

    @property
    def docking_covariance(self) -> Matrix:
        """Covariance of (range m, azimuth rad, elevation rad), (3, 3)."""
        return np.ndarray((3, 3), _FLOAT, self._memory, _JOINT)

    @property
    def sigma_range_m(self) -> float:
        """1-sigma of the range."""
        return real_at(self._memory, _SIGMA_RANGE)[0]

    @property
    def sigma_azimuth_rad(self) -> float:
        """1-sigma of the azimuth."""
        return real_at(self._memory, _SIGMA_AZIMUTH)[0]

    @property
    def sigma_elevation_rad(self) -> float:
        """1-sigma of the elevation."""
        return real_at(self._memory, _SIGMA_ELEVATION)[0]

    @property
    def innovation(self) -> Vector:
        """Measured minus predicted, (2 n,): two numbers a beacon, A'x, A'y, B'x, ... m, or range m, azimuth, elevation.

        Angles are in rad. Of all measured spots, before the gate; NaN for the others.
        """
        return np.frombuffer(self._memory, _FLOAT, offset=REPORT.itemsize)

    @property
    def nis(self) -> float:
        """Normalised innovation squared (NIS) of all measured spots, before the gate; NaN if there were none."""
        return real_at(self._memory, _NIS)[0]

    @property
    def dof(self) -> int:
        """Degrees of freedom of `nis`."""
        return whole_at(self._memory, _AT["dof"])[0]

    @property
    def status(self) -> EpochStatus:
        """Outcome of the epoch."""
        return EpochStatus(whole_at(self._memory, _AT["status"])[0])

    @property
    def measurement_status(self) -> Status:
        """Why the image could not be used, if it could not."""
        return Status(whole_at(self._memory, _AT["reason"])[0])

    @property
    def alarm(self) -> Alarm:
        """Result of the monitors: unless it is NONE (0) do not use the state."""
        return Alarm(whole_at(self._memory, _AT["alarm"])[0])

    @property
    def rejected_streak(self) -> int:
        """Consecutive epochs, up to this one, with at least half of the measured spots rejected."""
        return whole_at(self._memory, _AT["rejected"])[0]

    @property
    def accepted(self) -> bool:
        """Whether all measured spots were accepted."""
        return whole_at(self._memory, _AT["status"])[0] in (UPDATED, STARTED)

    def __repr__(self) -> str:
        """One line for the console."""
        if not self.has_state:
            return f"FilterRecord(t_s={self.t_s:.12g}, {self.status.name}: {self.measurement_status.name})"
        return (
            f"FilterRecord(t_s={self.t_s:.12g}, {self.status.name}, "
            f"range {self.range_m:.4f} +- {self.sigma_range_m:.4f} m, "
            f"azimuth {degrees(self.azimuth_rad):.4f} +- {degrees(self.sigma_azimuth_rad):.4f} deg, "
            f"elevation {degrees(self.elevation_rad):.4f} +- {degrees(self.sigma_elevation_rad):.4f} deg"
            f"{f', ALARM {self.alarm.words}' if self.alarm else ''})"
        )


@dataclass(frozen=True, repr=False)
class Solution(Presented):
    """A filtered log: arrays over its n epochs, SI units and radians, NaN before the filter has started.

    Attributes
    ----------
    t_s : (n,)
        Times of the epochs.
    state : (n, 6)
        Chaser relative to target, `lvlh_ccsds`.
    factor : (n, 21)
        Covariance as L D L^T, the constant error of a calibration included: the lower triangle of `ld`, row by row, D
        on its diagonal.
    innovation, nis, dof : (n, 2 beacons), (n,), (n,)
        As in FilterRecord: of all measured spots, before the gate.
    status, measurement_status : (n,)
        Codes of EpochStatus and Status.
    alarm : (n,)
        Bits of Alarm: where one is set do not use the state.
    model, method : str
        What made it.
    restarts : int
        How often a confirmed start replaced a locked-out track.
    smoothed : bool
        Whether states and covariances are smoothed; NIS is the filter's in either case.
    dcm_dock_from_lvlh, port_m, lever_lvlh_m : (3, 3), (3,), (n, 3) or (1, 3)
        Docking frame, port and camera lever arm, from which `docking` is computed on request.
    metadata : dict
        Further information (source file, the log's own metadata).
    """

    t_s: Vector
    state: Matrix
    factor: Matrix
    innovation: Matrix
    nis: Vector
    dof: Codes
    status: Codes
    measurement_status: Codes
    alarm: Codes
    model: str
    method: str
    restarts: int
    dcm_dock_from_lvlh: Matrix
    port_m: Vector
    lever_lvlh_m: Matrix
    smoothed: bool = False
    metadata: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def view(self) -> Matrix:
        """Range, azimuth, elevation, their covariance and the state's, as rows (30, n): `docking_view.VIEW_ROWS`."""
        return views(self.state, self.factor, self.dcm_dock_from_lvlh, self.port_m, self.lever_lvlh_m)

    @property
    def docking(self) -> Matrix:
        """Range m, azimuth rad, elevation rad of the camera in the docking frame, (n, 3)."""
        return self.view[:3].T

    @property
    def docking_covariance(self) -> Stack:
        """Covariance of `docking`, (n, 3, 3)."""
        return symmetric(self.view[DOCKING_ROWS])

    @property
    def covariance(self) -> Stack:
        """Covariances of the states, (n, 6, 6)."""
        return symmetric(self.view[STATE_ROWS])

    @property
    def sigma(self) -> Matrix:
        """1-sigma of each state component, (n, 6)."""
        return np.sqrt(self.view[STATE_ROWS][DIAGONAL].T)

    @property
    def docking_sigma(self) -> Matrix:
        """1-sigma of range m, azimuth rad, elevation rad, (n, 3)."""
        return np.sqrt(self.view[DOCKING_ROWS][[0, 3, 5]].T)

    @property
    def range_m(self) -> Vector:
        """Range of the camera from O, (n,)."""
        return self.docking[:, 0]

    @property
    def azimuth_rad(self) -> Vector:
        """Azimuth of the camera in the docking frame, (n,)."""
        return self.docking[:, 1]

    @property
    def elevation_rad(self) -> Vector:
        """Elevation of the camera in the docking frame, (n,)."""
        return self.docking[:, 2]

    @property
    def accepted(self) -> Flags:
        """Whether all measured spots of the epoch were accepted, (n,)."""
        used: Flags = (self.status == UPDATED) | (self.status == STARTED)
        return used

    def part(self, begin: int, end: int) -> "Solution":
        """Epochs begin .. end - 1 as a solution of their own (views, not copies)."""
        cut = slice(begin, end)
        arrays: dict[str, Any] = {name: getattr(self, name)[cut] for name in PER_EPOCH}
        if len(self.lever_lvlh_m) > 1:
            arrays["lever_lvlh_m"] = self.lever_lvlh_m[cut]
        return replace(self, **arrays)

    def nis_consistency(self, probability: float = 0.95) -> Consistency:
        """NIS of the epochs whose spots were all accepted, and correlation of their innovations.

        Without an interval where `metadata["considered"]` names lasting errors, which are the same in every epoch.
        """
        considered, whole = str(self.metadata.get("considered", "")), self.accepted
        neighbours = None if in_every_image(considered) else NeighbourSums()
        if neighbours is not None:
            neighbours.take(self.innovation, whole)
        lasting, nis, dof = bool(considered), self.nis[whole], self.dof[whole]
        return nis_consistency(nis, dof, probability, lasting=lasting, neighbours=neighbours)

    def __len__(self) -> int:
        return len(self.t_s)
