"""A whole log of marker spots through the pose navigator: one record an epoch, gathered in arrays."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.estimation.consistency import Consistency, nis_consistency
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.mission import VisionMission
from relnav.navigation.relative_pose import PoseNavigator, PoseRecord
from relnav.navigation.status import EpochStatus


@dataclass(frozen=True)
class PoseSolution:
    """Estimates over the epochs of a log, NaN while there was none.

    Attributes
    ----------
    t_s : (n,)
    state : (n, 6)
        Chaser's centre of mass from the target's, `lvlh_ccsds`.
    dcm_lvlh_from_target, rate_rad_s : (n, 3, 3), (n, 3)
    covariance : (n, 12, 12)
        Of (position, velocity, theta, rate), as in `PoseRecord`.
    port_m, port_velocity_m_s : (n, 3)
        Port from port, target axes.
    dcm_target_from_chaser, relative_rate_rad_s : (n, 3, 3), (n, 3)
    docking_covariance : (n, 12, 12)
    nis, dof : (n,)
    used : (n,)
        Spots used.
    status, hypotheses : (n,)
    ambiguity : (n,)
        Infinite where one pose is left; below 18.4 do not rely on the attitude, as in `PoseRecord`.
    observable, too_late : (n,)
    smoothed : bool
        Whether states rest on the images after them too; NIS and what follows it is the filter's either way.
    """

    model: str
    t_s: Vector
    state: Matrix
    dcm_lvlh_from_target: Stack
    rate_rad_s: Matrix
    covariance: Stack
    port_m: Matrix
    port_velocity_m_s: Matrix
    dcm_target_from_chaser: Stack
    relative_rate_rad_s: Matrix
    docking_covariance: Stack
    nis: Vector
    dof: Codes
    used: Codes
    status: Codes
    hypotheses: Codes
    ambiguity: Vector
    observable: Flags
    too_late: Flags
    smoothed: bool = False

    def __len__(self) -> int:
        """Epochs."""
        return len(self.t_s)

    @property
    def refused(self) -> Flags:
        """Epochs with a spot rejected, (n,)."""
        refused: Flags = np.isin(self.status, (int(EpochStatus.PARTIAL), int(EpochStatus.REJECTED)))
        return refused

    def nis_consistency(self, probability: float = 0.95) -> Consistency:
        """NIS of the epochs that were used whole; rejected ones are counted, not averaged in."""
        whole = (self.dof > 0) & ~self.refused
        return nis_consistency(self.nis[whole], self.dof[whole], probability)


def joined(parts: Iterable[PoseSolution]) -> PoseSolution:
    """Consecutive parts of a log as one."""
    whole = list(parts)
    names = [entry.name for entry in fields(PoseSolution) if entry.name not in ("model", "smoothed")]
    arrays: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in whole]) for name in names}
    return PoseSolution(whole[0].model, **arrays, smoothed=whole[0].smoothed)


def filter_marker_epochs(
    mission: VisionMission,
    t_s: Vector,
    spots_px: Stack,
    *,
    image_t_s: Vector | None = None,
    acceleration_m_s2: Matrix | None = None,
    delta_v_m_s: Matrix | None = None,
    q_chaser_from_lvlh: Matrix | None = None,
    navigator: PoseNavigator | None = None,
) -> PoseSolution:
    """Filter epochs t_s (n,) with spots (n, markers, 2) px and, where known, exposure times, control and attitude.

    navigator: one that has worked through the log so far, to go on with.

    Raises
    ------
    ValueError
        As `PoseNavigator.step`.
    """
    nav, records = navigator or PoseNavigator(mission), []
    for k in range(len(t_s)):
        attitude = None if q_chaser_from_lvlh is None else dcm_from_quaternion(q_chaser_from_lvlh[k])
        records.append(
            nav.step(
                float(t_s[k]),
                spots_px[k],
                image_t_s=None if image_t_s is None else float(image_t_s[k]),
                acceleration_m_s2=None if acceleration_m_s2 is None else acceleration_m_s2[k],
                delta_v_m_s=None if delta_v_m_s is None else delta_v_m_s[k],
                dcm_chaser_from_lvlh=attitude,
            )
        )
    return _gathered(mission, records)


def _gathered(mission: VisionMission, records: list[PoseRecord]) -> PoseSolution:
    nothing = {"position_m": (3,), "velocity_m_s": (3,), "dcm_target_from_chaser": (3, 3), "rate_rad_s": (3,)}
    shapes = nothing | {"covariance": (12, 12)}

    def docking(name: str) -> Matrix:
        empty = np.full(shapes[name], np.nan)
        return np.array([empty if r.docking is None else getattr(r.docking, name) for r in records])

    def of(name: str) -> Matrix:
        return np.array([getattr(r, name) for r in records])

    return PoseSolution(
        mission.name,
        of("t_s"),
        of("state"),
        of("dcm_lvlh_from_target"),
        of("rate_rad_s"),
        of("covariance"),
        docking("position_m"),
        docking("velocity_m_s"),
        docking("dcm_target_from_chaser"),
        docking("rate_rad_s"),
        docking("covariance"),
        of("nis"),
        np.array([r.dof for r in records], dtype=np.int64),
        np.array([int(r.accepted.sum()) for r in records], dtype=np.int64),
        np.array([int(r.status) for r in records], dtype=np.int64),
        np.array([r.hypotheses for r in records], dtype=np.int64),
        of("ambiguity"),
        np.array([r.observable for r in records], dtype=bool),
        np.array([r.too_late for r in records], dtype=bool),
    )
