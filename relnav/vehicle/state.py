"""The estimates of a vehicle: values that never change once made, so that any of them can be gone back to.

The filters of a navigator, the one that is told and the one that watches it, stand side by side: the first axis of an
array is the filter, and what is done to one is done to all in one compiled call.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.error_state import MOTION
from relnav.estimation.schmidt import reset_into
from relnav.estimation.state_layout import StateLayout
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.spacecraft import Vehicle
from relnav.vehicle.drift_sums import no_sums
from relnav.vehicle.layout import CHASER_ATTITUDE, TARGET_ATTITUDE, TARGET_RATE
from relnav.vehicle.orbit_frame import OrbitFrame

_TARGET, _CHASER = TARGET_ATTITUDE.start, CHASER_ATTITUDE.start
RESET_FROM_RAD = 1e-3
"""Below this correction the covariance is the same about the old and the new attitude to 5e-4 of itself."""


@kernel
def _take_turn(theta: Vector, dcm: Matrix, P: Matrix, at: int, turned: Matrix) -> None:
    """Turn an attitude, in place, by theta (3,), and replace P (n, n) by that about it; turned (3, 3) scratch."""
    turn_by_rotation_vector(dcm, theta, turned)
    for i in range(3):
        for c in range(3):
            dcm[i, c] = turned[i, c]
    if math.sqrt(theta[0] ** 2 + theta[1] ** 2 + theta[2] ** 2) > RESET_FROM_RAD:
        reset_into(P, theta, at)


@kernel
def correct_one(values: Vector, target: Matrix, chaser: Matrix, P: Matrix, correction: Vector, turned: Matrix) -> None:
    """Take a correction (n,) into values (n,), both attitudes (3, 3) and P (n, n), in place; turned (3, 3) scratch."""
    for i in range(len(values)):
        values[i] += correction[i]
    for i in range(3):
        values[_TARGET + i] = values[_CHASER + i] = 0.0
    _take_turn(correction[_TARGET : _TARGET + 3], target, P, _TARGET, turned)
    _take_turn(correction[_CHASER : _CHASER + 3], chaser, P, _CHASER, turned)


@entry
def correct_into(values: Matrix, targets: Stack, chasers: Stack, P: Stack, corrections: Matrix, turned: Matrix) -> None:
    """Take corrections (k, n) into k estimates, in place: as `correct_one`."""
    for f in range(len(values)):
        correct_one(values[f], targets[f], chasers[f], P[f], corrections[f], turned)


class VehicleState(NamedTuple):
    """What one filter makes of an instant, as sensors and ports see it.

    Attributes
    ----------
    t_s : float
    values : (n,)
        Additive values by layout: position, velocity (`lvlh_ccsds` of the stated orbit), rate, bias, lasting errors;
        zero where the error is that of an attitude.
    dcm_lvlh_from_target, dcm_inertial_from_chaser : (3, 3)
    covariance : (n, n)
        Of the errors, truth = estimate and error.
    """

    t_s: float
    values: Vector
    dcm_lvlh_from_target: Matrix
    dcm_inertial_from_chaser: Matrix
    covariance: Matrix


class Lost(NamedTuple):
    """What of the bias is kept while the gyro is lost.

    Attributes
    ----------
    since_s : float
    bias, variance : (k, 3)
        Of each filter when it was lost.
    """

    since_s: float
    bias: Matrix
    variance: Matrix


class Estimates(NamedTuple):
    """What k filters make of an instant.

    Of a covariance the first DRIVING rows are whole, of the others what stands right of the diagonal
    (`estimation.schmidt`).

    Attributes
    ----------
    t_s : float
    values : (k, n)
    dcm_lvlh_from_target, dcm_inertial_from_chaser : (k, 3, 3)
    covariance : (k, n, n)
        These as of `VehicleState`.
    command_m_s2 : (3,)
        To the thrusters, chaser axes.
    lost : Lost or None
        What is known of the gyro while it is lost.
    drift : (n + 1 + m, m)
        Of the filter that watches, for m errors that may drift (`drift_sums`); m is zero without it.
    """

    t_s: float
    values: Matrix
    dcm_lvlh_from_target: Stack
    dcm_inertial_from_chaser: Stack
    covariance: Stack
    command_m_s2: Vector
    lost: Lost | None
    drift: Matrix

    def of(self, filter_: int) -> VehicleState:
        """That of one filter."""
        f = filter_
        attitudes = self.dcm_lvlh_from_target[f], self.dcm_inertial_from_chaser[f]
        right = np.triu(self.covariance[f])
        return VehicleState(self.t_s, self.values[f], *attitudes, right + np.triu(right, 1).T)

    def alone(self, filter_: int) -> "Estimates":
        """That of one filter, as estimates of no other."""
        f, lost = slice(filter_, filter_ + 1), self.lost
        return self._replace(
            values=self.values[f].copy(),
            dcm_lvlh_from_target=self.dcm_lvlh_from_target[f].copy(),
            dcm_inertial_from_chaser=self.dcm_inertial_from_chaser[f].copy(),
            covariance=self.covariance[f].copy(),
            lost=None if lost is None else lost._replace(bias=lost.bias[f], variance=lost.variance[f]),
            drift=no_sums(self.values.shape[1], 0),
        )

    def copied(self) -> "Estimates":
        """The same in arrays of its own, which may be written until it is handed on."""
        return self._replace(
            values=self.values.copy(),
            dcm_lvlh_from_target=self.dcm_lvlh_from_target.copy(),
            dcm_inertial_from_chaser=self.dcm_inertial_from_chaser.copy(),
            covariance=self.covariance.copy(),
            drift=self.drift.copy(),
        )

    def corrected(self, corrections: Matrix) -> "Estimates":
        """The estimates with corrections (k, n) of their errors taken in."""
        new = self.copied()
        attitudes = new.dcm_lvlh_from_target, new.dcm_inertial_from_chaser
        correct_into(new.values, *attitudes, new.covariance, corrections, np.empty((3, 3)))
        return new


def start_state(
    vehicle: Vehicle, layouts: Sequence[StateLayout], frame: OrbitFrame, t_s: float, motion: Vector, drifting: int
) -> Estimates:
    """The estimates at hand-over with this motion (6,): attitudes and rate as held, lasting errors as stated.

    drifting: how many errors are watched for a drift.
    """
    values, filters, target = np.zeros(layouts[0].size), len(layouts), vehicle.target.dcm_target_from_lvlh.T
    values[:MOTION], values[TARGET_RATE] = motion, frame.held_rate(target, t_s)
    dcm = (vehicle.chaser.dcm_chaser_from_lvlh @ frame.dcm_lvlh_from_inertial(t_s)).T
    return Estimates(
        t_s=t_s,
        values=np.stack([values] * filters),
        dcm_lvlh_from_target=np.stack([target] * filters),
        dcm_inertial_from_chaser=np.stack([dcm] * filters),
        covariance=np.stack([layout.prior for layout in layouts]),
        command_m_s2=np.zeros(3),
        lost=None,
        drift=no_sums(layouts[0].size, drifting),
    )
