"""One epoch of the filter: predict, correct, and know when to start or start again.

Start: the position from one image (`start.py`) with its own covariance opens a trial (that image is then used up); the
next image of three or more whole beacons that the trial predicts, all spots inside the gate, confirms it, if the
prediction was tight (2 % of the range). At a low rate it is not: that image then only teaches the trial its velocity,
and the one after confirms. So one bad epoch can neither start the filter nor lock it out, and two glints that happen to
agree cannot either.

Lost: a track whose position sigma grows beyond its range is dropped. Lock-out: after `restart after` epochs in a row
with at least half of what was seen rejected, trials are opened beside the running track, and a confirmed one replaces
it; an image that is used, or shows nothing, ends the row and the trial.
"""

import math

from relnav.arrays import Matrix
from relnav.codegen.kernel import kernel
from relnav.navigation.block import (
    CLOCK,
    LAYOUT,
    P_ROWS,
    RESULT,
    SETTINGS,
    TRACK,
    TRIAL,
    beacon_count,
)
from relnav.navigation.propagation import advance, prepare_step
from relnav.navigation.sight import prior_is_tight, uses_coordinates
from relnav.navigation.start import start
from relnav.navigation.status import LOST, PARTIAL, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.update import clear_results, copy_track, correct
from relnav.sensors.measurement import OK

WRONG_SHAPE = -1
WRONG_TIME = -2


@kernel
def _copy_rows(source: Matrix, target: Matrix) -> None:
    for i in range(source.shape[0]):
        for j in range(6):
            target[i, j] = source[i, j]


@kernel
def _look_for_start(block: Matrix, spots: Matrix) -> bool:
    """Test the trial with this image, or open one; True if a trial was confirmed and now is the track."""
    clock, trial = block[CLOCK], block[TRIAL : TRIAL + P_ROWS]
    of_track = block[int(block[LAYOUT, 4]) : int(block[LAYOUT, 1])]
    of_trial = block[int(block[LAYOUT, 5]) : block.shape[0]]
    if clock[2] > 0.0:
        outcome = correct(block, trial, of_trial, spots)
        whole = 6 if uses_coordinates(block) else 3
        if outcome == UPDATED and block[RESULT, 2] >= whole:
            if not prior_is_tight(block):
                return False
            copy_track(trial, block[TRACK : TRACK + P_ROWS])
            _copy_rows(of_trial, of_track)
            clock[1], clock[2], clock[3] = 1.0, 0.0, 0.0
            clock[4] += 1.0
            return True
        if outcome == LOST:
            clock[2] = 0.0
    clear_results(block)
    reason = start(block, trial, of_trial, spots)
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
    of_track = block[int(block[LAYOUT, 4]) : int(block[LAYOUT, 1])]
    running = clock[1] > 0.0
    if running or clock[2] > 0.0:
        prepare_step(block, t - clock[0])
    if running:
        advance(block, track, of_track)
    if clock[2] > 0.0:
        advance(block, trial, block[int(block[LAYOUT, 5]) : block.shape[0]])
    clock[0] = t
    status = WAITING
    if running:
        status = correct(block, track, of_track, spots)
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
        results = block[RESULT : int(block[LAYOUT, 4])]
        kept = int(block[LAYOUT, 3])
        place_to_keep = block[kept : kept + results.shape[0]]
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
