"""The target-attitude filter's memory by names, and what of it runs compiled: a track predicted, and compared."""

import math

import numpy as np

from relnav.arrays import Matrix, Record
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.inertia_error import inertia_effect_into, second_order_square, turn_time
from relnav.dynamics.rigid_body import BODY_ROWS, FRAME_RATE, ORBIT, propagate_into, step_count
from relnav.estimation.attitude import (
    ATTITUDE_TRACK,
    COMPARED,
    LASTING,
    TURNING,
    carry_errors,
    carry_lasting,
    compare_attitude,
)
from relnav.estimation.innovation_sums import INNOVATION, RECENT, SUMS, remember_innovation, sums_are_credible
from relnav.estimation.unscented_attitude import SIGMA_POINTS, gather_points, spread_points
from relnav.navigation.attitude.bending import BENT, bend, carry_points, draw_points, is_bent, turn_points, unbend
from relnav.navigation.attitude.inputs import can_be_used
from relnav.navigation.status import PREDICTED, REJECTED, UPDATED, WAITING
from relnav.navigation.told import is_an_attitude

REFUSED, NOT_TAKEN = -1, -2
"""What `look` answers besides a status."""

STEPS_A_PIECE = 4
"""Runge-Kutta steps after which sigma points are drawn anew, and lasting errors are carried: a turn of 0.2 rad."""

LARGEST_SIGMA_RAD = 0.1
"""Of a track's attitude, up to which errors count as small: what bends is followed to second order (`bending.py`)."""
LARGEST_TRIAL_SIGMA_RAD = 1.2
"""Of a trial's: a turn of 2.6 sigma is half a turn, beyond which it would be told from the other side."""

_F, _I = np.float64, np.int64

MEMORY = np.dtype(
    [
        ("body", _F, (BODY_ROWS, 3)),  # as `dynamics.rigid_body` describes it
        ("inertia_sigma", _F, (3, 3)),
        ("inertia_off", _I),  # some of these are above zero
        ("density", _F),
        ("rate_sigma", _F),
        ("chaser_sigma", _F),
        ("gate", _F),
        ("trial_gate", _F),
        ("sum_limit", _F),  # of chi-square, for the sums of innovations
        ("restart_after", _I),
        ("unscented", _I),
        ("t", _F),
        ("measured_t", _F),  # of the latest measured attitude
        ("running", _I),
        ("rejections", _I),
        ("interval", _F),  # since the measured attitude before
        ("has_trial", _I),
        ("opened_t", _F),  # of the attitude that the trial began with
        ("agreed", _I),  # attitudes that have confirmed the trial
        ("chance", _F),  # that attitudes without relation would have
        ("contradicted", _I),  # trials in a row
        ("rate_unknown", _I),
        ("track", ATTITUDE_TRACK),
        ("trial", ATTITUDE_TRACK),
        ("opened", ATTITUDE_TRACK),  # the trial as it began
        ("compared", COMPARED),
        ("given", _F, (3, 3)),  # covariance of the measured attitude, symmetric to the last bit
        ("recent", INNOVATION, RECENT),  # of the track
        ("remembered", _I),
        ("sums", SUMS),
        ("points", SIGMA_POINTS),
        ("bent", BENT),  # beside the track, in a gap
        ("phi", _F, (TURNING, TURNING)),
        ("noise", _F, (TURNING, TURNING)),
        ("before", _F, (3, TURNING)),
        ("after", _F, (3, TURNING)),
        ("by_lasting", _F, (3, LASTING)),
        ("seen", _F, (3, LASTING)),  # what they do to an innovation
        ("work", _F, (50, TURNING)),
    ]
)
"""All of a filter: what it was told, its clock, its tracks, and what a step works with."""


@kernel
def _largest_sigmas(track: Record) -> tuple[float, float]:
    """The largest 1-sigma of the attitude's errors and of the rate's, lasting errors included."""
    ld, lasting, turn, speed = track["ld"], track["lasting"], 0.0, 0.0
    for i in range(TURNING):
        total = ld[i, i]
        for k in range(i):
            total += ld[i, k] * ld[i, k] * ld[k, k]
        for k in range(LASTING):
            total += lasting[i, k] * lasting[i, k]
        if i < 3 and not total <= turn:  # NaN counts as large
            turn = total
        elif i >= 3 and not total <= speed:
            speed = total
    return math.sqrt(turn), math.sqrt(speed)


@kernel
def _carry(memory: Record, track: Record, dt: float, limit: float, unscented: bool, bends: bool) -> bool:
    """Carry a track over dt; False where its attitude is lost: its 1-sigma exceeds a limit, rad.

    If by kinematics alone it is going to, nothing long is computed. bends: its bending is followed, which is the
    track's own and not a trial's.
    """
    m = memory[0]
    # [:] makes all arrays of one kind: a kernel is compiled once for each kind that it is given
    body, points, phi, noise, bent = m["body"], m["points"], m["phi"][:], m["noise"][:], m["bent"]
    before, after = m["before"], m["after"]
    sigma, density, work = m["inertia_sigma"], m["density"], m["work"][:]
    narrow, dcm, rate, lasting = work[0:14, 0:3], track["dcm"][:], track["rate"][:], track["lasting"]
    turn, speed = _largest_sigmas(track)
    coming = turn + speed * dt
    steps = step_count(rate, body[ORBIT, FRAME_RATE], dt)
    known = steps > 0 and coming * coming + density * dt * dt * dt / 3.0 <= limit * limit
    pieces = (steps + STEPS_A_PIECE - 1) // STEPS_A_PIECE
    bending = False
    if bends and bent["on"] > 0:
        unbend(track, bent)
    for _ in range(pieces):
        if not known:
            break
        h = dt / pieces
        if bends and bent["on"] == 0 and is_bent(body, track, turn + speed * h):
            draw_points(body, sigma, track, bent, narrow)
        bending = bends and bent["on"] > 0
        if bending:
            known = carry_points(body, bent, m["inertia_off"] > 0, h, narrow)
        elif unscented:
            spread_points(track, track["ld"], points, narrow)
            known = turn_points(body, points, h, narrow)
        inertia_effect_into(body, sigma, dcm, rate, before)
        jitter = density
        if m["inertia_off"] > 0:
            jitter += second_order_square(body, sigma, before) * turn_time(rate, body[ORBIT, FRAME_RATE])
        known = known and propagate_into(body, h, dcm, rate, jitter, phi, noise, work)
        inertia_effect_into(body, sigma, dcm, rate, after)
        carry_lasting(lasting, phi, before, after, h)
        if unscented and not bending:
            gather_points(track, points, noise, narrow)
        else:
            carry_errors(track["ld"], phi, noise)
        turn, speed = _largest_sigmas(track)
        known = known and turn <= limit
    if bending and known:
        bend(track, bent, m["inertia_off"] > 0, narrow)
        turn, speed = _largest_sigmas(track)
        known = turn <= limit
    return known


@entry
def advance(memory: Record, t: float) -> int:
    """Carry the track and the trial of memory (1,), of type MEMORY, to t s; returns the status if nothing is measured.

    One whose attitude is lost is dropped.
    """
    m = memory[0]
    dt, unscented, m["t"] = t - m["t"], m["unscented"] > 0, t
    if dt > 0.0 and m["running"] > 0 and not _carry(memory, m["track"], dt, LARGEST_SIGMA_RAD, unscented, True):
        m["running"], m["rejections"], m["bent"]["on"] = 0, 0, 0
    if (
        dt > 0.0
        and m["has_trial"] > 0
        and not _carry(memory, m["trial"], dt, LARGEST_TRIAL_SIGMA_RAD, unscented, False)
    ):
        m["has_trial"] = 0
    if m["running"] == 0:
        return WAITING
    return REJECTED if m["rejections"] > 0 else PREDICTED


@entry
def carry_trial(memory: Record, dt: float) -> bool:
    """Carry the trial over dt by slopes alone; False where its attitude is lost."""
    return bool(_carry(memory, memory[0]["trial"], dt, LARGEST_TRIAL_SIGMA_RAD, False, False))


@entry
def take_if_near(memory: Record, of_trial: bool, measured: Matrix, noise: Matrix, chaser: Matrix, limit: float) -> bool:
    """Compare the track or the trial with a measured attitude (3, 3) of covariance noise (3, 3), into `compared`.

    Correct it if NIS is within a limit, and say whether; the track, if its latest innovations together are credible
    too (`estimation.innovation_sums`). chaser (3, 3): dcm_chaser_from_lvlh; its error alpha turns the
    measured attitude by -C_TB alpha.
    """
    m = memory[0]
    track = m["track"]
    if of_trial:
        track = m["trial"]
    by, dcm, sigma, compared = m["by_lasting"], track["dcm"], m["chaser_sigma"], m["compared"]
    for i in range(3):
        for j in range(3):
            turned = dcm[0, i] * chaser[j, 0] + dcm[1, i] * chaser[j, 1] + dcm[2, i] * chaser[j, 2]
            by[i, LASTING - 3 + j] = -sigma * turned
    compare_attitude(track, measured, noise, by, compared, m["work"][0:14, 0:3])
    if not compared["nis"] <= limit:
        return False
    if not of_trial:
        count, seen = m["remembered"], m["seen"]
        for i in range(3):
            for k in range(LASTING):
                seen[i, k] = track["lasting"][i, k] + by[i, k]
        recent = m["recent"]
        remember_innovation(recent[count % RECENT], compared["innovation"], compared["innovation_covariance"], seen)
        if not sums_are_credible(recent, count + 1, m["sums"], m["sum_limit"]):
            return False
        m["remembered"], m["bent"]["on"] = count + 1, 0
    corrected = compared["track"]
    for i in range(3):
        track["rate"][i] = corrected["rate"][i]
        for j in range(3):
            dcm[i, j] = corrected["dcm"][i, j]
    for i in range(TURNING):
        for j in range(i + 1):
            track["ld"][i, j] = corrected["ld"][i, j]
        for j in range(LASTING):
            track["lasting"][i, j] = corrected["lasting"][i, j]
    return True


@entry
def look(
    memory: Record, t: float, measured: Matrix, noise: Matrix, chaser: Matrix, checked: bool, scratch: Matrix
) -> int:
    """Carry memory (1,) to t s, where an attitude (3, 3) with its covariance (3, 3) was measured, and use it if near.

    Returns UPDATED; NOT_TAKEN where there is no track or it contradicts the attitude (`step.use` goes on from here); or
    REFUSED, with nothing changed, where an argument is not what it ought to be. checked: they all are; scratch (6, 3).
    """
    m = memory[0]
    symmetric, given = scratch[0:3], m["given"][:]
    if checked:
        for i in range(3):
            for j in range(3):
                symmetric[i, j] = noise[i, j]
    elif not (
        math.isfinite(t)
        and not t < m["t"]
        and is_an_attitude(chaser)
        and can_be_used(measured, noise, symmetric, scratch[3:6])
    ):
        return REFUSED
    for i in range(3):
        for j in range(3):
            given[i, j] = symmetric[i, j]
    advance(memory, t)
    m["interval"], m["measured_t"] = t - m["measured_t"], t
    if m["running"] == 0 or not take_if_near(memory, False, measured, given, chaser, m["gate"]):
        return NOT_TAKEN
    if m["rejections"] > 0:
        m["rejections"], m["has_trial"], m["contradicted"] = 0, 0, 0
    return UPDATED
