"""Attitude from a frame when a prior attitude is at hand: two stars are enough, and no pair is looked up."""

import math

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import entry
from relnav.geometry.rotation import are_a_rotation
from relnav.sensors.dual_field.attitude_fit import fit_attitude, forget_slip
from relnav.sensors.dual_field.evidence import FOLD_CHI2, fold_distance2
from relnav.sensors.dual_field.frame_solver import (
    HALF_HEIGHT,
    HALF_WIDTH,
    OFF_FOLD,
    SETTINGS,
    SPOT,
    TOO_FEW,
    fill_frame,
    framed,
    tell_matches,
    usable_spots_into,
)
from relnav.sensors.dual_field.matching import match_tightly
from relnav.sensors.dual_field.pair_table import Indices
from relnav.sensors.dual_field.search import FOUND, LOG_PFA, NOTHING, count_stars, log_false_alarm
from relnav.sensors.dual_field.sky import Bits, SkyArrays

LEAST_STARS = 2
WIDEST_PRIOR_RAD = 3e-3 / 5.0
"""Five sigma of the prior may not reach farther than the loosest tolerance of a match."""
FOUND_ALONE, ALONG_A_LINE, NO_ROTATION = 2, -7, -8
"""Besides the verdicts of `solve_spots`: all stars in one field of two; stars, or a prior, that are no attitude."""


@entry
def track_spots(
    spots: Matrix,
    magnitude: Vector,
    parameters: Vector,
    sigma_prior: float,
    stars: Matrix,
    cells: Indices,
    near: Bits,
    brighter: Vector,
    cosines: Vector,
    pairs: Indices,
    k: Indices,
    line: Vector,
    hip: Indices,
    star: Indices,
    found: Codes,
    block: Vector,
) -> int:
    """Attitude near a prior one: FOUND, FOUND_ALONE, TOO_FEW, NOTHING, ALONG_A_LINE, OFF_FOLD or NO_ROTATION.

    Arguments as of `solve_spots`; the prior attitude stands in block[:9], sigma_prior (rad) about each axis is at most
    `WIDEST_PRIOR_RAD`. The result does not lean on the prior: it only says where to look. Stars are believed when
    chance would not put as many within its reach.
    """
    p, sky = parameters, SkyArrays(stars, cells, near, brighter, cosines, pairs, k, line)
    total = spots.shape[0]
    solution, residual, scratch = block[:21].reshape((7, 3)), block[21 : 21 + total], block[21 + total :]
    order, match = found[:total], found[total : 3 * total].reshape((total, 2))
    if not are_a_rotation(block[0], block[1], block[2], block[3], block[4], block[5], block[6], block[7], block[8]):
        return NO_ROTATION
    for s in range(total):
        star[s], found[3 * total + s], residual[s] = 0, -1, math.nan
    n = usable_spots_into(spots, magnitude, p[HALF_WIDTH], p[HALF_HEIGHT], order)
    solution[6, 0], solution[6, 1], solution[6, 2] = 0.0, 0.0, n
    if n < LEAST_STARS:
        return TOO_FEW
    frame = framed(scratch, p, n)
    fill_frame(frame, spots, magnitude, order, p)
    count_stars(frame, sky)
    A, cov, free = solution[0:3], solution[3:6], scratch[SPOT * n :]
    out, v = free[0:3], free[3:6]
    for r in range(3):
        for c in range(3):
            cov[r, c] = sigma_prior * sigma_prior if r == c else 0.0
    forget_slip(frame, cov)
    stars_found = match_tightly(frame, sky, -1, -1, A, cov, match[:n], out)
    chance = out[0]
    if stars_found >= LEAST_STARS and fit_attitude(frame, sky, match[:n], A, cov, 2, v):
        stars_found = match_tightly(frame, sky, -1, -1, A, cov, match[:n], out)
    log = log_false_alarm(1.0, n + 2, min(stars_found, n), min(chance, out[0]))
    solution[6, 0], solution[6, 1], solution[6, 2] = log, 1.0, stars_found
    if stars_found < LEAST_STARS or log >= p[SETTINGS + LOG_PFA]:
        return NOTHING
    if not fit_attitude(frame, sky, match[:n], A, cov, 2, v):
        return ALONG_A_LINE
    if fold_distance2(frame) > FOLD_CHI2:
        return OFF_FOLD
    tell_matches(frame, sky, hip, order, match, A, star, found[3 * total :], residual, v)
    first, second = frame.fields == 1, frame.fields == 1
    for s in range(n):
        first = first or (match[s, 0] >= 0 and match[s, 1] == 0)
        second = second or (match[s, 0] >= 0 and match[s, 1] == 1)
    return FOUND if first and second else FOUND_ALONE
