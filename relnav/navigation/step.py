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

from relnav._kernel import kernel
from relnav.arrays import Matrix
from relnav.estimation.factored import factorize_into
from relnav.geometry.spherical import position_from_angles_jacobian
from relnav.navigation.block import (
    ATTITUDE,
    CLOCK,
    CONTROL,
    DOCK,
    INNOVATION,
    KEPT,
    P_ROWS,
    RESULT,
    SENSOR,
    SETTINGS,
    TRACK,
    TRIAL,
    WORK,
    H,
)
from relnav.navigation.propagation import advance, prepare_step
from relnav.navigation.sight import (
    JACOBIAN,
    LOCAL,
    P_DOCK,
    RAYS,
    camera_position_dock,
    fix_of_spots,
    prior_is_tight,
    uses_coordinates,
)
from relnav.navigation.status import PARTIAL, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.update import copy_rows, correct, position_variance
from relnav.sensors.measurement import DEGENERATE, OK
from relnav.sensors.three_beacon.fix import WORK_ROWS, fix_jacobian


@kernel
def start(block: Matrix, track: Matrix, spots: Matrix) -> int:
    """Set a track (7, 6) from one image alone: closed form and its covariance, zero velocity; Status code.

    The fix's covariance sigma^2 J J^T, turned from (range, azimuth, elevation) into `lvlh_ccsds` position.
    """
    sensor, p, x = block[SENSOR], block[P_DOCK], track[0]
    status = fix_of_spots(block, spots, p)
    if status != OK:
        return status
    jacobian, local, g = block[JACOBIAN : JACOBIAN + 3], block[LOCAL : LOCAL + 3], block[RAYS : RAYS + 3]
    projection = int(block[SETTINGS, 0])
    if not fix_jacobian(
        p, spots, sensor[0], sensor[4], sensor[5], projection, jacobian, block[WORK : WORK + WORK_ROWS]
    ):
        return DEGENERATE
    if not position_from_angles_jacobian(p, local):
        return DEGENERATE
    for i in range(3):  # g = dcm_lvlh_from_dock (dp / d rae) J, (3, 6)
        for k in range(6):
            g[i, k] = 0.0
            for j in range(3):
                for m in range(3):
                    g[i, k] += block[DOCK + j, i] * local[j, m] * jacobian[m, k]
    covariance = block[H : H + 6]
    for i in range(6):
        for j in range(6):
            covariance[i, j] = 0.0
    for i in range(3):
        for j in range(3):
            for k in range(6):
                covariance[i, j] += sensor[3] * sensor[3] * g[i, k] * g[j, k]
        covariance[3 + i, 3 + i] = block[CONTROL, 3] ** 2
    if not factorize_into(covariance, track[1:7]):
        return DEGENERATE
    for i in range(3):
        x[i] = block[DOCK + i, 3]
        x[3 + i] = 0.0
        for j in range(3):
            x[i] += block[DOCK + j, i] * p[j] - block[ATTITUDE + j, i] * block[ATTITUDE + j, 3]
    return OK


@kernel
def is_usable(block: Matrix, track: Matrix) -> bool:
    """Whether a predicted track still says where the chaser is: numbers only, position sigma below the range.

    Over a long gap the prediction becomes worthless (and over an absurd one overflows); images could then be believed
    anywhere, and the filter starts anew instead.
    """
    total = 0.0
    for i in range(track.shape[0]):
        for j in range(6):
            total += 0.0 * track[i, j]  # 0 for numbers, NaN for the rest
    p = block[P_DOCK]
    camera_position_dock(block, track[0], p)
    return bool(total == 0.0 and position_variance(track) < p[0] * p[0] + p[1] * p[1] + p[2] * p[2])


@kernel
def _look_for_start(block: Matrix, spots: Matrix) -> bool:
    """Test the trial with this image, or open one; True if a trial was confirmed and now is the track."""
    clock, trial = block[CLOCK], block[TRIAL : TRIAL + P_ROWS]
    if clock[2] > 0.0:
        clock[5] = position_variance(trial)
        tight = prior_is_tight(block, trial[0])
        outcome = correct(block, trial, spots)
        full = 6.0 if uses_coordinates(block) else 3.0
        agrees = outcome == UPDATED and block[RESULT, 2] == full
        if agrees and not tight:
            return False
        if agrees:
            copy_rows(trial, block[TRACK : TRACK + P_ROWS])
            clock[2] = 0.0
            clock[3] = 0.0
            clock[1] = 1.0
            clock[4] += 1.0
            return True
    reason = start(block, trial, spots)
    block[RESULT, 3] = reason
    if reason == OK:
        clock[2] = 1.0
    return False


@kernel
def _half_rejected(spots: Matrix, used: float) -> bool:
    seen = 0
    for i in range(3):
        if spots[i, 0] == spots[i, 0] or spots[i, 1] == spots[i, 1]:
            seen += 1
    return 2.0 * used <= seen


@kernel
def step(block: Matrix, t: float, spots: Matrix) -> int:
    """Take the image (3, 2) m of time t s into the filter; returns an epoch status, details in RESULT.

    The control of INPUT acts since the last epoch: the acceleration all the time, the impulse at its end.
    """
    clock, result, innovation = block[CLOCK], block[RESULT], block[INNOVATION]
    track, results = block[TRACK : TRACK + P_ROWS], block[RESULT : RESULT + 2]
    running, trial = clock[1] > 0.0, clock[2] > 0.0
    if running or trial:
        prepare_step(block, t - clock[0])
    if running:
        advance(block, track)
        running = is_usable(block, track)
        clock[1] = 1.0 if running else 0.0
    if trial:
        advance(block, block[TRIAL : TRIAL + P_ROWS])
        clock[2] = 1.0 if is_usable(block, block[TRIAL : TRIAL + P_ROWS]) else 0.0
    clock[0] = t
    status = WAITING
    if running:
        status = correct(block, track, spots)
        if status == REJECTED or (status == PARTIAL and _half_rejected(spots, result[5])):
            clock[3] += 1.0
        else:  # used, or nothing seen: what was rejected is not consecutive any more
            clock[3] = 0.0
            clock[2] = 0.0
        if clock[3] < block[SETTINGS, 3]:
            result[0] = status
            return status
        copy_rows(results, block[KEPT : KEPT + 2])
        if _look_for_start(block, spots):
            status = STARTED
        else:
            copy_rows(block[KEPT : KEPT + 2], results)
    else:
        result[1], result[2], result[4], result[5] = math.nan, 0.0, 0.0, 0.0
        for m in range(6):
            innovation[m] = math.nan
        if _look_for_start(block, spots):
            status = STARTED
        else:
            result[1], result[2] = math.nan, 0.0
            for m in range(6):
                innovation[m] = math.nan
    result[0] = status
    return status
