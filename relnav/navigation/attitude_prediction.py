"""The target-attitude filter's memory by names, and what of it runs compiled: a track predicted, and compared."""

import math

import numpy as np

from relnav.arrays import Matrix, Record
from relnav.codegen.kernel import kernel
from relnav.dynamics.inertia_error import inertia_effect_into
from relnav.dynamics.rigid_body import (
    BODY_ROWS,
    INERTIA,
    INVERSE,
    MEAN_MOTION,
    TORQUE,
    propagate_into,
    step_count,
    turn_body,
)
from relnav.estimation.attitude import (
    ATTITUDE_TRACK,
    COMPARED,
    LASTING,
    carry_errors,
    carry_lasting,
    compare_attitude,
)
from relnav.estimation.unscented_attitude import POINTS, SIGMA_POINTS, gather_points, spread_points

STEPS_A_PIECE = 4
"""Runge-Kutta steps after which sigma points are drawn anew, and what lasts is carried: a turn of 0.2 rad."""

_F, _I = np.float64, np.int64

MEMORY = np.dtype(
    [
        ("body", _F, (BODY_ROWS, 3)),  # as `dynamics.rigid_body` describes it
        ("inertia_sigma", _F, (3, 3)),
        ("density", _F),
        ("rate_sigma", _F),
        ("chaser_sigma", _F),
        ("gate", _F),
        ("trial_gate", _F),
        ("restart_after", _I),
        ("unscented", _I),
        ("t", _F),
        ("measured_t", _F),  # of the latest measured attitude
        ("running", _I),
        ("rejections", _I),
        ("has_trial", _I),
        ("agreed", _I),  # attitudes that have confirmed the trial
        ("chance", _F),  # that attitudes without relation would have
        ("contradicted", _I),  # trials in a row
        ("rate_unknown", _I),
        ("track", ATTITUDE_TRACK),
        ("trial", ATTITUDE_TRACK),
        ("compared", COMPARED),
        ("points", SIGMA_POINTS),
        ("phi", _F, (6, 6)),
        ("noise", _F, (6, 6)),
        ("before", _F, (3, 6)),
        ("after", _F, (3, 6)),
        ("by_lasting", _F, (3, LASTING)),
        ("work", _F, (50, 6)),
    ]
)
"""All of a filter: what it was told, its clock, its tracks, and what a step works with."""


@kernel
def _largest_sigma(track: Record, first: int) -> float:
    """The largest 1-sigma of three errors, the attitude's (first 0) or the rate's (3), what lasts included."""
    ld, lasting, largest = track["ld"], track["lasting"], 0.0
    for i in range(first, first + 3):
        total = ld[i, i]
        for k in range(i):
            total += ld[i, k] * ld[i, k] * ld[k, k]
        for k in range(LASTING):
            total += lasting[i, k] * lasting[i, k]
        if not total <= largest:  # NaN counts as large
            largest = total
    return math.sqrt(largest)


@kernel
def _turn_points(body: Matrix, points: Record, dt: float, work: Matrix) -> bool:
    """Carry the sigma points over dt."""
    inertia, inverse, n = body[INERTIA : INERTIA + 3], body[INVERSE : INVERSE + 3], body[MEAN_MOTION, 0]
    for k in range(POINTS):
        rate = points["rate"][k]
        count = step_count(rate, n, dt)
        for _ in range(count):
            turn_body(points["dcm"][k], rate, inertia, inverse, n, body[TORQUE], dt / count, work)
        if count == 0:
            return False
    return True


@kernel
def predict_attitude(memory: Record, of_trial: bool, dt: float, limit: float) -> bool:
    """Carry the track or the trial of memory (1,), of type MEMORY, over dt s > 0; False when its attitude is lost.

    It is when its 1-sigma exceeds a limit, rad, or by kinematics alone is going to: nothing long is then computed.
    """
    m = memory[0]
    track = m["trial"] if of_trial else m["track"]
    body, points, phi, noise, before, after = m["body"], m["points"], m["phi"], m["noise"], m["before"], m["after"]
    dcm, rate, lasting, sigma, density = track["dcm"], track["rate"], track["lasting"], m["inertia_sigma"], m["density"]
    coming = _largest_sigma(track, 0) + _largest_sigma(track, 3) * dt
    if not coming * coming + density * dt * dt * dt / 3.0 <= limit * limit:
        return False
    steps = step_count(rate, body[MEAN_MOTION, 0], dt)
    if steps == 0:
        return False
    pieces = (steps + STEPS_A_PIECE - 1) // STEPS_A_PIECE
    h, unscented = dt / pieces, m["unscented"] > 0
    for _ in range(pieces):
        if unscented:
            spread_points(track, points)
            if not _turn_points(body, points, h, m["work"][0:14, 0:3]):
                return False
        inertia_effect_into(body, sigma, dcm, rate, before)
        if not propagate_into(body, h, dcm, rate, density, phi, noise, m["work"]):
            return False
        inertia_effect_into(body, sigma, dcm, rate, after)
        carry_lasting(lasting, phi, before, after, h)
        if unscented:
            gather_points(track, points, noise, m["work"][0:3, 0:3])
        else:
            carry_errors(track["ld"], phi, noise)
        if not _largest_sigma(track, 0) <= limit:
            return False
    return True


@kernel
def compare(memory: Record, of_trial: bool, measured: Matrix, noise: Matrix, chaser: Matrix) -> None:
    """Compare the track or the trial with a measured attitude (3, 3) of covariance noise (3, 3), into `compared`.

    chaser (3, 3): dcm_chaser_from_lvlh; its error alpha turns the measured attitude by -C_TB alpha.
    """
    m = memory[0]
    track = m["trial"] if of_trial else m["track"]
    by, dcm, sigma = m["by_lasting"], track["dcm"], m["chaser_sigma"]
    for i in range(3):
        for j in range(3):
            turned = dcm[0, i] * chaser[j, 0] + dcm[1, i] * chaser[j, 1] + dcm[2, i] * chaser[j, 2]
            by[i, LASTING - 3 + j] = -sigma * turned
    compare_attitude(track, measured, noise, by, m["compared"])
