"""The estimates of a vehicle: values that never change once made, so that any of them can be gone back to.

The filters of a navigator, the one that is told and the one that watches it, stand side by side: the first axis of an
array is the filter, and what is done to one is done to all in one compiled call.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from relnav.arrays import Codes, Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.error_state import MOTION
from relnav.estimation.state_layout import StateLayout
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.vehicle.drift_sums import no_sums
from relnav.vehicle.hand_over import Start
from relnav.vehicle.layout import CHASER_ATTITUDE, POSITION, TARGET_ATTITUDE, TARGET_RATE, VELOCITY, lights_of
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.pivot import (
    change_about_lights,
    lever_into,
    mean_place_into,
    move_about_lights,
    no_pivot,
    refer_about_lights,
)
from relnav.vehicle.reset import change_into, is_felt, is_pivot_felt, refer_into, reset_scratch
from relnav.vehicle.retraction import bends, correction_into, find_turn, turned_into

_TARGET, _CHASER = TARGET_ATTITUDE.start, CHASER_ATTITUDE.start


@kernel
def correct_one(
    values: Vector,
    target: Matrix,
    chaser: Matrix,
    P: Matrix,
    correction: Vector,
    frame: Matrix,
    lights: Codes,
    pivot: Vector,
    scratch: Record,
) -> None:
    """Take a correction (n,) into values (n,), both attitudes (3, 3) and P (n, n), in place.

    frame (3, 3): dcm_lvlh_from_inertial; lights (l,): where the errors of each begin; pivot (3 + l,), of those seen
    before; scratch of `reset_scratch`.
    """
    new, moved = scratch["attitudes"], scratch["moved"]
    turn_by_rotation_vector(target, correction[_TARGET : _TARGET + 3], new[0])
    turn_by_rotation_vector(chaser, correction[_CHASER : _CHASER + 3], new[1])
    angle2 = find_turn(correction, values, chaser, frame, scratch)
    turned = bends(P, values, angle2, chaser, frame, scratch)
    if turned:
        turned_into(correction, values, scratch)
    else:
        for i in range(len(values)):
            moved[i] = correction[i]
        for i in range(3):
            scratch["phi"][i] = 0.0
            for c in range(3):
                scratch["turn"][i, c] = scratch["unit"][i, c]
    mean_place_into(values, lights, pivot, scratch["middle"])
    about_lights = is_pivot_felt(P, correction, values, target, chaser, frame, scratch)
    if about_lights:
        lever_into(correction, target, new[0], scratch)
        move_about_lights(correction, lights, pivot, scratch, moved)
    if turned or about_lights or is_felt(P, moved, values, chaser, frame, lights, scratch):
        change_into(moved, turned, target, chaser, new[0], new[1], frame, lights, scratch)
        if about_lights:
            change_about_lights(scratch)
            refer_about_lights(P, lights, pivot, scratch)
        refer_into(P, turned, scratch)
    if turned:
        for i in range(MOTION):
            values[i] = scratch["path"][i]
    for i in range(len(values)):
        values[i] += moved[i]
    for i in range(3):
        values[_TARGET + i] = values[_CHASER + i] = 0.0
        for c in range(3):
            target[i, c], chaser[i, c] = new[0, i, c], new[1, i, c]


@entry
def correct_into(
    values: Matrix,
    targets: Stack,
    chasers: Stack,
    P: Stack,
    corrections: Matrix,
    frame: Matrix,
    lights: Codes,
    pivot: Matrix,
    scratch: Record,
) -> None:
    """Take corrections (k, n) into k estimates, in place: as `correct_one`."""
    for f in range(len(values)):
        correct_one(values[f], targets[f], chasers[f], P[f], corrections[f], frame, lights, pivot[f], scratch[0])


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
    """A gyro that is lost, and what of its bias is kept while the held rate is learnt in its place.

    Attributes
    ----------
    since_s, held_s : float
        When it was lost, and from when the sample is that is held; that is -inf if there is none.
    bias, variance : (k, 3) or None
        Of each filter when that began; None before.
    """

    since_s: float
    held_s: float
    bias: Matrix | None = None
    variance: Matrix | None = None

    @property
    def is_learnt(self) -> bool:
        """Whether the held rate is learnt."""
        return self.bias is not None

    def alone(self, f: slice) -> "Lost":
        """That of some filters."""
        if self.bias is None or self.variance is None:
            return self
        return self._replace(bias=self.bias[f], variance=self.variance[f])


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
    frame : (3, 3)
        dcm_lvlh_from_inertial at t_s.
    lights : (l,)
        Where in the layout the three errors of each light begin.
    pivot : (k, 3 + l)
        The lights of the last image that was believed, about which corrections turn the target (`pivot`).
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
    frame: Matrix
    lights: Codes
    pivot: Matrix
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
            pivot=self.pivot[f].copy(),
            lost=None if lost is None else lost.alone(f),
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

    def correction_from(self, values: Vector, dcm_lvlh_from_target: Matrix, dcm_inertial_from_chaser: Matrix) -> Vector:
        """The correction (n,) that leads from another estimate, (n,) and (3, 3) twice, to the one estimate."""
        return self._led_from(values, dcm_lvlh_from_target, dcm_inertial_from_chaser)[0]

    def _led_from(self, values: Vector, target: Matrix, chaser: Matrix) -> tuple[Vector, Record]:
        """That correction, and scratch with the turn of the path in it."""
        out, scratch = np.empty_like(values), reset_scratch(len(values))[0]
        new = self.values[0], self.dcm_lvlh_from_target[0], self.dcm_inertial_from_chaser[0]
        correction_into(values, target, chaser, *new, self.frame, self.lights, self.pivot[0], scratch, out)
        return out, scratch

    def referred(self, values: Vector, dcm_lvlh_from_target: Matrix, dcm_inertial_from_chaser: Matrix) -> "Estimates":
        """The one estimate with the covariance of its errors about another one, (n,) and (3, 3) twice (`reset`)."""
        new, other = self.copied(), (dcm_lvlh_from_target, dcm_inertial_from_chaser)
        _, scratch = self._led_from(values, *other)
        back = scratch["turn"].T.copy()  # from here to there
        scratch["turn"], own = back, self.values[0]
        scratch["path"] = np.concatenate([back @ own[POSITION], back @ own[VELOCITY]])
        scratch["moved"] = values - own
        scratch["moved"][:MOTION] = values[:MOTION] - scratch["path"]
        here = self.dcm_lvlh_from_target[0], self.dcm_inertial_from_chaser[0]
        mean_place_into(own, self.lights, self.pivot[0], scratch["middle"])
        scratch["lever"] = other[0] - back @ here[0]
        change_into(scratch["moved"], True, *here, *other, self.frame, self.lights, scratch)
        change_about_lights(scratch)
        refer_about_lights(new.covariance[0], self.lights, self.pivot[0], scratch)
        refer_into(new.covariance[0], True, scratch)
        return new

    def corrected(self, corrections: Matrix) -> "Estimates":
        """The estimates with corrections (k, n) of their errors taken in."""
        new = self.copied()
        attitudes = new.dcm_lvlh_from_target, new.dcm_inertial_from_chaser
        scratch = reset_scratch(new.values.shape[1])
        correct_into(new.values, *attitudes, new.covariance, corrections, new.frame, new.lights, new.pivot, scratch)
        return new


def start_state(start: Start, layouts: Sequence[StateLayout], frame: OrbitFrame, drifting: int) -> Estimates:
    """The estimates at hand-over, lasting errors as stated; drifting: how many errors are watched for a drift."""
    values, filters = np.zeros(layouts[0].size), len(layouts)
    values[:MOTION], values[TARGET_RATE] = start.motion, start.target_rate_rad_s
    return Estimates(
        t_s=start.t_s,
        values=np.stack([values] * filters),
        dcm_lvlh_from_target=np.stack([start.dcm_lvlh_from_target] * filters),
        dcm_inertial_from_chaser=np.stack([start.dcm_inertial_from_chaser] * filters),
        covariance=np.stack([start.prior(layout) for layout in layouts]),
        frame=frame.dcm_lvlh_from_inertial(start.t_s),
        lights=lights_of(layouts[0]),
        pivot=np.stack([no_pivot(lights_of(layouts[0]))] * filters),
        command_m_s2=np.zeros(3),
        lost=None,
        drift=no_sums(layouts[0].size, drifting),
    )
