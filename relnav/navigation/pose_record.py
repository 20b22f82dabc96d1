"""What the marker filter says of one epoch, and of a whole log."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Record, Stack, Vector
from relnav.codegen.kernel import kernel
from relnav.estimation.consistency import Consistency, nis_consistency
from relnav.estimation.factored import compose
from relnav.mission import VisionMission
from relnav.navigation.docking_port import DockingState, docking_states
from relnav.navigation.pose_memory import POSE, PoseMemory, pose_views
from relnav.navigation.status import EpochStatus

PACKED = POSE * (POSE + 1) // 2
LOWER = np.tril_indices(POSE)
"""Rows and columns of packed factors."""

_F, _I = np.float64, np.int64

EPOCH = np.dtype(
    [
        ("t", _F),
        ("motion", _F, 6),
        ("dcm", _F, (3, 3)),
        ("rate", _F, 3),
        ("factor", _F, PACKED),  # lower triangle of `ld`, row by row
        ("acceleration", _F, 3),  # over the interval that ends here
        ("delta_v", _F, 3),
        ("chaser", _F, (3, 3)),  # dcm_chaser_from_lvlh
        ("nis", _F),
        ("ambiguity", _F),
        ("dof", _I),
        ("status", _I),
        ("hypotheses", _I),
        ("used", _I),
        ("observable", _I),
        ("too_late", _I),
        ("row", _I),  # an epoch of the log, not the exposure of a late image
    ]
)
"""What is kept of an epoch."""


@kernel
def _spans_a_plane(m: PoseMemory, t: float, limit_s: float) -> bool:
    """Whether the markers used within the limit are all of them, or three or more that do not stand on one line."""
    s, recent, first, second, longest2 = m.points, 0, 0, 0, -1.0
    n = s.shape[0]
    for i in range(n):
        recent += 1 if t - m.used_s[i] <= limit_s else 0
    if recent == n or recent < 3:
        return bool(recent == n)
    for i in range(n):
        for j in range(i):
            if t - m.used_s[i] <= limit_s and t - m.used_s[j] <= limit_s:
                d2 = (s[i, 0] - s[j, 0]) ** 2 + (s[i, 1] - s[j, 1]) ** 2 + (s[i, 2] - s[j, 2]) ** 2
                if d2 > longest2:
                    first, second, longest2 = i, j, d2
    for i in range(n):
        if t - m.used_s[i] <= limit_s:
            a0, a1, a2 = s[i, 0] - s[first, 0], s[i, 1] - s[first, 1], s[i, 2] - s[first, 2]
            b0, b1, b2 = s[second, 0] - s[first, 0], s[second, 1] - s[first, 1], s[second, 2] - s[first, 2]
            c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
            if c0 * c0 + c1 * c1 + c2 * c2 > 1e-12 * longest2 * longest2:
                return True
    return False


@kernel
def pack_pose(ld: Matrix, packed: Vector) -> None:
    """Write the lower triangle of ld (12, 12), row by row, into packed (78,)."""
    at = 0
    for i in range(ld.shape[0]):
        for j in range(i + 1):
            packed[at] = ld[i, j]
            at += 1


@kernel
def unpack_pose(packed: Vector, ld: Matrix) -> None:
    """Write packed factors (78,) into the lower triangle of ld (12, 12)."""
    at = 0
    for i in range(ld.shape[0]):
        for j in range(i + 1):
            ld[i, j] = packed[at]
            at += 1


@kernel
def write_epoch(m: PoseMemory, out: Record) -> None:
    """Write what the filter says after its last event."""
    clock, result, lead, push, impulse, chaser = (
        m.clock,
        m.result,
        m.bank[0],
        out["acceleration"],
        out["delta_v"],
        out["chaser"],
    )
    count = clock["running"]
    for i in range(3):
        push[i], impulse[i] = m.motion["acceleration"][i], m.motion["delta_v"][i]
        for j in range(3):
            chaser[i, j] = m.camera["chaser"][i, j]
    out["t"], out["nis"], out["dof"], out["status"] = clock["t"], result["nis"], result["dof"], result["status"]
    out["hypotheses"], out["too_late"], out["row"] = count, 0, 1
    out["ambiguity"] = m.bank[1]["score"] - lead["score"] if count > 1 else math.inf
    out["observable"] = 1 if count > 0 and _spans_a_plane(m, clock["t"], m.fixed["few_markers_limit"]) else 0
    used = 0
    for i in range(m.accepted.shape[0]):
        used += 1 if m.accepted[i] > 0.0 else 0
    out["used"] = used
    motion, dcm, rate, factor = out["motion"], out["dcm"], out["rate"], out["factor"]
    if count > 0:
        for i in range(6):
            motion[i] = lead["motion"][i]
        for i in range(3):
            rate[i] = lead["rate"][i]
            for j in range(3):
                dcm[i, j] = lead["dcm"][i, j]
        pack_pose(lead["ld"], factor)
        return
    for i in range(6):
        motion[i] = math.nan
    for i in range(3):
        rate[i] = math.nan
        for j in range(3):
            dcm[i, j] = math.nan
    for i in range(factor.shape[0]):
        factor[i] = math.nan


@kernel
def read_epoch(block: Vector, out: Record) -> None:
    """`write_epoch` of a filter's memory into the first of out (1,)."""
    write_epoch(pose_views(block), out[0])


def unpacked(factor: Matrix) -> Stack:
    """Factors (n, 12, 12) of packed ones (n, 78)."""
    out = np.zeros((len(factor), POSE, POSE))
    out[:, LOWER[0], LOWER[1]] = factor
    return out


def _frozen(array: Any) -> Any:
    array.setflags(write=False)
    return array


class PoseRecord:
    """What is known after one epoch. It is a copy: later steps do not change it.

    Attributes are worked out when asked for, and read-only.
    """

    def __init__(
        self, epoch: Record, accepted: Flags, mission: VisionMission, chaser: Matrix, chaser_rate: Vector | None
    ) -> None:
        """Take an epoch (`EPOCH`), which spots were used, and the chaser's attitude and rate for the docking state."""
        self.epoch, self._mission, self._chaser, self._chaser_rate = epoch, mission, chaser, chaser_rate
        self._accepted = _frozen(accepted)

    @property
    def t_s(self) -> float:
        """Time of the epoch."""
        return float(self.epoch["t"])

    @property
    def state(self) -> Vector:
        """Chaser's centre of mass from the target's, m and m/s, `lvlh_ccsds`, (6,); NaN with the rest while WAITING."""
        motion: Vector = _frozen(self.epoch["motion"].copy())
        return motion

    @property
    def dcm_lvlh_from_target(self) -> Matrix:
        """Attitude of the target, (3, 3)."""
        dcm: Matrix = _frozen(self.epoch["dcm"].copy())
        return dcm

    @property
    def rate_rad_s(self) -> Vector:
        """Inertial rate of the target, target axes, (3,)."""
        rate: Vector = _frozen(self.epoch["rate"].copy())
        return rate

    @cached_property
    def covariance(self) -> Matrix:
        """Of (position, velocity, theta, rate), (12, 12), the true attitude being dcm exp([theta x]), target axes."""
        covariance: Matrix = _frozen(compose(unpacked(self.epoch["factor"][None])[0]))
        return covariance

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
        )
        return DockingState(*(_frozen(values[0]) for values in vars(whole).values()))

    @property
    def nis(self) -> float:
        """Of everything seen, before the gate; NaN where nothing was, and while a start is looked for.

        Spots off the image, or of a marker that should be behind the camera, are refused without.
        """
        return float(self.epoch["nis"])

    @property
    def dof(self) -> int:
        """Degrees of freedom of `nis`."""
        return int(self.epoch["dof"])

    @property
    def accepted(self) -> Flags:
        """Which markers' spots were used, (n,)."""
        accepted: Flags = self._accepted
        return accepted

    @property
    def status(self) -> EpochStatus:
        """What became of the epoch."""
        return EpochStatus(int(self.epoch["status"]))

    @property
    def too_late(self) -> bool:
        """The image was older than the window and was not used."""
        return bool(self.epoch["too_late"])

    @property
    def hypotheses(self) -> int:
        """How many poses are still possible: beyond one, the state is that of the most credible alone."""
        return int(self.epoch["hypotheses"])

    @property
    def ambiguity(self) -> float:
        """Twice the log of the odds of that one against the next; infinite if there is no other.

        Below 18.4 (odds of ten thousand, as in `PoseMeasurement`) do not rely on the attitude.
        """
        return float(self.epoch["ambiguity"])

    @property
    def observable(self) -> bool:
        """False while the markers used within the model's limit are fewer than three, or stand on one line.

        A turn about it is then hardly seen, and the covariance may be too small.
        """
        return bool(self.epoch["observable"])

    def __repr__(self) -> str:
        """One line for the console."""
        if self.hypotheses == 0:
            return f"PoseRecord(t_s={self.t_s:.12g}, {self.status.name})"
        x, y, z = self.state[:3]
        return f"PoseRecord(t_s={self.t_s:.12g}, {self.status.name}, position {x:.4f}, {y:.4f}, {z:.4f} m)"


@dataclass(frozen=True)
class PoseSolution:
    """Estimates over the n epochs of a log, NaN while there was none; arrays are worked out when asked for.

    Attributes
    ----------
    mission : VisionMission
        What made it.
    epochs : (n,)
        Records of type `EPOCH`.
    smoothed : bool
        Whether states rest on the images after them too; NIS and what follows it is the filter's either way.
    metadata : dict
        What else a reader should know.
    """

    mission: VisionMission
    epochs: Any
    smoothed: bool = False
    metadata: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        """Epochs."""
        return len(self.epochs)

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.mission.name

    def part(self, begin: int, end: int) -> "PoseSolution":
        """Epochs begin .. end - 1 as a solution of their own (views, not copies)."""
        return replace(self, epochs=self.epochs[begin:end])

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
        return compose(unpacked(self.epochs["factor"]))

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
        """Infinite where one pose is left; below 18.4 do not rely on the attitude, (n,)."""
        return np.asarray(self.epochs["ambiguity"])

    @property
    def observable(self) -> Flags:
        """As in `PoseRecord`, (n,)."""
        flags: Flags = self.epochs["observable"] > 0
        return flags

    @property
    def too_late(self) -> Flags:
        """As in `PoseRecord`, (n,)."""
        flags: Flags = self.epochs["too_late"] > 0
        return flags

    @property
    def refused(self) -> Flags:
        """Epochs with a spot rejected, (n,)."""
        refused: Flags = np.isin(self.status, (int(EpochStatus.PARTIAL), int(EpochStatus.REJECTED)))
        return refused

    def nis_consistency(self, probability: float = 0.95) -> Consistency:
        """NIS of the epochs that were used whole; rejected ones are counted, not averaged in."""
        whole = (self.dof > 0) & ~self.refused
        return nis_consistency(self.nis[whole], self.dof[whole], probability)
