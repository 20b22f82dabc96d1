"""Identification by pairs within one field: the default method, one compiled search.

Of any three stars two share a field, so only pairs of one field are looked up (table one); both orders and both fields
are tried, the attitude of the pair predicts where every other spot should find its star, in either field. A solution is
accepted when chance would give as good a one among all that were tried with a probability below the stated one.
"""

import math

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.attitude_fit import agree_on_fold, fit_attitude, forget_slip
from relnav.sensors.dual_field.evidence import both_fields_seen, determinant, log_choices
from relnav.sensors.dual_field.matching import Frame, match_loosely, match_tightly, slip_variance
from relnav.sensors.dual_field.pair_table import k_range
from relnav.sensors.dual_field.screening import (
    QUESTIONS,
    attitude_of_triads,
    extent,
    prepare_questions,
    promising,
    spot_triad,
    star_triad,
)
from relnav.sensors.dual_field.sky import BRIGHTEST_MAG, MAG_STEP, NEAR, SkyArrays

CLUSTERING = 2.0
"""Bright stars crowd along the Milky Way and Gould's belt: chance matches are counted as this much likelier."""

LOG_PFA, MOST_TRIED, SHORTEST_CHORD2, LEAST_MATCHES = range(4)
"""Entries of `settings`."""

EARLY_SPOTS = 8
"""Without brightness pairs of so many first spots are tried before others, the nearest first."""

WORK_ROWS = 24 + 2 * QUESTIONS * 5 // 3
FOUND, NOTHING, AMBIGUOUS, ONE_FIELD = 1, 0, -1, -4


@kernel
def count_stars(frame: Frame, sky: SkyArrays) -> None:
    """Fill `frame.counts` with the stars of the sky within each spot's gate, times `CLUSTERING`."""
    for k in range(frame.counts.shape[0]):
        last = sky.brighter.shape[0] - 1
        above = (frame.magnitude[k] + frame.gate - BRIGHTEST_MAG) / MAG_STEP
        below = (frame.magnitude[k] - frame.gate - BRIGHTEST_MAG) / MAG_STEP
        high = last if not above < last else int(max(above, 0.0)) + 1
        low = 0 if not below > 0.0 else int(min(below, float(last)))
        frame.counts[k] = CLUSTERING * (sky.brighter[min(high, last)] - sky.brighter[low])


@kernel
def log_false_alarm(tried: float, spots: int, others: float, log_chance: float) -> float:
    """Logarithm of the expected number of solutions as good by chance: tries, times choices of spots, times matches.

    `others` are the matches besides the two that gave the attitude, among `spots` - 2.
    """
    return math.log(tried) + log_choices(spots - 2.0, others) + log_chance


@kernel
def settle(
    frame: Frame, sky: SkyArrays, i: int, j: int, match: Codes, A: Matrix, cov: Matrix, out: Vector, v: Vector
) -> int:
    """From first matches to a settled attitude: fit and match again; returns the number of matches, 0 if none.

    Twice, because the first fit may predict the other field too loosely; once where one field's matches all stood.
    """
    first, own = 0, match[i, 1]
    for k in range(match.shape[0]):
        first += match[k, 0] >= 0
    found = 0
    for once in range(2):
        if not fit_attitude(frame, sky, match, A, cov, 1, v):
            return 0
        found = match_tightly(frame, sky, i, j, A, cov, match, out)
        if found < 2:
            return 0
        if once == 0 and slip_variance(frame) > 0.0:
            agree_on_fold(frame, sky, match, A, cov, own, v)
        if frame.fields == 1 and found >= first:
            break
    return found if fit_attitude(frame, sky, match, A, cov, 1, v) else 0


@kernel
def swap_fields(frame: Frame, sky: SkyArrays, match: Codes, A: Matrix, cov: Matrix, work: Matrix) -> int:
    """For a fold of determinant +1: try the solution with its fields the other way round, keep the better.

    A turned second field can be taken for the first one (handedness does not tell them apart as it does with a mirror);
    only the number of matches does. AMBIGUOUS if both explain as many.
    """
    other, turned, out, M = work[0:3], work[3:6], work[13], frame.fold
    found = match_tightly(frame, sky, -1, -1, A, cov, match, out)
    verdict = FOUND
    for way in range(2):
        for r in range(3):
            for c in range(3):
                other[r, c], turned[r, c] = 0.0, 0.0
                for k in range(3):
                    m = M[r, k] if way == 0 else M[k, r]
                    other[r, c] += m * A[k, c]
                    for p in range(3):  # the axis that is known badly turns as well
                        turned[r, c] += m * cov[k, p] * (M[c, p] if way == 0 else M[p, c])
        forget_slip(frame, turned)
        again = match_tightly(frame, sky, -1, -1, other, turned, match, out)
        if again > found:
            for r in range(3):
                for c in range(3):
                    A[r, c], cov[r, c] = other[r, c], turned[r, c]
            verdict = FOUND
            break
        if again == found:
            verdict = AMBIGUOUS
    forget_slip(frame, cov)
    for _ in range(2):
        settled = match_tightly(frame, sky, -1, -1, A, cov, match, out) >= 2
        if not (settled and fit_attitude(frame, sky, match, A, cov, 2, work[14])):
            return NOTHING
    return verdict


@kernel
def try_stars(
    frame: Frame,
    sky: SkyArrays,
    i: int,
    j: int,
    a: int,
    c: int,
    field: int,
    settings: Vector,
    match: Codes,
    A: Matrix,
    cov: Matrix,
    work: Matrix,
    info: Vector,
) -> bool:
    """Whether the attitude of spots i, j as stars a, c leads to one that chance does not explain; sets all outputs."""
    n, out, v = frame.sigma2.shape[0], work[13], work[14]
    if match_loosely(frame, sky, i, j, field, A, match, out) < settings[LEAST_MATCHES] - 2:
        return False
    for k in range(n):  # what lies in the other field is predicted too loosely to start from
        if match[k, 1] != field:
            match[k, 0] = -1
    match[i, 0], match[i, 1], match[j, 0], match[j, 1] = a, field, c, field
    if settle(frame, sky, i, j, match, A, cov, out, v) < settings[LEAST_MATCHES]:
        return False
    info[0] = log_false_alarm(info[1], n, out[1], out[0])
    return bool(info[0] < settings[LOG_PFA])


@kernel
def pair_fits(frame: Frame, sky: SkyArrays, i: int, j: int, a: int, c: int, field: int) -> bool:
    """Whether spots i and j, seen in a field, are as bright as stars a and c."""
    first = field * frame.sigma2.shape[0]
    return bool(
        abs(sky.stars[a, 3] - frame.magnitude[first + i]) <= frame.gate
        and abs(sky.stars[c, 3] - frame.magnitude[first + j]) <= frame.gate
    )


@kernel
def nearest_asked(frame: Frame) -> float:
    """Cosine of the narrowest pair of spots that predicts every other spot within `NEAR`, so that a look refuses it.

    As `matching.spread_chord2`, with the spot that is farthest from the middle of all.
    """
    W, n, farthest2 = frame.W, frame.sigma2.shape[0], 0.0
    x, y, z = 0.0, 0.0, 0.0
    for k in range(n):
        x, y, z = x + W[k, 0], y + W[k, 1], z + W[k, 2]
    for k in range(n):
        along = W[k, 0] * x + W[k, 1] * y + W[k, 2] * z
        farthest2 = max(farthest2, 1.0 - along * along / (x * x + y * y + z * z))
    left = NEAR * NEAR / (16.0 * frame.sigma2[0]) - 1.5
    return 1.0 - farthest2 / left if left > 0.5 * farthest2 else -2.0


@kernel
def next_farther(W: Matrix, spots: int, cosine: float) -> tuple[int, int, float]:
    """Of the pairs of the first spots that are farther apart than a cosine the nearest, and its own; 0, 0, -2: none."""
    p, q, best = 0, 0, -2.0
    for j in range(1, spots):
        for i in range(j):
            c = W[i, 0] * W[j, 0] + W[i, 1] * W[j, 1] + W[i, 2] * W[j, 2]
            if best < c < cosine:
                p, q, best = i, j, c
    return p, q, best


@kernel
def try_spots(
    frame: Frame,
    sky: SkyArrays,
    i: int,
    j: int,
    settings: Vector,
    match: Codes,
    A: Matrix,
    cov: Matrix,
    work: Matrix,
    info: Vector,
) -> int:
    """Try a pair of spots for all pairs of stars: as `search_pairs`; NOTHING if none of them leads to a solution."""
    W, n, gate, b = frame.W, frame.sigma2.shape[0], frame.gate, frame.beta
    speed = math.sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2])
    asked, ways, least = extent(n, frame.fields, int(settings[LEAST_MATCHES]) - 2)
    spots, stars, questions = work[15:21], work[21:24], work[24:WORK_ROWS].reshape((2, QUESTIONS, 5))
    cosine = W[i, 0] * W[j, 0] + W[i, 1] * W[j, 1] + W[i, 2] * W[j, 2]
    if 2.0 - 2.0 * cosine < settings[SHORTEST_CHORD2]:
        return NOTHING
    angle = math.acos(min(1.0, cosine))
    tolerance = 4.0 * math.sqrt(frame.sigma2[i] + frame.sigma2[j]) + speed * angle
    low, high = math.cos(angle + tolerance), math.cos(max(0.0, angle - tolerance))
    first, last = k_range(sky.cosines, sky.k, sky.line, low, high)
    for field in range(frame.fields):
        triad = spots[3 * field : 3 * field + 3]
        spot_triad(W, field * n + i, field * n + j, triad, work[8:10])
        prepare_questions(frame, i, j, field, triad, asked, ways, questions[field])
    mi, mj = frame.magnitude[i], frame.magnitude[j]
    fainter = frame.magnitude[n + i] - mi if frame.fields == 2 else 0.0
    low, high = min(0.0, fainter) - gate, max(0.0, fainter) + gate
    for pair in range(first, last):
        p, q = sky.pairs[pair, 0], sky.pairs[pair, 1]
        mp, mq = sky.stars[p, 3], sky.stars[q, 3]
        straight = low <= mp - mi <= high and low <= mq - mj <= high
        crossed = low <= mq - mi <= high and low <= mp - mj <= high
        if not (straight or crossed):
            continue
        apart = star_triad(sky.stars, b, p, q, stars, work[4:8])
        for order in range(2):
            if not (straight if order == 0 else crossed):
                continue
            sign, a, c = 1.0 - 2.0 * order, sky.pairs[pair, order], sky.pairs[pair, 1 - order]
            for field in range(frame.fields):
                if not pair_fits(frame, sky, i, j, a, c, field):
                    continue
                info[1] += 1.0
                if not (apart and promising(frame, sky, questions[field], asked, ways, least, stars, sign)):
                    continue
                attitude_of_triads(spots[3 * field : 3 * field + 3], stars, sign, A)
                if not try_stars(frame, sky, i, j, a, c, field, settings, match, A, cov, work, info):
                    continue
                verdict = FOUND
                if frame.fields == 2 and determinant(frame.fold) > 0.0:
                    verdict = swap_fields(frame, sky, match, A, cov, work)
                one_field = frame.fields == 2 and not both_fields_seen(frame, match, cov, settings[LOG_PFA])
                return ONE_FIELD if verdict == FOUND and one_field else verdict
    return NOTHING


@kernel
def search_pairs(
    frame: Frame,
    sky: SkyArrays,
    settings: Vector,
    match: Codes,
    A: Matrix,
    cov: Matrix,
    work: Matrix,
    info: Vector,
) -> int:
    """Find the attitude of a frame. FOUND, NOTHING, AMBIGUOUS or ONE_FIELD; writes match, A, cov, info.

    info (2,): logarithm of the false alarm probability, hypotheses tried. work (WORK_ROWS, 3) is scratch. Pairs go by
    their fainter spot, brightest first; without brightness those of the first spots come before, the nearest first, as
    there are fewer stars to try.
    """
    n, W = frame.sigma2.shape[0], frame.W
    count_stars(frame, sky)
    info[0], info[1] = 0.0, 0.0
    early = min(n, EARLY_SPOTS) if frame.gate == math.inf else 0
    nearest = nearest_asked(frame) if early > 0 else -2.0
    cosine = nearest
    while True:
        i, j, cosine = next_farther(W, early, cosine)
        if cosine < -1.5:
            break
        verdict = try_spots(frame, sky, i, j, settings, match, A, cov, work, info)
        if verdict != NOTHING or info[1] > settings[MOST_TRIED]:
            return verdict
    for j in range(1, n):
        for i in range(j):
            c = W[i, 0] * W[j, 0] + W[i, 1] * W[j, 1] + W[i, 2] * W[j, 2]
            if j < early and c < nearest:
                continue
            verdict = try_spots(frame, sky, i, j, settings, match, A, cov, work, info)
            if verdict != NOTHING or info[1] > settings[MOST_TRIED]:
                return verdict
    return NOTHING
