"""The approach to the port: places with the covariance of each, and where a run ends within the port's capture limits.

Axes are the docking frame's, x out of the port. A place is the camera's from the beacons' origin O, or port from port.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.geometry.rotation import quaternion_from_dcm
from relnav.mission import VisionMission

_UPPER = np.triu_indices(3)
STATE_COVARIANCE = tuple(f"cov_{'xyz'[i]}_{'xyz'[j]}" for i, j in zip(*_UPPER, strict=True))
PORT_COVARIANCE = tuple(f"cov_port_{'xyz'[i]}_{'xyz'[j]}" for i, j in zip(*_UPPER, strict=True))
"""Columns of a track, upper triangles by rows: of the state in `lvlh_ccsds`, and of port from port in target axes."""
MISALIGNMENT, MISALIGNMENT_3_SIGMA = "misalignment_deg", "misalignment_3_sigma_deg"
_POLAR = ("range_m", "azimuth_deg", "elevation_deg")
_PORT = ("port_x_m", "port_y_m", "port_z_m")
_TURN = tuple(f"q_target_from_chaser_{axis}" for axis in "xyzw")
_TURN_SIGMA = tuple(f"sigma_port_turn_{axis}_deg" for axis in "xyz")


@dataclass(frozen=True)
class Place:
    """Where the chaser was at one epoch.

    Attributes
    ----------
    t_s : float
    position_m, covariance_m2 : (3,), (3, 3)
        In docking axes.
    correlated : bool
        Whether all of the covariance is known, and not the sigmas alone.
    misalignment_deg, misalignment_3_sigma_deg : float
        As the columns of that name; NaN where the run has no attitude.
    """

    t_s: float
    position_m: Vector
    covariance_m2: Matrix
    correlated: bool
    misalignment_deg: float = math.nan
    misalignment_3_sigma_deg: float = math.nan

    def axes_m(self) -> Matrix:
        """Semi-axes of the 3-sigma ellipsoid as columns (3, 3), the shortest first: eigenvectors, m."""
        variance, directions = np.linalg.eigh(self.covariance_m2)
        axes: Matrix = directions * (3.0 * np.sqrt(np.maximum(variance, 0.0)))
        return axes


@dataclass(frozen=True)
class CaptureLimits:
    """What a port captures, 0 where there is no limit.

    Attributes
    ----------
    lateral_m : float
        Farthest from the port's axis.
    distance_m : float
        Farthest along it.
    angle_deg : float
        Largest misalignment.
    """

    lateral_m: float = 0.0
    distance_m: float = 0.0
    angle_deg: float = 0.0


@dataclass(frozen=True)
class Verdict:
    """One quantity at the end of a run, its largest within 3 sigma, and its limit."""

    quantity: str
    unit: str
    estimate: float
    largest: float
    limit: float

    @property
    def inside(self) -> bool:
        """Whether estimate and 3 sigma lie inside."""
        return self.largest <= self.limit

    @property
    def words(self) -> str:
        """In words."""
        if self.inside:
            return "inside, and so are its 3 sigma"
        return "inside, but its 3 sigma reach beyond" if self.estimate <= self.limit else "outside"


def verdicts(place: Place, limits: CaptureLimits) -> list[Verdict]:
    """The end of a run beside each limit that there is, and that it can be held against."""
    x, lateral, axes = abs(place.position_m[0]), place.position_m[1:], place.axes_m()
    across = _farthest(lateral, axes[1:])
    along = x + float(np.linalg.norm(axes[0]))
    rows = [
        Verdict("lateral misalignment", "m", float(np.linalg.norm(lateral)), across, limits.lateral_m),
        Verdict("distance along the port's axis", "m", float(x), along, limits.distance_m),
        Verdict(
            "angular misalignment", "deg", place.misalignment_deg, place.misalignment_3_sigma_deg, limits.angle_deg
        ),
    ]
    return [row for row in rows if row.limit > 0.0 and math.isfinite(row.estimate)]


def _farthest(centre: Vector, axes: Matrix) -> float:
    """Largest norm of centre + axes u, u a unit vector: of an ellipse (2, k), by its support in each direction."""
    angle = np.linspace(0.0, 2.0 * math.pi, 3601)
    towards = np.stack([np.cos(angle), np.sin(angle)])
    return float((centre @ towards + np.linalg.norm(axes.T @ towards, axis=0)).max())


def misalignments(columns: Mapping[str, Any], mission: Any) -> dict[str, Vector]:
    """Angle between the chaser and its docked attitude, deg, and the largest within 3 sigma of all axes together.

    The docked attitude is that with which the model's camera sees the target as expected; empty without a model, and
    where the run has no attitude.
    """
    if not isinstance(mission, VisionMission) or not all(name in columns for name in (*_TURN, *_TURN_SIGMA)):
        return {}
    docked = quaternion_from_dcm(mission.view.dcm_cam_from_target.T @ mission.camera.dcm_cam_from_chaser)
    turn = np.stack([np.asarray(columns[name], dtype=np.float64) for name in _TURN])
    apart = np.linalg.norm(turn - docked[:, None], axis=0), np.linalg.norm(turn + docked[:, None], axis=0)
    angle = np.degrees(4.0 * np.arctan2(np.minimum(*apart), np.maximum(*apart)))
    sigma = np.sqrt(sum(np.asarray(columns[name], dtype=np.float64) ** 2 for name in _TURN_SIGMA))
    return {MISALIGNMENT: angle, MISALIGNMENT_3_SIGMA: np.minimum(angle + 3.0 * sigma, 180.0)}


class Places:
    """Gathers places spread evenly over the epochs, part after part, and the last one."""

    def __init__(self, most: int, mission: Any = None) -> None:
        """Keep at least `most` places of a run that has as many, less than twice as many, and the last."""
        self._most, self._step, self._seen = most, 1, 0
        self._dcm: Matrix | None = getattr(mission, "dcm_dock_from_lvlh", None)
        self._kept: list[Place] = []
        self._last: Place | None = None

    def take(self, columns: Mapping[str, Any]) -> None:
        """Go on with the next epochs as columns of a track."""
        known = _known(columns)
        if not known.size:
            return
        number = self._seen + np.arange(len(known))
        while number[-1] // self._step >= 2 * self._most:
            self._step, self._kept = 2 * self._step, self._kept[::2]
        self._kept += [self._place(columns, k) for k in known[number % self._step == 0]]
        self._last, self._seen = self._place(columns, known[-1]), int(number[-1]) + 1

    def places(self) -> list[Place]:
        """Those gathered, in the order of time; the last is that of the last epoch with a position."""
        if self._last is None:
            return []
        before = self._kept[:-1] if self._kept and self._kept[-1].t_s == self._last.t_s else self._kept
        return [*before, self._last]

    def _place(self, columns: Mapping[str, Any], k: int) -> Place:
        at = {name: float(column[k]) for name, column in columns.items()}
        angles = at.get(MISALIGNMENT, math.nan), at.get(MISALIGNMENT_3_SIGMA, math.nan)
        if _PORT[0] in at:
            position = np.array([at[name] for name in _PORT])
            whole, axes = _symmetric(at, PORT_COVARIANCE), np.diag([at[f"sigma_{name}"] for name in _PORT])
        else:
            position, axes = _from_angles(at)
            whole = _symmetric(at, STATE_COVARIANCE)
            whole = None if whole is None or self._dcm is None else self._dcm @ whole @ self._dcm.T
        return Place(at["t_s"], position, axes @ axes.T if whole is None else whole, whole is not None, *angles)


def _known(columns: Mapping[str, Any]) -> Any:
    """Epochs with a position and its sigmas."""
    names = _PORT if _PORT[0] in columns else _POLAR
    if not all(name in columns and f"sigma_{name}" in columns for name in names):
        return np.empty(0, dtype=np.int64)
    sums = sum(np.asarray(columns[name]) + np.asarray(columns[f"sigma_{name}"]) for name in names)
    return np.flatnonzero(np.isfinite(sums))


def _symmetric(at: Mapping[str, float], names: tuple[str, ...]) -> Matrix | None:
    """The matrix (3, 3) of an upper triangle; None where it is not known."""
    upper = np.array([at.get(name, math.nan) for name in names])
    if not np.isfinite(upper).all():
        return None
    out = np.empty((3, 3))
    out[_UPPER] = out[_UPPER[::-1]] = upper
    return out


def _from_angles(at: Mapping[str, float]) -> tuple[Vector, Matrix]:
    """Place of a range, azimuth and elevation (Cai et al. (1996) eq. (13)), and what one sigma of each does to it."""
    r, azimuth, elevation = at[_POLAR[0]], math.radians(at[_POLAR[1]]), math.radians(at[_POLAR[2]])
    (sa, ca), (se, ce) = ((math.sin(angle), math.cos(angle)) for angle in (azimuth, elevation))
    by = np.array([[ce * ca, -r * ce * sa, -r * se * ca], [ce * sa, r * ce * ca, -r * se * sa], [-se, 0.0, -r * ce]])
    sigma = np.array([at[f"sigma_{name}"] for name in _POLAR]) * np.array([1.0, math.pi / 180.0, math.pi / 180.0])
    return r * np.array([ce * ca, ce * sa, -se]), by * sigma
