"""What the filter says of one epoch, and of a whole log."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.estimation.consistency import Consistency, nis_consistency
from relnav.navigation.considered import add_considered
from relnav.navigation.docking_view import LOWER, UPPER, symmetric, views
from relnav.navigation.memory import Snapshot, snapshot
from relnav.navigation.presented import Presented
from relnav.navigation.status import STARTED, UPDATED, EpochStatus
from relnav.sensors.measurement import Status

PER_EPOCH = ("t_s", "state", "factor", "innovation", "nis", "dof", "status", "measurement_status")
DIAGONAL = np.flatnonzero(np.equal(*UPPER))
"""Which of the 21 elements are variances."""


class FilterRecord:
    """State of the filter just after one epoch. It is a copy: later steps do not change it.

    Every attribute is computed when asked for, in SI units and radians; without a state yet they are NaN.
    """

    __slots__ = ("_memory",)

    def __init__(self, memory: bytes) -> None:
        """Take a copy of what `memory.KEPT` names."""
        self._memory = memory

    @property
    def _kept(self) -> Snapshot:
        return snapshot(self._memory)

    @property
    def t_s(self) -> float:
        """Time of the epoch, the log's own clock."""
        return float(self._kept.kept["clock"]["t"])

    @property
    def has_state(self) -> bool:
        """Whether the filter has started."""
        return bool(self._kept.kept["clock"]["running"] > 0)

    @property
    def state(self) -> Vector:
        """Chaser relative to target, `lvlh_ccsds`: position m, velocity m/s in the rotating frame, (6,)."""
        return self._kept.kept["track"]["state"].copy() if self.has_state else np.full(6, np.nan)

    @property
    def covariance(self) -> Matrix:
        """Covariance of `state`, (6, 6), with what a calibration's lasting error adds."""
        covariance: Matrix = symmetric(self._view()[9:])[0]
        return covariance

    def _view(self) -> Matrix:
        """`docking_view.VIEW_ROWS` of this epoch, (30, 1)."""
        kept, _, sensitivities = self._kept
        mount, dock = kept["mount"], kept["dock"]
        lever = mount[:, :3].T @ mount[:, 3]
        ld = np.full((6, 6), np.nan)
        if self.has_state:
            ld = kept["track"]["ld"].copy()
            add_considered(ld, sensitivities)
        return views(self.state[None], ld[LOWER][None], dock[:, :3], dock[:, 3], lever[None])

    @property
    def range_m(self) -> float:
        """Distance of the camera from O."""
        return float(self._view()[0, 0])

    @property
    def azimuth_rad(self) -> float:
        """Azimuth of the camera in the docking frame, atan2(y, x)."""
        return float(self._view()[1, 0])

    @property
    def elevation_rad(self) -> float:
        """Elevation of the camera in the docking frame, atan2(-z, hypot(x, y))."""
        return float(self._view()[2, 0])

    @property
    def docking_covariance(self) -> Matrix:
        """Covariance of (range m, azimuth rad, elevation rad), (3, 3)."""
        covariance: Matrix = symmetric(self._view()[3:9])[0]
        return covariance

    @property
    def sigma_range_m(self) -> float:
        """1-sigma of the range."""
        return float(np.sqrt(self._view()[3, 0]))

    @property
    def sigma_azimuth_rad(self) -> float:
        """1-sigma of the azimuth."""
        return float(np.sqrt(self._view()[6, 0]))

    @property
    def sigma_elevation_rad(self) -> float:
        """1-sigma of the elevation."""
        return float(np.sqrt(self._view()[8, 0]))

    @property
    def innovation(self) -> Vector:
        """Measured minus predicted, two numbers a beacon: A'x, A'y, B'x, ... m, or range m, azimuth, elevation rad.

        Of everything that was seen, before the gate; NaN for the rest.
        """
        return self._kept.innovations.copy()

    @property
    def nis(self) -> float:
        """Normalised innovation squared of everything that was seen, before the gate; NaN if nothing was."""
        return float(self._kept.kept["result"]["nis"])

    @property
    def dof(self) -> int:
        """Degrees of freedom of `nis`."""
        return int(self._kept.kept["result"]["dof"])

    @property
    def status(self) -> EpochStatus:
        """What became of the epoch."""
        return EpochStatus(int(self._kept.kept["result"]["status"]))

    @property
    def measurement_status(self) -> Status:
        """Why the image could not be used, if it could not."""
        return Status(int(self._kept.kept["result"]["reason"]))

    @property
    def rejected_streak(self) -> int:
        """Consecutive epochs, up to this one, with at least half of what was seen rejected."""
        return int(self._kept.kept["clock"]["rejected"])

    @property
    def accepted(self) -> bool:
        """Whether everything that was seen was used."""
        return int(self._kept.kept["result"]["status"]) in (UPDATED, STARTED)

    def __repr__(self) -> str:
        """One line for the console."""
        if not self.has_state:
            return f"FilterRecord(t_s={self.t_s:.12g}, {self.status.name}: {self.measurement_status.name})"
        rae, s = self._view()[:3, 0], np.sqrt(self._view()[[3, 6, 8], 0])
        return (
            f"FilterRecord(t_s={self.t_s:.12g}, {self.status.name}, range {rae[0]:.4f} +- {s[0]:.4f} m, "
            f"azimuth {np.degrees(rae[1]):.4f} +- {np.degrees(s[1]):.4f} deg, "
            f"elevation {np.degrees(rae[2]):.4f} +- {np.degrees(s[2]):.4f} deg)"
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
        Covariance as L D L^T, with what a calibration's lasting error adds: the lower triangle of `ld`, row by row, D
        on its diagonal.
    innovation, nis, dof : (n, 2 beacons), (n,), (n,)
        As in FilterRecord: of everything seen, before the gate.
    status, measurement_status : (n,)
        Codes of EpochStatus and Status.
    model, method : str
        What made it.
    restarts : int
        How often a confirmed start replaced a locked-out track.
    smoothed : bool
        Whether states and covariances rest on the measurements after them too; NIS is the filter's either way.
    dcm_dock_from_lvlh, port_m, lever_lvlh_m : (3, 3), (3,), (n, 3) or (1, 3)
        Docking frame, port and camera lever arm, from which `docking` is computed when asked for.
    metadata : dict
        What else a reader should know (source file, the log's own metadata).
    """

    t_s: Vector
    state: Matrix
    factor: Matrix
    innovation: Matrix
    nis: Vector
    dof: Codes
    status: Codes
    measurement_status: Codes
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
        return symmetric(self.view[3:9])

    @property
    def covariance(self) -> Stack:
        """Covariances of the states, (n, 6, 6)."""
        return symmetric(self.view[9:])

    @property
    def sigma(self) -> Matrix:
        """1-sigma of each state component, (n, 6)."""
        return np.sqrt(self.view[9:][DIAGONAL].T)

    @property
    def docking_sigma(self) -> Matrix:
        """1-sigma of range m, azimuth rad, elevation rad, (n, 3)."""
        return np.sqrt(self.view[[3, 6, 8]].T)

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
        """Whether everything that was seen at the epoch was used, (n,)."""
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
        """NIS of the epochs that were used whole; rejected ones are counted, not averaged in."""
        return nis_consistency(self.nis[self.accepted], self.dof[self.accepted], probability)

    def __len__(self) -> int:
        return len(self.t_s)
