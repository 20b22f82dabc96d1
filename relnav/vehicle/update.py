"""Rows into the estimate: the gate and the update of `estimation.schmidt`, iterated while the start is wide."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry
from relnav.estimation.gating import gate_limits
from relnav.estimation.schmidt import information_gained, take_chosen, take_rows
from relnav.vehicle.layout import CHASER_ATTITUDE, POSITION, TARGET_ATTITUDE, Layout
from relnav.vehicle.rows import Rows
from relnav.vehicle.state import VehicleState

ITERATIONS = 4
WIDE_SHARE, WIDE_RAD = 0.005, math.radians(0.2)
"""1-sigma of the position by the distance, and of an attitude, above which rows bend within the prior."""

_POSITION, _TARGET, _CHASER = POSITION.start, TARGET_ATTITUDE.start, CHASER_ATTITUDE.start


@entry
def is_wide(P: Matrix, values: Vector) -> bool:
    """Whether rows bend within what is known of the state: values (n,), P (n, n)."""
    x, y, z = values[_POSITION], values[_POSITION + 1], values[_POSITION + 2]
    place, turn = 0.0, 0.0
    for i in range(3):
        place = max(place, P[_POSITION + i, _POSITION + i])
        turn = max(turn, P[_TARGET + i, _TARGET + i], P[_CHASER + i, _CHASER + i])
    return place > WIDE_SHARE * WIDE_SHARE * (x * x + y * y + z * z) or turn > WIDE_RAD * WIDE_RAD


@entry
def gains_of(before: Matrix, after: Matrix) -> tuple[float, float, float]:
    """`Outcome.gains` of covariances (n, n) before and after an update."""
    return (
        information_gained(before, after, _POSITION),
        information_gained(before, after, _TARGET),
        information_gained(before, after, _CHASER),
    )


@dataclass(frozen=True)
class Outcome:
    """What became of an observation.

    Attributes
    ----------
    nis, dof : float, int
        Normalised innovation squared of all that was seen, before the gate, and its rows.
    groups, used : int
        Spots (or attitude, or direction) seen, and of them believed.
    largest_credible : float
        NIS that so many rows have with the gate's probability.
    wide : bool
        Whether rows bent within what was known before it.
    gains : (3,)
        What it told, nats: half the logarithm by which the variance ellipsoid of position, target attitude and chaser
        attitude shrank.
    """

    nis: float
    dof: int
    groups: int
    used: int
    largest_credible: float = math.inf
    wide: bool = False
    gains: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Updater:
    """Gate and update of one layout."""

    def __init__(self, layout: Layout, gate_probability: float, most_rows: int) -> None:
        self._considered, self._most_rows, n = layout.considered, most_rows, layout.size
        self._limits = np.concatenate([[0.0], gate_limits(gate_probability, most_rows)])
        self._chosen, self._work = np.zeros(most_rows, dtype=np.int64), np.empty((3 * most_rows + 2, max(n, most_rows)))

    def take(self, state: VehicleState, rows_at: Callable[[VehicleState], Rows]) -> tuple[VehicleState, Outcome]:
        """The settled estimate with the rows taken in, as far as they are credible."""
        rows, P = rows_at(state), state.covariance
        after, correction, chosen = np.empty_like(P), np.empty(len(P)), self._chosen[: len(rows.residual)]
        given = rows.residual, rows.jacobian, rows.noise
        limits, work = self._limits, self._work
        nis, seen, used = take_rows(P, self._considered, *given, rows.group, limits, chosen, after, correction, work)
        dof, wide = rows.group * seen, is_wide(P, state.values)
        outcome = Outcome(nis, dof, seen, used, float(limits[dof]), wide)
        if used == 0:
            return state, outcome
        if wide:
            for _ in range(ITERATIONS - 1):
                rows = rows_at(state.corrected(correction, P))
                again = rows.residual, rows.jacobian, rows.noise
                if not take_chosen(P, self._considered, *again, chosen, correction.copy(), after, correction, work):
                    break
        return state.corrected(correction, after), replace(outcome, gains=gains_of(P, after))
