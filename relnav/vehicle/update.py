"""Rows into the estimates: the gate and the update of `estimation.schmidt`, iterated while the start is wide."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.estimation.gating import gate_limits
from relnav.estimation.information import information_gained, squared_volume
from relnav.estimation.schmidt import copy_into, gate_rows, take_chosen, take_gated
from relnav.estimation.state_layout import StateLayout
from relnav.vehicle.drift_sums import take_drifts
from relnav.vehicle.layout import CHASER_ATTITUDE, DRIVING, POSITION, TARGET_ATTITUDE
from relnav.vehicle.reset import refer_rows_into, reset_scratch
from relnav.vehicle.rows import Rows
from relnav.vehicle.state import Estimates, correct_into, correct_one

ITERATIONS = 4
WIDE_SHARE, WIDE_RAD = 0.005, math.radians(0.2)
"""1-sigma of the position by the distance, and of an attitude, above which rows bend within the prior."""

_POSITION, _TARGET, _CHASER = POSITION.start, TARGET_ATTITUDE.start, CHASER_ATTITUDE.start
_NIS, _DOF, _SEEN, _USED, _CREDIBLE, _WIDE, _GAINS, _TOLD = 0, 1, 2, 3, 4, 5, 6, 9
"""What is told of a filter's update, in the order of `Outcome`: columns, and how many."""


@kernel
def is_wide(P: Matrix, values: Vector) -> bool:
    """Whether rows bend within what is known of the state: values (n,), P (n, n)."""
    x, y, z = values[_POSITION], values[_POSITION + 1], values[_POSITION + 2]
    place, turn = 0.0, 0.0
    for i in range(3):
        place = max(place, P[_POSITION + i, _POSITION + i])
        turn = max(turn, P[_TARGET + i, _TARGET + i], P[_CHASER + i, _CHASER + i])
    return place > WIDE_SHARE * WIDE_SHARE * (x * x + y * y + z * z) or turn > WIDE_RAD * WIDE_RAD


@kernel
def _volumes_into(P: Matrix, out: Vector) -> None:
    """Write the squared volumes of the variance ellipsoids of position, target attitude and chaser attitude, (3,)."""
    out[0], out[1], out[2] = squared_volume(P, _POSITION), squared_volume(P, _TARGET), squared_volume(P, _CHASER)


@kernel
def _gains_into(volumes: Vector, P: Matrix) -> None:
    """Replace volumes (3,) before an update by what they shrank to with P (n, n), nats."""
    volumes[0] = information_gained(volumes[0], squared_volume(P, _POSITION))
    volumes[1] = information_gained(volumes[1], squared_volume(P, _TARGET))
    volumes[2] = information_gained(volumes[2], squared_volume(P, _CHASER))


@entry
def take_into(
    values: Matrix,
    targets: Stack,
    chasers: Stack,
    P: Stack,
    considered: Flags,
    residual: Matrix,
    H: Stack,
    R: Stack,
    size: int,
    limits: Vector,
    chosen: Codes,
    corrections: Matrix,
    prior: Stack,
    told: Matrix,
    frame: Matrix,
    lights: Codes,
    pivot: Matrix,
    scratch: Record,
    work: Matrix,
    places: Codes,
    watched: int,
    drift: Matrix,
    drift_rows: Matrix,
) -> bool:
    """Gate the rows of k filters and take in, in place, what is credible; whether an estimate is left to be iterated.

    Estimates as in `Estimates`; considered (k, n); rows (k, m), (k, m, n), (k, m, m) and the rest as for
    `schmidt.gate_rows`; chosen (k, m or more). Writes told (k, _TOLD). A wide estimate is not corrected: P before goes
    into prior (k, n, n), the correction into corrections (k, n). watched: the filter whose drifts are looked for, with
    sums and scratch as of `drift_sums.take_drifts`; -1 for none.
    """
    m, again = residual.shape[1], False
    for f in range(len(values)):
        believed, gains = chosen[f, :m], told[f, _GAINS : _GAINS + 3]
        wide = is_wide(P[f], values[f])
        nis, seen, used = gate_rows(P[f], residual[f], H[f], R[f], size, limits, DRIVING, believed, work, places)
        told[f, _NIS], told[f, _DOF], told[f, _CREDIBLE] = nis, size * seen, limits[size * seen]
        told[f, _SEEN], told[f, _USED], told[f, _WIDE] = seen, used, 1.0 if wide else 0.0
        gains[0] = gains[1] = gains[2] = 0.0
        if used == 0:
            for c in range(corrections.shape[1]):
                corrections[f, c] = 0.0
            continue
        if wide:
            copy_into(P[f], prior[f])
            again = True
        _volumes_into(P[f], gains)
        take_gated(P[f], considered[f], DRIVING, believed, work, places, corrections[f])
        if f == watched:
            take_drifts(H[f], believed, work, places, wide, drift, drift_rows)
        _gains_into(gains, P[f])
        if not wide:
            correct_one(values[f], targets[f], chasers[f], P[f], corrections[f], frame, lights, pivot[f], scratch[0])
    return again


@entry
def take_again(
    prior: Stack,
    considered: Flags,
    residual: Matrix,
    H: Stack,
    R: Stack,
    chosen: Codes,
    P: Stack,
    corrections: Matrix,
    told: Matrix,
    again: Flags,
    work: Matrix,
    places: Codes,
) -> None:
    """Take rows in once more, linearised at the corrected estimates: of those filters that go on again (k,).

    The others as `take_into` has them. One that fails is as it was, and does not go on.
    """
    m = residual.shape[1]
    for f in range(len(again)):
        if not again[f]:
            continue
        gains, believed = told[f, _GAINS : _GAINS + 3], chosen[f, :m]
        rows, correction = (residual[f], H[f], R[f]), corrections[f]
        again[f] = take_chosen(prior[f], considered[f], *rows, DRIVING, believed, P[f], correction, work, places)
        _volumes_into(prior[f], gains)
        _gains_into(gains, P[f])


class Outcome(NamedTuple):
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
    """Gate and update of filters of the same errors, each with its own roles."""

    def __init__(
        self, layouts: Sequence[StateLayout], gate_probability: float, most_rows: int, watched: int, drifting: int
    ) -> None:
        """Of these errors; watched: the filter whose drifting errors, so many, are looked for, -1 for none."""
        filters, n = len(layouts), layouts[0].size
        self._considered = np.stack([layout.considered for layout in layouts])
        self._limits = np.concatenate([[0.0], gate_limits(gate_probability, most_rows)])
        self._chosen = np.zeros((filters, most_rows), dtype=np.int64)
        self._prior, self._corrections = np.empty((filters, n, n)), np.empty((filters, n))
        self._told, self._reset = np.empty((filters, _TOLD)), reset_scratch(n)
        self._watched, self._drift_rows = watched, np.empty((most_rows, drifting))
        self._scratch = np.empty((4 * most_rows + 3, max(n, most_rows))), np.empty(max(n, most_rows), dtype=np.int64)

    def take(self, at: Estimates, rows_at: Callable[[Estimates], Rows]) -> list[Outcome]:
        """Take rows into estimates, in place, as far as they are credible; what became of them in each filter."""
        rows, corrections, told = rows_at(at), self._corrections, self._told
        numbers = at.values, at.dcm_lvlh_from_target, at.dcm_inertial_from_chaser, at.covariance
        again = take_into(
            *numbers,
            self._considered,
            rows.residual,
            rows.jacobian,
            rows.noise,
            rows.group,
            self._limits,
            self._chosen,
            corrections,
            self._prior,
            told,
            at.frame,
            at.lights,
            at.pivot,
            self._reset,
            *self._scratch,
            self._watched,
            at.drift,
            self._drift_rows,
        )
        if again:
            self._iterate(at, rows_at)
        return [
            Outcome(nis, int(dof), int(seen), int(used), credible, wide > 0.0, (place, target, chaser))
            for nis, dof, seen, used, credible, wide, place, target, chaser in told.tolist()
        ]

    def _iterate(self, at: Estimates, rows_at: Callable[[Estimates], Rows]) -> None:
        """Go on with estimates that are wide, and correct them."""
        prior, corrections, told = self._prior, self._corrections, self._told
        again = (told[:, _USED] > 0.0) & (told[:, _WIDE] > 0.0)
        corrections[~again] = 0.0  # taken in already
        before = at._replace(covariance=np.where(again[:, None, None], prior, at.covariance))
        for _ in range(ITERATIONS - 1):
            there = before.corrected(corrections)
            rows = rows_at(there)
            refer_rows_into(
                rows.jacobian,
                corrections,
                before.values,
                before.dcm_lvlh_from_target,
                before.dcm_inertial_from_chaser,
                there.dcm_lvlh_from_target,
                there.dcm_inertial_from_chaser,
                at.frame,
                at.lights,
                at.pivot,
                self._reset,
            )
            given = rows.residual, rows.jacobian, rows.noise
            take_again(
                prior, self._considered, *given, self._chosen, at.covariance, corrections, told, again, *self._scratch
            )
        numbers = at.values, at.dcm_lvlh_from_target, at.dcm_inertial_from_chaser, at.covariance
        correct_into(*numbers, corrections, at.frame, at.lights, at.pivot, self._reset)
