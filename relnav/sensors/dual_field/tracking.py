"""Attitude from a frame when a prior attitude is at hand: two stars are enough, and no pair is looked up."""

import math

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.frame_solver import (
    BETA,
    FIELDS,
    FOLD,
    GATE,
    HALF_HEIGHT,
    HALF_WIDTH,
    SETTINGS,
    TOO_FEW,
    fill_frame,
    tell_matches,
    usable_spots_into,
)
from relnav.sensors.dual_field.matching import Frame, fit_attitude, match_tightly
from relnav.sensors.dual_field.pair_table import Indices
from relnav.sensors.dual_field.search import FOUND, LOG_PFA, NOTHING, count_stars, log_false_alarm
from relnav.sensors.dual_field.sky import Bits, SkyArrays

LEAST_STARS = 2
WIDEST_PRIOR_RAD = 3e-3 / 5.0
"""Five sigma of the prior may not reach farther than the loosest tolerance of a match."""

IN_LINE = -4
"""The stars found lie along one line: no attitude follows."""


@kernel
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
    """Attitude near a prior one: FOUND, NOTHING, TOO_FEW or IN_LINE; arguments as of `frame_solver.solve_spots`.

    block (27 + 10 n,) begins with the prior attitude (9), of 1-sigma `sigma_prior` rad about each axis, which the
    result replaces; it only says where to look. Where there is no attitude, block[20] is the number of spots used
    (TOO_FEW) or of those that fall on stars (NOTHING).

    Stars are believed when chance would not put as many within the prior's reach; fewer than two, or a pair that chance
    might make, is TOO_FEW or NOTHING, and the caller may go on lost in space.
    """
    p, sky, total = parameters, SkyArrays(stars, cells, near, brighter, cosines, pairs, k, line), spots.shape[0]
    solution, residual, scratch = block[:27].reshape((9, 3)), block[27 : 27 + total], block[27 + total :]
    order, match = found[:total], found[total : 3 * total].reshape((total, 2))
    for s in range(total):
        star[s], found[3 * total + s], residual[s] = 0, -1, math.nan
    n = usable_spots_into(spots, magnitude, p[HALF_WIDTH], p[HALF_HEIGHT], order)
    solution[6, 0], solution[6, 1], solution[6, 2] = 0.0, 1.0, n
    if n < LEAST_STARS:
        solution[6, 1] = 0.0
        return TOO_FEW
    frame = Frame(
        scratch[: 3 * int(p[FIELDS]) * n].reshape((int(p[FIELDS]) * n, 3)),
        scratch[6 * n : 7 * n],
        scratch[7 * n : 8 * n],
        scratch[8 * n : 9 * n],
        p[BETA : BETA + 3],
        p[FOLD : FOLD + 9].reshape((3, 3)),
        p[GATE],
        int(p[FIELDS]),
    )
    fill_frame(frame, spots, magnitude, p, order)
    count_stars(frame, sky)
    A, cov, out, v = solution[0:3], solution[3:6], solution[7], solution[8]
    for i in range(3):
        for j in range(3):
            cov[i, j] = sigma_prior * sigma_prior if i == j else 0.0
    seen, chance, fitted = 0, math.inf, False
    for _ in range(2):
        seen = match_tightly(frame, sky, -1, -1, A, cov, match[:n], out)
        chance = min(chance, out[0])
        fitted = seen >= LEAST_STARS and fit_attitude(frame, sky, match[:n], A, cov, 2, v)
        if not fitted:
            break
    log = log_false_alarm(1.0, n + 2, min(seen, n), chance)
    solution[6, 0], solution[6, 2] = log, seen
    if seen < LEAST_STARS or log >= p[SETTINGS + LOG_PFA]:
        return NOTHING
    if not fitted:
        return IN_LINE
    tell_matches(frame, sky, hip, order, match, A, star, found[3 * total :], residual, v)
    return FOUND
