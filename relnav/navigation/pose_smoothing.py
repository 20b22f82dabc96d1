"""Smoothing of a marker log: backward over every event, images where they were exposed.

As `relnav.estimation.smoothing` describes, on the twelve errors: what is known of the event after is told as errors
about its prediction, C turns these into errors of this event, and they are taken into its state. Differences of
attitudes are rotation vectors in target axes, as in the filter. What considered errors have done, S, goes back as the
estimate does: S <- S + C (S later - Phi S). A piece ends where the bank began anew, and where more than one pose was
possible: there the filter's own states stand.
"""

from typing import Any

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel, straight_line
from relnav.dynamics.error_state import MOTION, POSE, RATE, ROTATION, THETA
from relnav.dynamics.relative_motion import transition_into
from relnav.estimation.considered import is_felt
from relnav.estimation.rows import copy_rows
from relnav.estimation.smoothing import backward_model, carry_noise_back, smooth_step
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector
from relnav.mission import VisionMission
from relnav.navigation.pose_epoch import unpack_pose, write_covariance
from relnav.navigation.pose_memory import POSE_TRACK, new_pose_memory, pose_views
from relnav.navigation.pose_propagation import (
    POSE_NOISE_PATTERN,
    POSE_PHI_PATTERN,
    advance_pose,
    carry_sensitivities,
    copy_pose,
)
from relnav.navigation.propagation import prepare_step
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
def _smooth_sensitivities(gain: Matrix, own: Matrix, behind: Matrix, predicted: Matrix) -> None:
    """Replace S behind an event by S of the event, own + C (behind - predicted); all (m, 12)."""
    for c in range(own.shape[0]):
        if is_felt(own[c]) or is_felt(behind[c]):
            for j in range(POSE):
                predicted[c, j] = behind[c, j] - predicted[c, j]
            for i in range(POSE):
                behind[c, i] = own[c, i]
                for j in range(POSE):
                    behind[c, i] += gain[i, j] * predicted[c, j]


@entry
def _smooth(block: Vector, epochs: Record, apart: Stack, after: Vector, effects: Stack) -> None:
    """Smooth filtered events in place, from their last to their first; after: `LATER`, of the event behind them.

    apart (n, m, 12): what considered errors have done to each, of which `factor` then holds the joint covariance;
    effects (2, m, 12): the same of the event behind them, smoothed, and scratch.
    """
    m, later = pose_views(block), after.view(LATER)[0]
    behind, predicted = effects[0], effects[1]
    track, e, inverse = later["track"], later["error"], later["inverse"]
    own, ahead = m.spare[0], m.spare[1]
    acceleration, delta_v = m.motion["acceleration"], m.motion["delta_v"]
    for k in range(epochs.shape[0] - 1, -1, -1):
        one = epochs[k]
        if one["hypotheses"] == 0:
            later["same_piece"] = 0
            continue
        alone = one["hypotheses"] == 1
        motion, dcm, rate, factor = one["motion"], one["dcm"], one["rate"], one["factor"]
        for i in range(MOTION):
            own["motion"][i] = motion[i]
        for i in range(3):
            own["rate"][i] = rate[i]
            for j in range(3):
                own["dcm"][i, j] = dcm[i, j]
        unpack_pose(factor, own["ld"])
        if later["same_piece"] > 0 and alone:
            dt = later["t"] - one["t"]
            for i in range(3):
                acceleration[i], delta_v[i] = later["acceleration"][i], later["delta_v"][i]
            prepare_step(m.step, m.motion, m.scratch, one["t"], dt)
            copy_pose(own, ahead)
            advance_pose(m.body, m.step, m.scratch, m.motion["orbit"], ahead, one["t"], m.step["dt"])
            copy_rows(apart[k], predicted)
            carry_sensitivities(m.scratch["phi"], predicted)
            dt = m.step["dt"]
            transition_into(m.motion["orbit"], one["t"] + dt, -dt, later["motion_inverse"])
            for i in range(MOTION):
                for j in range(MOTION):
                    inverse[i, j] = later["motion_inverse"][i, j]
            _invert(m.body["phi"], later["elimination"], inverse)
            pose_model(m.scratch["noise"], own["ld"], inverse, later["carried"], later["gain"], later["rest"])
            for i in range(MOTION):
                e[i] = track["motion"][i] - ahead["motion"][i]
            rotation_vector_into(track["dcm"], ahead["dcm"], e[THETA:RATE])
            for i in range(3):
                e[RATE + i] = track["rate"][i] - ahead["rate"][i]
            smooth_step(e, track["ld"], later["none"], later["none"], later["gain"], later["rest"])
            for i in range(MOTION):
                motion[i] += e[i]
            for i in range(3):
                rate[i] += e[RATE + i]
            turn_by_rotation_vector(own["dcm"], e[THETA:RATE], dcm)
            _smooth_sensitivities(later["gain"], apart[k], behind, predicted)
        else:
            copy_pose(own, track)
            copy_rows(apart[k], behind)
        write_covariance(track["ld"], behind, apart[k, :0], m.work["ld"], factor, one["by_chaser"])
        for i in range(MOTION):
            track["motion"][i] = motion[i]
        for i in range(3):
            track["rate"][i] = rate[i]
            later["acceleration"][i], later["delta_v"][i] = one["acceleration"][i], one["delta_v"][i]
            for j in range(3):
                track["dcm"][i, j] = dcm[i, j]
        later["t"] = one["t"]
        later["same_piece"] = 1 if alone and one["status"] != STARTED else 0


class PoseSmoother:
    """Goes backward over a log's events, chunk by chunk."""

    def __init__(self, mission: VisionMission) -> None:
        """Begin behind the last event."""
        self._memory = new_pose_memory(mission)
        self._after = np.zeros(LATER.itemsize // 8)
        self._effects = np.zeros((2, *pose_views(self._memory).news.shape))

    def backward(self, events: Any, apart: Stack) -> None:
        """Smooth the events (n,) of type `EPOCH` in place, those after them having been smoothed before.

        apart (n, m, 12): what considered errors have done to each; it ends up in their covariance.
        """
        _smooth(self._memory, events, apart, self._after, self._effects)
