"""Rows into the estimate: the gate, and Schmidt's update, which never corrects what is only considered.

With the gain K = P H' S^-1, S = H P H' + R, and K_m that gain with the rows of the considered errors struck out,

    P <- P - K_m H P - P H' K_m' + K_m S K_m'

which is Joseph's form multiplied out, right for any gain. While the start is wide the update is iterated: the rows are
taken anew at the corrected state (Bell and Cathey 1993, The iterated Kalman filter update as a Gauss-Newton method).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Flags, Matrix, Vector
from relnav.estimation.gating import gate_limits
from relnav.vehicle.layout import CHASER_ATTITUDE, POSITION, TARGET_ATTITUDE, Layout
from relnav.vehicle.rows import Rows
from relnav.vehicle.state import VehicleState

ITERATIONS = 4
WIDE_SHARE, WIDE_RAD = 0.005, math.radians(0.2)
"""1-sigma of the position by the distance, and of an attitude, above which rows bend within the prior."""


@dataclass(frozen=True)
class Outcome:
    """What became of an observation.

    Attributes
    ----------
    nis, dof : float, int
        Normalised innovation squared of all that was seen, before the gate, and its rows.
    groups, used : int
        Spots (or attitude, or direction) seen, and of them believed.
    gains : (3,)
        What it told, nats: half the logarithm by which the variance ellipsoid of position, target attitude and chaser
        attitude shrank.
    """

    nis: float
    dof: int
    groups: int
    used: int
    gains: tuple[float, float, float]


class Updater:
    """Gate and update of one layout."""

    def __init__(self, layout: Layout, gate_probability: float, most_rows: int) -> None:
        self._considered = np.flatnonzero(layout.considered)
        self._limits = np.concatenate([[0.0], gate_limits(gate_probability, most_rows)])

    def take(self, state: VehicleState, rows_at: Callable[[VehicleState], Rows]) -> tuple[VehicleState, Outcome]:
        """The settled estimate with the rows taken in, as far as they are credible."""
        rows, P = rows_at(state), state.covariance
        PHt = P @ rows.jacobian.T
        S = rows.jacobian @ PHt + rows.noise
        chosen, nis, dof, groups = self._gate(rows, S)
        if not chosen.any():
            return state, Outcome(nis, dof, groups, 0, (0.0, 0.0, 0.0))
        pick, K = self._pick(chosen), self._gain(PHt, S, chosen)
        correction = K @ rows.residual[pick]
        if _is_wide(state):
            for _ in range(ITERATIONS - 1):
                trial = rows_at(state.corrected(correction, P))
                if not np.isfinite(trial.residual[pick]).all():
                    break
                rows = trial
                PHt = P @ rows.jacobian.T
                S = rows.jacobian @ PHt + rows.noise
                K = self._gain(PHt, S, chosen)
                correction = K @ (rows.residual + rows.jacobian @ correction)[pick]
        left = K @ PHt[:, pick].T
        after = P - left - left.T + K @ S[pick][:, pick] @ K.T
        after = 0.5 * (after + after.T)
        gains = (_shrunk(P, after, POSITION), _shrunk(P, after, TARGET_ATTITUDE), _shrunk(P, after, CHASER_ATTITUDE))
        return state.corrected(correction, after), Outcome(nis, dof, groups, int(chosen.sum()) // rows.group, gains)

    @staticmethod
    def _pick(chosen: Flags) -> Flags | slice:
        """An index of the chosen rows, quick where it is all of them."""
        return slice(None) if chosen.all() else chosen

    def _gain(self, PHt: Matrix, S: Matrix, chosen: Flags) -> Matrix:
        pick = self._pick(chosen)
        K: Matrix = np.ascontiguousarray(np.linalg.solve(S[pick][:, pick], PHt[:, pick].T).T, dtype=np.float64)
        K[self._considered] = 0.0
        return K

    def _gate(self, rows: Rows, S: Matrix) -> tuple[Flags, float, int, int]:
        """Rows to believe (m,), and NIS, rows and groups of all that was seen.

        Each group must be credible alone, and those left together; of a set that contradicts itself the group goes
        without which the rest agrees best.
        """
        size = rows.group
        whole = np.isfinite(rows.residual).reshape(-1, size).all(axis=1)
        seen: list[int] = np.flatnonzero(whole).tolist()
        everything = self._nis(rows, S, seen)
        if seen and everything <= self._limits[size]:  # no part of it has more
            return np.repeat(whole, size), everything, size * len(seen), len(seen)
        good = [k for k in seen if self._nis(rows, S, [k]) <= self._limits[size]]
        while good and not self._nis(rows, S, good) <= self._limits[size * len(good)]:
            if len(good) <= 2:
                good = []
                break
            without = [self._nis(rows, S, [k for k in good if k != out]) for out in good]
            del good[int(np.argmin(without))]
        chosen = np.zeros(whole.shape, dtype=bool)
        chosen[good] = True
        return np.repeat(chosen, size), everything, size * len(seen), len(seen)

    @staticmethod
    def _nis(rows: Rows, S: Matrix, groups: list[int]) -> float:
        if not groups:
            return 0.0
        index = (rows.group * np.asarray(groups)[:, None] + np.arange(rows.group)).ravel()
        r: Vector = rows.residual[index]
        return float(r @ np.linalg.solve(S[np.ix_(index, index)], r))


def _is_wide(state: VehicleState) -> bool:
    variance = np.diagonal(state.covariance)
    distance = float(np.linalg.norm(state.values[POSITION]))
    turns = max(variance[TARGET_ATTITUDE].max(), variance[CHASER_ATTITUDE].max())
    return bool(variance[POSITION].max() > (WIDE_SHARE * distance) ** 2 or turns > WIDE_RAD**2)


def _shrunk(before: Matrix, after: Matrix, place: slice) -> float:
    return 0.5 * math.log(max(_volume(before[place, place]) / _volume(after[place, place]), 1e-300))


def _volume(p: Matrix) -> float:
    """Determinant of a covariance (3, 3)."""
    (a, b, c), (_, d, e), (_, _, f) = p.tolist()
    return float(a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d))
