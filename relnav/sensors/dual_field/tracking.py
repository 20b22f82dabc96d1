"""Attitude from a frame when a prior attitude is at hand: two stars are enough, and no pair is looked up."""

import math

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel
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
from relnav.sensors.dual_field.matching import (
    LOOSEST_CHORD2,
    Frame,
    log_chance_of_match,
    match_tightly,
    slip_variance,
    tight_chord2,
)
from relnav.sensors.dual_field.pair_table import Indices
from relnav.sensors.dual_field.search import FOUND, LOG_PFA, NOTHING, count_stars, log_false_alarm
from relnav.sensors.dual_field.second_field import SECOND_ROWS, matches_in, richer_field, second_field_told
from relnav.sensors.dual_field.sky import Bits, SkyArrays

LEAST_STARS = 2
WIDEST_PRIOR_RAD = 3e-3 / 5.0
"""Five sigma of the prior may not reach farther than the loosest tolerance of a match."""
FOUND_ALONE, ALONG_A_LINE, NO_ROTATION = 2, -7, -8
"""Besides the verdicts of `solve_spots`: all stars in one field of two; stars, or a prior, that are no attitude."""


@entry
def track_spots(
    spots: Matrix,
    covariances: Stack,
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
    chance would not put as many within its reach, those of a second field when it would not put them there beside the
    first one's (`second_field`); otherwise the first alone gives the attitude.
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
    frame = framed(scratch, p, n, covariances.shape[0])
    fill_frame(frame, spots, covariances, magnitude, order, p)
    count_stars(frame, sky)
    A, cov, free = solution[0:3], solution[3:6], scratch[SPOT * n :]
    out, v, prior = free[0:3], free[3:6], free[6:15].reshape((3, 3))
    for r in range(3):
        for c in range(3):
            prior[r, c] = A[r, c]
            cov[r, c] = sigma_prior * sigma_prior if r == c else 0.0
    forget_slip(frame, cov)
    stars_found = match_tightly(frame, sky, -1, -1, A, cov, match[:n], out)
    if stars_found >= LEAST_STARS and fit_attitude(frame, sky, match[:n], A, cov, 2, v):
        stars_found = match_tightly(frame, sky, -1, -1, A, cov, match[:n], out)
    log = log_false_alarm(1.0, n + 2, stars_found, log_chance_of_fit(frame, match[:n], cov, sigma_prior, -1))
    solution[6, 0], solution[6, 1], solution[6, 2] = log, 1.0, stars_found
    if stars_found < LEAST_STARS or log >= p[SETTINGS + LOG_PFA]:
        return NOTHING
    if not fit_attitude(frame, sky, match[:n], A, cov, 2, v):
        return ALONG_A_LINE
    verdict, work = FOUND, free[15 : 15 + 3 * SECOND_ROWS].reshape((SECOND_ROWS, 3))
    if frame.fields == 2 and not second_field_told(frame, sky, match[:n], A, cov, prior, sigma_prior, work):
        verdict = fit_alone(frame, sky, match[:n], A, cov, sigma_prior, p[SETTINGS + LOG_PFA], out, v, solution[6])
    elif fold_distance2(frame) > FOLD_CHI2:
        verdict = OFF_FOLD
    if verdict in (FOUND, FOUND_ALONE):
        tell_matches(frame, sky, hip, order, match, A, star, found[3 * total :], residual, v)
    return verdict


@kernel
def log_chance_of_fit(frame: Frame, match: Codes, cov: Matrix, sigma_prior: float, field: int) -> float:
    """Logarithm of the expected number of fits as good by chance, of the matched spots of a field, or of all at -1.

    Two of them made the attitude, and lie by chance anywhere within the prior's reach; the others must fall on their
    stars within that of the fit (cov). With p of a spot for the one and P for the other that is, over all pairs i < j,
    the sum of P_i P_j times the product of the others' p.
    """
    log, total, squares = 0.0, 0.0, 0.0
    for k in range(match.shape[0]):
        f = match[k, 1]
        if match[k, 0] >= 0 and (field < 0 or f == field):
            reach = frame.sigma2[k] + 2.0 * sigma_prior * sigma_prior + (slip_variance(frame) if f == 1 else 0.0)
            tight = log_chance_of_match(frame, k, tight_chord2(frame, k, f, cov))
            ratio = math.exp(log_chance_of_match(frame, k, min(LOOSEST_CHORD2, 25.0 * reach)) - tight)
            log, total, squares = log + tight, total + ratio, squares + ratio * ratio
    pairs = 0.5 * (total * total - squares)
    return log + math.log(pairs) if pairs > 0.0 else 0.0


@kernel
def fit_alone(
    frame: Frame,
    sky: SkyArrays,
    match: Codes,
    A: Matrix,
    cov: Matrix,
    sigma_prior: float,
    log_pfa: float,
    out: Vector,
    v: Vector,
    info: Vector,
) -> int:
    """Fit the field with more matches alone: FOUND_ALONE, NOTHING or ALONG_A_LINE; info as in `track_spots`.

    Where no star of the other field was matched, nothing but what is written of the chance changes.
    """
    n = frame.sigma2.shape[0]
    field = richer_field(match, n)
    if matches_in(match, n, 1 - field) == 0:
        return FOUND_ALONE
    for _ in range(2):  # the false star has moved the attitude, and others may have been lost
        for k in range(n):
            if match[k, 1] != field:
                match[k, 0] = -1
        if matches_in(match, n, field) < LEAST_STARS:
            return NOTHING
        if not fit_attitude(frame, sky, match, A, cov, 2, v):
            return ALONG_A_LINE
        match_tightly(frame, sky, -1, -1, A, cov, match, out)
    for k in range(n):
        if match[k, 1] != field:
            match[k, 0] = -1
    stars_found = matches_in(match, n, field)
    chance = log_chance_of_fit(frame, match, cov, sigma_prior, field)
    info[0], info[2] = log_false_alarm(1.0, n + 2, stars_found, chance), stars_found
    if stars_found < LEAST_STARS or info[0] >= log_pfa:
        return NOTHING
    return FOUND_ALONE if fit_attitude(frame, sky, match, A, cov, 2, v) else ALONG_A_LINE
