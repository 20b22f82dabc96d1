"""From the spots of a frame to its attitude in one compiled call: what the public `measure` runs."""

import math

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.sensors.dual_field.attitude_fit import misfit, miss2
from relnav.sensors.dual_field.evidence import FOLD_CHI2, fold_distance2, nearly_matched
from relnav.sensors.dual_field.matching import PRIOR, SHIFT, SLIP_ROWS, Frame
from relnav.sensors.dual_field.optics import plane_point, ray_and_variance, ray_information, turned_information
from relnav.sensors.dual_field.pair_table import Indices
from relnav.sensors.dual_field.search import FOUND, WORK_ROWS, search_pairs
from relnav.sensors.dual_field.sky import Bits, SkyArrays

FOCAL, CX, CY, K1, K2, HALF_WIDTH, HALF_HEIGHT, SPOT_SIGMA, GATE, FIELDS = range(10)
SETTINGS, BETA, FOLD, FOLD_COVARIANCE, FAINTER, PARAMETERS = 10, 14, 17, 26, 35, 36
"""Entries of `parameters`: of the camera, of the search (`Limits.settings`), velocity / c, the fold by rows, the
covariance of its error by rows, and by how much stars of field 1 look fainter, mag."""

MOST_SPOTS = 100
"""The brightest take part; the choice among more costs time and certainty and adds no accuracy that matters."""

LEAST_SPOTS = 4
TOO_FEW, MISFIT, NOISIER, OFF_FOLD = -2, -3, -5, -6

WORST_FIT = 1.5
"""Largest mean square of the residuals, in units of the noise, before four sigma of its own scatter."""

CREDIBLE_FIT = 3.0
"""A mean square so many sigmas of its own scatter above 1 is not chance: the covariance grows with it."""

BLOCK = 21 + 3 * (WORK_ROWS + SLIP_ROWS)
"""Numbers of `block` beside `BLOCK_SPOT` for each spot."""
SPOT = 23
"""Numbers of scratch for each spot, before what does not depend on their number."""
BLOCK_SPOT = SPOT + 1


@entry
def usable_spots_into(spots: Matrix, magnitude: Vector, half_width: float, half_height: float, order: Codes) -> int:
    """Write the indices of the spots on the detector, brightest first, into order (n,); at most MOST_SPOTS. How many.

    An empty magnitude (0,) means that they are in order already; a spot without a magnitude (NaN) is not used.
    """
    count, known = 0, magnitude.shape[0] > 0
    for k in range(spots.shape[0]):
        if not (abs(spots[k, 0]) <= half_width and abs(spots[k, 1]) <= half_height):
            continue
        if known and not math.isfinite(magnitude[k]):
            continue
        place = count
        while known and place > 0 and magnitude[order[place - 1]] > magnitude[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k
        count += 1
    return min(count, MOST_SPOTS)


@kernel
def framed(scratch: Vector, parameters: Vector, n: int, covariances: int) -> Frame:
    """A frame of n spots in scratch (SPOT n + 3 (WORK_ROWS + SLIP_ROWS),), to be filled; its rows of work stay free.

    covariances: how many spots have their own, all or none.
    """
    fields, place = int(parameters[FIELDS]), SPOT * n + 3 * WORK_ROWS
    told = fields * n if covariances > 0 else 0
    return Frame(
        scratch[: 3 * fields * n].reshape((fields * n, 3)),
        scratch[6 * n : 7 * n],
        scratch[11 * n : 11 * n + 6 * told].reshape((told, 6)),
        scratch[7 * n : (7 + fields) * n],
        scratch[9 * n : (9 + fields) * n],
        parameters[BETA : BETA + 3],
        parameters[FOLD : FOLD + 9].reshape((3, 3)),
        parameters[GATE],
        fields,
        scratch[place : place + 3 * SLIP_ROWS].reshape((SLIP_ROWS, 3)),
    )


@kernel
def fill_frame(
    frame: Frame, spots: Matrix, covariances: Stack, magnitude: Vector, order: Codes, parameters: Vector
) -> None:
    """Fill a frame with the spots that `order` names, as rays; the fold is as stated."""
    n, p, slip, W, M = frame.sigma2.shape[0], parameters, frame.slip, frame.W, frame.fold
    for r in range(3):
        slip[SHIFT, r] = 0.0
        for c in range(3):
            slip[PRIOR + r, c] = p[FOLD_COVARIANCE + 3 * r + c]
    for q in range(n):
        s = order[q]
        x, y = plane_point(spots[s, 0], spots[s, 1], p[FOCAL], p[CX], p[CY], p[K1], p[K2])
        W[q, 0], W[q, 1], W[q, 2], frame.sigma2[q] = ray_and_variance(x, y, p[SPOT_SIGMA] / p[FOCAL])
        if covariances.shape[0] > 0:
            u, v, own = (spots[s, 0] - p[CX]) / p[FOCAL], (spots[s, 1] - p[CY]) / p[FOCAL], frame.information[q]
            frame.sigma2[q] = ray_information(u, v, x, y, p[FOCAL], p[K1], p[K2], covariances[s], own)
            if frame.fields == 2:
                turned_information(M, own, frame.information[n + q])
        frame.magnitude[q] = magnitude[s] if magnitude.shape[0] > 0 else 0.0
        if frame.fields == 2:
            frame.magnitude[n + q] = frame.magnitude[q] - p[FAINTER]
            for r in range(3):
                W[n + q, r] = M[r, 0] * W[q, 0] + M[r, 1] * W[q, 1] + M[r, 2] * W[q, 2]


@entry
def solve_spots(
    spots: Matrix,
    covariances: Stack,
    magnitude: Vector,
    parameters: Vector,
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
    """Solve a frame: FOUND, NOTHING, AMBIGUOUS, ONE_FIELD or TOO_FEW.

    MISFIT, NOISIER and OFF_FOLD where stars are found, but too far from the spots, with spots beside stars, or with the
    fold farther off than its stated error.

    spots (n, 2) px, covariances (n, 2, 2) px^2 or (0, 2, 2) where noise is the model's, and magnitude (n,) or (0,) as
    handed in; stars to line are `SkyArrays`, hip (stars,) their numbers.
    Writes Hipparcos numbers into star (n,), fields into found[3 n:] (4 n,), and into block
    (BLOCK + BLOCK_SPOT n,):
    attitude (9), covariance (9), what `search_pairs` calls info (2), number of spots or fit (1), residuals (n) rad; the
    rest is scratch. Nothing need be set before.
    """
    p, sky = parameters, SkyArrays(stars, cells, near, brighter, cosines, pairs, k, line)
    total = spots.shape[0]
    solution, residual, scratch = block[:21].reshape((7, 3)), block[21 : 21 + total], block[21 + total :]
    order, match = found[:total], found[total : 3 * total].reshape((total, 2))
    for s in range(total):
        star[s], found[3 * total + s], residual[s] = 0, -1, math.nan
    solution[6, 0], solution[6, 1], solution[6, 2] = 0.0, 0.0, 0.0
    n = usable_spots_into(spots, magnitude, p[HALF_WIDTH], p[HALF_HEIGHT], order)
    if n < LEAST_SPOTS:
        solution[6, 2] = n
        return TOO_FEW
    work = scratch[SPOT * n : SPOT * n + 3 * WORK_ROWS].reshape((WORK_ROWS, 3))
    frame = framed(scratch, p, n, covariances.shape[0])
    fill_frame(frame, spots, covariances, magnitude, order, p)
    verdict = search_pairs(
        frame, sky, p[SETTINGS : SETTINGS + 4], match[:n], solution[0:3], solution[3:6], work, solution[6]
    )
    if verdict == FOUND:
        A, cov = solution[0:3], solution[3:6]
        fit = tell_matches(frame, sky, hip, order, match, A, star, found[3 * total :], residual, work[0])
        solution[6, 2] = math.sqrt(fit)
        scatter = math.sqrt(2.0 / (2.0 * matches_of(match, n) - 3.0))
        if fit > WORST_FIT + 4.0 * scatter:
            return MISFIT
        if nearly_matched(frame, sky, match[:n], A):
            return NOISIER
        if fold_distance2(frame) > FOLD_CHI2:
            return OFF_FOLD
        if fit > 1.0 + CREDIBLE_FIT * scatter:
            for r in range(3):
                for c in range(3):
                    cov[r, c] *= fit
    return verdict


@kernel
def matches_of(match: Codes, n: int) -> int:
    """Number of the first n spots that have a star."""
    count = 0
    for k in range(n):
        count += match[k, 0] >= 0
    return count


@kernel
def tell_matches(
    frame: Frame,
    sky: SkyArrays,
    hip: Indices,
    order: Codes,
    match: Codes,
    A: Matrix,
    star: Indices,
    field: Codes,
    residual: Vector,
    v: Vector,
) -> float:
    """Write star, field and residual of every match, in the order of the spots as handed in.

    Returns chi^2 over its degrees of freedom: about 1 if the spots lie as far from their stars as noise puts them.
    """
    n = frame.sigma2.shape[0]
    chi2, count = 0.0, 0
    for k in range(n):
        m = match[k, 0]
        if m < 0:
            continue
        spot, total = order[k], miss2(frame, sky, k, match, A, v)
        star[spot], field[spot], residual[spot] = hip[m], match[k, 1], math.sqrt(total)
        chi2 += misfit(frame, k, match[k, 1], v, total)
        count += 1
    return chi2 / max(2.0 * count - 3.0, 1.0)
