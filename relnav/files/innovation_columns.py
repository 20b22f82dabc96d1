"""Innovations of a track as columns, in units of a reader, with the gate of each beside them."""

import math

import numpy as np

from relnav.arrays import Vector
from relnav.estimation.gating import chi_square_limit
from relnav.files.log_columns import LETTERS
from relnav.mission import Model, VisionMission
from relnav.navigation.innovation_gates import innovation_covariances
from relnav.navigation.pose_innovations import MarkerInnovations
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.record import Solution
from relnav.navigation.status import PARTIAL, REJECTED, STARTED, UPDATED

GATES_A_PART = 300
"""Epochs of a part at which the gate is worked out; between them it is a straight line."""
DEGREES = 180.0 / math.pi
FIX_COLUMNS = (("innovation_range_m", 1.0), ("innovation_azimuth_deg", DEGREES), ("innovation_elevation_deg", DEGREES))


def unsaid(part: Solution | PoseSolution) -> str:
    """Why innovations or gates of a solution may be missing, for a reader.

    A smoothed state, or one that a later image has changed, is not what its image was compared with.
    """
    if part.smoothed:
        return "the track is smoothed, and its states are not those that images were compared with: leave --smooth out"
    if isinstance(part, PoseSolution):
        late = part.spots_px is None
        return "images came late, and changed what they were compared with" if late else "tolerances are considered"
    return "lasting errors are considered" if part.metadata.get("considered", "") else "the attitude is the log's"


class Innovations:
    """Columns of the innovations of consecutive parts of one solution of beacons.

    The gate of a number is the half width of the ellipsoid of its group: sqrt(chi-square limit) sigma. A group is
    believed only inside the ellipsoid; so what lies outside a gate was refused, what lies inside may have been.
    """

    def __init__(self, solution: Solution, model: Model | None) -> None:
        self._fix, self._model = solution.method == "fix", model
        beacons = LETTERS[: solution.innovation.shape[1] // 2]
        spots = tuple((f"innovation_{beacon}_{axis}_um", 1e6) for beacon in beacons for axis in "xy")
        self._names: tuple[tuple[str, float], ...] = FIX_COLUMNS if self._fix else spots
        group = 3 if self._fix else 2
        self._limit = math.nan if model is None else chi_square_limit(model.filter.gate_probability, group) ** 0.5

    def names(self) -> tuple[str, ...]:
        """Names of the columns; `gate_` and the same is the gate's."""
        return tuple(name for name, _ in self._names)

    def columns(self, part: Solution) -> dict[str, Vector]:
        """Columns of the next epochs."""
        seen = np.isin(part.status, (UPDATED, PARTIAL, REJECTED, STARTED))
        if self._fix:
            seen &= part.dof == 3  # two beacons without an attitude give one number, which is none of these
        out = {}
        sigmas = self._sigmas(part)
        for k, (name, scale) in enumerate(self._names):
            out[name] = np.where(seen, part.innovation[:, k] * scale, math.nan)
            out[f"gate_{name}"] = sigmas[k] * self._limit * scale
        return out

    def _sigmas(self, part: Solution) -> list[Vector]:
        """1-sigma of each number before the update, (n,) each, in SI; NaN where it cannot be told."""
        n = len(part)
        nothing = [np.full(n, math.nan) for _ in self._names]
        used = np.flatnonzero(np.isin(part.status, (UPDATED, REJECTED)))
        if self._model is None or not used.size:
            return nothing
        early = used[: GATES_A_PART // 3]  # the gate narrows fast after a start
        spread = used[np.linspace(0, used.size - 1, min(used.size, GATES_A_PART)).astype(np.int64)]
        at = np.unique(np.concatenate([early, spread]))
        found = innovation_covariances(self._model, part, at)
        known = [k for k, s in enumerate(found) if len(s)]
        if not known:
            return nothing
        sigma = np.sqrt(np.stack([np.diagonal(found[k]) for k in known]))
        t = part.t_s[at[known]]
        return [np.interp(part.t_s, t, sigma[:, k], left=math.nan, right=math.nan) for k in range(len(self._names))]


class SpotInnovations:
    """The same of markers: `MarkerInnovations` as columns."""

    def __init__(self, mission: VisionMission) -> None:
        """Begin before the first epoch."""
        self._found = MarkerInnovations(mission)
        self._names = tuple(
            f"innovation_{marker}_{axis}_px" for marker in LETTERS[: len(mission.markers.positions_m)] for axis in "xy"
        )
        self._limit = chi_square_limit(mission.filter.gate_probability, 2) ** 0.5
        self._told = False

    def names(self) -> tuple[str, ...]:
        """Names of the columns; `gate_` and the same is the gate's. None where nothing could be told."""
        return self._names if self._told else ()

    def columns(self, part: PoseSolution) -> dict[str, Vector]:
        """Columns of the next epochs."""
        innovation, sigma = (values.reshape(len(part), -1).T for values in self._found.of(part))
        self._told = self._told or bool(np.isfinite(innovation).any())
        gates = {f"gate_{name}": self._limit * row for name, row in zip(self._names, sigma, strict=True)}
        return dict(zip(self._names, innovation, strict=True)) | gates
