"""Smoothing of a marker log: backward over every event, images where they were exposed.

As `relnav.estimation.smoothing` describes, on the twelve errors: what is known of the event after is told as errors
about its prediction, C turns these into errors of this event, and they are taken into its state. Differences of
attitudes are rotation vectors in target axes, as in the filter. What considered errors have done, S, goes back as the
estimate does: S <- S + C (S later - Phi S). A piece ends where the bank began anew, and where more than one pose was
possible: there the filter's own states stand. With an inertia that is off S grows on the way back as on the way out:
`pose_inertia_smoothing.py` goes it another way.

After two images the rate of a tumbling target may be degrees per second off, and torque is quadratic in rates. Slopes
about such a state make the smoothed one wrong by many of its small sigmas. So where these slopes would differ about the
smoothed state, the step is made again about that (an iterated smoother, Bell 1994): of an error e = (x - y) of the
filter's state x about it, later - f(y) - Phi e is what the event after says anew.
"""

import math
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel, straight_line, variant
from relnav.dynamics.error_state import MOTION, POSE, RATE, ROTATION, THETA
from relnav.dynamics.relative_motion import transition_into
from relnav.estimation.considered import is_felt
from relnav.estimation.rows import copy_rows
from relnav.estimation.smoothing import backward_model, carry_noise_back, smooth_step
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.mission import VisionMission
from relnav.navigation.blocks import inertia_errors
from relnav.navigation.packed_factors import unpack_factors
from relnav.navigation.pose_epoch import write_covariance
from relnav.navigation.pose_inertia_smoothing import MOST_REPEATED, STRAIGHT, InertiaSmoother
from relnav.navigation.pose_memory import POSE_TRACK, PoseMemory, new_pose_memory, pose_views
from relnav.navigation.pose_propagation import (
    POSE_NOISE_PATTERN,
    POSE_PHI_PATTERN,
    advance_pose,
    copy_place,
    copy_pose,
    errors_between,
    multiply_pose,
    variance,
)
from relnav.navigation.propagation import prepare_step
from relnav.navigation.smoothing import smooth_sensitivity
from relnav.navigation.status import STARTED

_F = np.float64

LATER = np.dtype(
    [
        ("track", POSE_TRACK),  # smoothed
        ("t", _F),
        ("same_piece", np.int64),
        ("acceleration", _F, 3),
        ("delta_v", _F, 3),
        ("error", _F, POSE),
        ("moved", _F, POSE),
        ("before", _F, (POSE, POSE)),  # factors of `track`, while a step is made again
        ("none", _F, POSE),
        ("inverse", _F, (POSE, POSE)),
        ("carried", _F, (POSE, POSE)),
        ("gain", _F, (POSE, POSE)),
        ("rest", _F, (POSE, POSE)),
        ("motion_inverse", _F, (MOTION, MOTION)),
        ("elimination", _F, (ROTATION, 2 * ROTATION)),
    ]
)
"""What stands after an event, and scratch."""


_WHOLE = (POSE, POSE)


@straight_line(noise=POSE_NOISE_PATTERN, ld=_WHOLE, inverse=POSE_PHI_PATTERN, carried=_WHOLE, c=_WHOLE, s_ld=_WHOLE)
def pose_model(noise: Matrix, ld: Matrix, inverse: Matrix, carried: Matrix, c: Matrix, s_ld: Matrix) -> None:
    """Write C and the factors of S (12, 12) of an event; noise: factors of Q; carried: scratch."""
    carry_noise_back(noise, inverse, carried)
    backward_model(ld, inverse, carried, c, s_ld)


smooth_sensitivity_pose = variant(
    smooth_sensitivity, "smooth_sensitivity_pose", later=(POSE,), row=(POSE,), phi=POSE_PHI_PATTERN, gain=_WHOLE
)


@kernel
def _invert(m: Matrix, work: Matrix, out: Matrix) -> None:
    """Write the inverse of m (6, 6) into the last block of out (12, 12), by Gauss and Jordan; work (6, 12)."""
    for i in range(ROTATION):
        for j in range(ROTATION):
            work[i, j], work[i, ROTATION + j] = m[i, j], 1.0 if i == j else 0.0
    for i in range(ROTATION):
        best = i
        for r in range(i + 1, ROTATION):
            if abs(work[r, i]) > abs(work[best, i]):
                best = r
        for j in range(2 * ROTATION):
            work[i, j], work[best, j] = work[best, j], work[i, j]
        pivot = work[i, i]
        for j in range(2 * ROTATION):
            work[i, j] /= pivot
        for r in range(ROTATION):
            if r != i:
                factor = work[r, i]
                for j in range(2 * ROTATION):
                    work[r, j] -= factor * work[i, j]
    for i in range(ROTATION):
        for j in range(ROTATION):
            out[THETA + i, THETA + j] = work[i, ROTATION + j]


@kernel
def _is_straight(moved: Vector, ld: Matrix, dt: float) -> bool:
    """Whether slopes over dt s differ by nothing that matters between two states, moved (12,) being their difference.

    Torques are quadratic in rates, and rotations do not add. ld: factors of the smoothed covariance.
    """
    turn, rate, least_turn, least_rate = 0.0, 0.0, math.inf, math.inf
    for i in range(3):
        turn += moved[THETA + i] * moved[THETA + i]
        rate += moved[RATE + i] * moved[RATE + i]
        least_turn = min(least_turn, variance(ld, THETA + i))
        least_rate = min(least_rate, variance(ld, RATE + i))
    bend = dt * (math.sqrt(turn * rate) + rate * dt)
    of_rate, of_turn = rate * dt <= STRAIGHT * math.sqrt(least_rate), bend <= STRAIGHT * math.sqrt(least_turn)
    return of_rate and of_turn


@kernel
def _move(track: Record, e: Vector, out: Record) -> None:
    """Write the place of a hypothesis moved by errors (12,)."""
    for i in range(MOTION):
        out["motion"][i] = track["motion"][i] + e[i]
    for i in range(3):
        out["rate"][i] = track["rate"][i] + e[RATE + i]
    turn_by_rotation_vector(track["dcm"], e[THETA:RATE], out["dcm"])


@kernel
def _step_back(m: PoseMemory, later: Record, own: Record, t: float) -> None:
    """Over the prepared step make of the factors of `track`, of the event after, those of the event of t, own.

    `error`: by what the smoothed state is off own. Slopes are taken about own first, and then about what follows.
    """
    ahead, about, dt, orbit = m.spare[1], m.spare[2], m.step["dt"], m.motion["orbit"]
    track, e, moved, inverse = later["track"], later["error"], later["moved"], later["inverse"]
    transition_into(orbit, t + dt, -dt, later["motion_inverse"])
    for i in range(MOTION):
        for j in range(MOTION):
            inverse[i, j] = later["motion_inverse"][i, j]
    copy_rows(track["ld"], later["before"])
    copy_pose(own, about)
    for repeated in range(MOST_REPEATED):
        copy_pose(about, ahead)
        advance_pose(m.body, m.step, m.scratch, orbit, ahead, t, dt)
        _invert(m.body["phi"], later["elimination"], inverse)
        pose_model(m.scratch["noise"], own["ld"], inverse, later["carried"], later["gain"], later["rest"])
        errors_between(ahead, track, e)
        if repeated > 0:
            errors_between(about, own, moved)
            multiply_pose(m.scratch["phi"], moved)
            for i in range(POSE):
                e[i] -= moved[i]
            copy_rows(later["before"], track["ld"])
        smooth_step(e, track["ld"], later["none"], later["none"], later["gain"], later["rest"])
        _move(own, e, ahead)
        errors_between(about, ahead, moved)
        if _is_straight(moved, track["ld"], dt):
            return
        copy_place(ahead, about)


@entry
def _smooth(block: Vector, epochs: Record, apart: Stack, after: Vector, behind: Matrix) -> None:
    """Smooth filtered events in place, from their last to their first; after: `LATER`, of the event behind them.

    apart (n, m, 12): what considered errors have done to each, of which `factor` then holds the joint covariance;
    behind (m, 12): the same of the event behind them, smoothed.
    """
    m, later = pose_views(block), after.view(LATER)[0]
    track, e, own = later["track"], later["error"], m.spare[0]
    acceleration, delta_v = m.motion["acceleration"], m.motion["delta_v"]
    for k in range(epochs.shape[0] - 1, -1, -1):
        one = epochs[k]
        if one["hypotheses"] == 0:
            later["same_piece"] = 0
            continue
        alone = one["hypotheses"] == 1
        copy_place(one, own)
        unpack_factors(one["factor"], own["ld"])
        if later["same_piece"] > 0 and alone:
            for i in range(3):
                acceleration[i], delta_v[i] = later["acceleration"][i], later["delta_v"][i]
            prepare_step(m.step, m.motion, m.scratch, one["t"], later["t"] - one["t"])
            _step_back(m, later, own, one["t"])
            _move(own, e, one)
            for c in range(behind.shape[0]):
                if is_felt(apart[k, c]) or is_felt(behind[c]):
                    smooth_sensitivity_pose(behind[c], apart[k, c], m.scratch["phi"], later["gain"])
        else:
            copy_pose(own, track)
            copy_rows(apart[k], behind)
        write_covariance(track["ld"], behind, apart[k, :0], m.work["ld"], one["factor"], one["by_chaser"])
        copy_place(one, track)
        for i in range(3):
            later["acceleration"][i], later["delta_v"][i] = one["acceleration"][i], one["delta_v"][i]
        later["t"] = one["t"]
        later["same_piece"] = 1 if alone and one["status"] != STARTED else 0


class PoseSmoother:
    """Goes backward over a log's events, chunk by chunk."""

    def __init__(self, mission: VisionMission) -> None:
        """Begin behind the last event."""
        self._memory = new_pose_memory(mission)
        self._against_inertia = InertiaSmoother(mission, self._memory) if inertia_errors(mission) > 0 else None
        self._after = np.zeros(LATER.itemsize // 8)
        self._behind = np.zeros_like(pose_views(self._memory).news)

    def backward(self, events: Any, apart: Stack) -> None:
        """Smooth the events (n,) of type `EPOCH` in place, those after them having been smoothed before.

        apart (n, m, 12): what considered errors have done to each; it ends up in their covariance.
        """
        if self._against_inertia is not None:
            self._against_inertia.backward(events, apart)
        else:
            _smooth(self._memory, events, apart, self._after, self._behind)
