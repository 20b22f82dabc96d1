"""One epoch of the filter: predict, correct, and know when to start or start again.

Start: the position from one image (`start.py`) with its own covariance opens a trial (that image is then used up); the
next image of three or more whole beacons that the trial predicts, all spots inside the gate, confirms it, if the
prediction was tight (2 % of the range). At a low rate it is not: that image then only teaches the trial its velocity,
and the one after confirms. So one bad epoch can neither start the filter nor lock it out, and two glints that happen to
agree cannot either.

Lost: a track whose position sigma grows beyond its range is dropped. Lock-out: after `restart after` epochs in a row
with at least half of what was seen rejected, trials are opened beside the running track, and a confirmed one replaces
it; an image that is used, or shows nothing, ends the row and the trial. The same where the monitors ask for it: after a
fault that is over, or a jump of the clock.
"""

import math

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, shared_entry
from relnav.codegen.together import anywhere, select
from relnav.estimation.rows import copy_rows, copy_track
from relnav.navigation.memory import Memory, views
from relnav.navigation.observation.beacon_geometry import prior_is_tight, uses_coordinates
from relnav.navigation.observation.beacon_monitors import watch, watch_new_track
from relnav.navigation.observation.beacon_start import start
from relnav.navigation.propagation import advance, advance_state, prepare_step
from relnav.navigation.status import LOST, PARTIAL, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.update import clear_results, correct
from relnav.sensors.measurement import OK
from relnav.sensors.three_beacon.fix import COORDINATES

WRONG_SHAPE = -1
WRONG_TIME = -2


@kernel
def _copy_result(source: Record, numbers: Vector, target: Record, target_numbers: Vector) -> None:
    target["nis"], target["status"], target["dof"] = source["nis"], source["status"], source["dof"]
    target["reason"], target["iterations"], target["used"] = source["reason"], source["iterations"], source["used"]
    for k in range(numbers.shape[0]):
        target_numbers[k] = numbers[k]


@kernel
def _look_for_start(m: Memory, spots: Matrix) -> bool:
    """Test the trial with this image, or open one; True if a trial was confirmed and now is the track."""
    clock = m.clock
    if clock["trial"] > 0:
        outcome = correct(m, m.trial, m.trial_sensitivities, spots, False)
        whole = COORDINATES if uses_coordinates(m.sensor) else 3
        if outcome == UPDATED and m.result["dof"] >= whole:
            if not prior_is_tight(m.prior):
                return False
            copy_track(m.trial, m.track)
            copy_rows(m.trial_sensitivities, m.sensitivities)
            clock["running"], clock["trial"], clock["rejected"] = 1, 0, 0
            clock["starts"] += 1
            return True
        if outcome == LOST:
            clock["trial"] = 0
    clear_results(m.result, m.innovations)
    reason = start(m, m.trial, m.trial_sensitivities, spots)
    m.result["reason"] = reason
    if reason == OK:
        clock["trial"] = 1
    return False


@kernel
def _half_rejected(spots: Matrix, used: int) -> bool:
    seen = 0
    for i in range(spots.shape[0]):
        seen = select((spots[i, 0] == spots[i, 0]) | (spots[i, 1] == spots[i, 1]), seen + 1, seen)
    return 2 * used <= seen


@kernel
def wrong_use(m: Memory, t: float, spots: Matrix) -> int:
    """What is wrong with an image's shape or time: a negative number, or 0."""
    if spots.shape[0] != m.beacons.shape[0] or spots.shape[1] != 2:
        return WRONG_SHAPE
    if not (m.clock["t"] < t and t < math.inf):
        return WRONG_TIME
    return 0


@shared_entry
def step(block: Vector, t: float, spots: Matrix) -> int:
    """Take the image (n, 2) m of time t s into the filter; returns an epoch status, details in the result.

    The control in `motion` acts since the last epoch: the acceleration all the time, the impulse at its end. For spots
    of another shape or a time that does not advance, nothing is done, and a negative number says so.
    """
    m = views(block)
    clock, result = m.clock, m.result
    wrong = wrong_use(m, t, spots)
    if wrong != 0:
        return wrong
    running, dt = clock["running"] > 0, t - clock["t"]
    if running or clock["trial"] > 0:
        prepare_step(m.step, m.motion, m.scratch, clock["t"], dt)
    if running:
        advance(m.step, m.motion["orbit"], m.track, m.sensitivities)
        if m.watch["doubted"] > 0.0:
            advance_state(m.step, m.motion["orbit"], m.fixed["unseen"])
    if clock["trial"] > 0:
        advance(m.step, m.motion["orbit"], m.trial, m.trial_sensitivities)
    clock["t"] = t
    status = WAITING
    if running:
        status = correct(m, m.track, m.sensitivities, spots, True)
        running = status != LOST
        clock["running"] = select(running, 1, 0)
    if running:
        watch(m, spots, dt, status)
        anew = m.watch["restart"] > 0
        refused = status == REJECTED
        if anywhere(status == PARTIAL):
            refused = refused | ((status == PARTIAL) & _half_rejected(spots, result["used"]))
        # used, or nothing seen: what was rejected is not consecutive any more
        clock["rejected"] = select(refused, clock["rejected"] + 1, 0)
        clock["trial"] = select(refused | anew, clock["trial"], 0)
        if (clock["rejected"] < m.fixed["restart_after"]) & (not anew):
            result["status"] = status
            return status
        aside = m.fixed["set_aside"]
        _copy_result(result, m.innovations, aside, m.innovations_aside)
        if _look_for_start(m, spots):
            status = STARTED
            watch_new_track(m, True)
        else:
            _copy_result(aside, m.innovations_aside, result, m.innovations)
    else:
        status = STARTED if _look_for_start(m, spots) else WAITING
        if status == STARTED:
            watch_new_track(m, False)
        if status == WAITING:
            reason = result["reason"]
            clear_results(result, m.innovations)
            result["reason"] = reason
    result["status"] = status
    return status
