"""One epoch of the filter: predict, correct, and know when to start or start again.

Start: an image's closed form with its own covariance opens a trial (that image is then used up); the next full image
that the trial predicts, all spots inside the gate, confirms it, if the prediction was tight (2 % of the range). At a
low rate it is not: that image then only teaches the trial its velocity, and the one after confirms. So one bad epoch
can neither start the filter nor lock it out, and two glints that happen to agree cannot either.

Lost: a track whose position sigma grows beyond its range is dropped. Lock-out: after `restart after` epochs in a row
with at least half of what was seen rejected, trials are opened beside the running track, and a confirmed one replaces
it; an image that is used, or shows nothing, ends the row and the trial.
"""

import math

import numpy as np

from relnav._kernel import kernel, straight_line
from relnav.arrays import Matrix
from relnav.estimation.factored import factorize_into
from relnav.geometry.spherical import position_from_angles_jacobian
from relnav.navigation.block import (
    CLOCK,
    CONTROL,
    DOCK,
    FIX_AT,
    JACOBIAN,
    LAYOUT,
    OFFSET,
    P_ROWS,
    RESULT,
    SENSOR,
    SETTINGS,
    TRACK,
    TRIAL,
    WORK,
    beacon_count,
    beacon_row,
)
from relnav.navigation.observation import TRIANGLE_ROWS
from relnav.navigation.propagation import advance, prepare_step
from relnav.navigation.sight import fix_of_spots, prior_is_tight, uses_coordinates
from relnav.navigation.status import LOST, PARTIAL, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.update import clear_results, copy_track, correct
from relnav.sensors.measurement import DEGENERATE, OK
from relnav.sensors.three_beacon.fix import fix_jacobian

WRONG_SHAPE = -1
WRONG_TIME = -2


@straight_line(
    dock=(3, 3), from_angles=(3, 3), jacobian=(3, 6), triangle=(TRIANGLE_ROWS, 6), covariance=(6, 6)
)  # fmt: skip
def _start_covariance(
    dock: Matrix, from_angles: Matrix, jacobian: Matrix, triangle: Matrix, velocity_sigma: float, covariance: Matrix
) -> None:
    """Covariance of a track that starts from one image: G S G^T in position, G = dock^T from_angles jacobian."""
    g = np.zeros((3, 6))
    for i in range(3):
        for k in range(6):
            for j in range(3):
                for m in range(3):
                    g[i, k] += dock[j, i] * from_angles[j, m] * jacobian[m, k]
            g[i, k] *= triangle[4 * (k // 2), 3 + k % 2]
    for i in range(6):
        for j in range(6):
            covariance[i, j] = velocity_sigma * velocity_sigma if i == j else 0.0
    for i in range(3):
        covariance[i, i] = 0.0
        for j in range(3):
            for k in range(6):
                covariance[i, j] += g[i, k] * g[j, k]


@kernel
def start(block: Matrix, track: Matrix, spots: Matrix) -> int:
    """Set a track (7, 6) from one image alone: closed form and its covariance, zero velocity; Status code.

    The fix's covariance J S J^T, turned from (range, azimuth, elevation) into `lvlh_ccsds` position.
    """
    sensor, p, x = block[SENSOR], block[FIX_AT], track[0]
    status = fix_of_spots(block, spots, p)
    if status != OK:
        return status
    jacobian, from_angles, covariance = (
        block[JACOBIAN : JACOBIAN + 3],
        block[WORK + 15 : WORK + 18],
        block[WORK : WORK + 6],
    )
    if not fix_jacobian(
        p, spots, sensor[0], sensor[4], sensor[5], int(block[SETTINGS, 0]), jacobian, block[WORK : WORK + 15]
    ):
        return DEGENERATE
    if not position_from_angles_jacobian(p, from_angles):
        return DEGENERATE
    dock, first = block[DOCK : DOCK + 3], beacon_row(block, 0)
    _start_covariance(dock, from_angles, jacobian, block[first : first + TRIANGLE_ROWS], block[CONTROL, 3], covariance)
    if not factorize_into(covariance, track[1:7]):
        return DEGENERATE
    for i in range(3):
        x[i] = dock[0, i] * p[0] + dock[1, i] * p[1] + dock[2, i] * p[2] - block[OFFSET, i]
        x[3 + i] = 0.0
    return OK


@kernel
def _look_for_start(block: Matrix, spots: Matrix) -> bool:
    """Test the trial with this image, or open one; True if a trial was confirmed and now is the track."""
    clock, trial = block[CLOCK], block[TRIAL : TRIAL + P_ROWS]
    if clock[2] > 0.0:
        outcome = correct(block, trial, spots)
        full = 2 * beacon_count(block) if uses_coordinates(block) else 3
        if outcome == UPDATED and block[RESULT, 2] == full:
            if not prior_is_tight(block):
                return False
            copy_track(trial, block[TRACK : TRACK + P_ROWS])
            clock[1], clock[2], clock[3] = 1.0, 0.0, 0.0
            clock[4] += 1.0
            return True
        if outcome == LOST:
            clock[2] = 0.0
    clear_results(block)
    reason = start(block, trial, spots)
    block[RESULT, 3] = reason
    if reason == OK:
        clock[2] = 1.0
    return False


@kernel
def _half_rejected(spots: Matrix, used: float) -> bool:
    seen = 0
    for i in range(spots.shape[0]):
        if spots[i, 0] == spots[i, 0] or spots[i, 1] == spots[i, 1]:
            seen += 1
    return 2.0 * used <= seen


@kernel
def _copy_rows(source: Matrix, target: Matrix) -> None:
    for i in range(source.shape[0]):
        for j in range(6):
            target[i, j] = source[i, j]


@kernel
def step(block: Matrix, t: float, spots: Matrix) -> int:
    """Take the image (n, 2) m of time t s into the filter; returns an epoch status, details in RESULT.

    The control of INPUT acts since the last epoch: the acceleration all the time, the impulse at its end. For spots of
    another shape or a time that does not advance, nothing is done, and a negative number says so.
    """
    clock, result = block[CLOCK], block[RESULT]
    if spots.shape[0] != beacon_count(block) or spots.shape[1] != 2:
        return WRONG_SHAPE
    if not (clock[0] < t and t < math.inf):
        return WRONG_TIME
    track, trial = block[TRACK : TRACK + P_ROWS], block[TRIAL : TRIAL + P_ROWS]
    running = clock[1] > 0.0
    if running or clock[2] > 0.0:
        prepare_step(block, t - clock[0])
    if running:
        advance(block, track)
    if clock[2] > 0.0:
        advance(block, trial)
    clock[0] = t
    status = WAITING
    if running:
        status = correct(block, track, spots)
        running = status != LOST
        clock[1] = 1.0 if running else 0.0
    if running:
        if status == REJECTED or (status == PARTIAL and _half_rejected(spots, result[5])):
            clock[3] += 1.0
        else:  # used, or nothing seen: what was rejected is not consecutive any more
            clock[3] = 0.0
            clock[2] = 0.0
        if clock[3] < block[SETTINGS, 3]:
            result[0] = status
            return status
        kept = int(block[LAYOUT, 3])
        results, place_to_keep = block[RESULT : int(block[LAYOUT, 1])], block[kept : block.shape[0]]
        _copy_rows(results, place_to_keep)
        if _look_for_start(block, spots):
            status = STARTED
        else:
            _copy_rows(place_to_keep, results)
    else:
        status = STARTED if _look_for_start(block, spots) else WAITING
        if status == WAITING:
            reason = result[3]
            clear_results(block)
            result[3] = reason
    result[0] = status
    return status
