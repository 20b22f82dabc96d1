"""Whether tracking sees both fields of a two-field sensor, or stars of one and a false spot that passes for a star.

The field with more stars, the fold's stated error and the prior attitude predict where a star of the other field is
seen, with a covariance S of its two coordinates: its own noise, what is known of the attitude, and the fold. A star may
lie r^T S^-1 r < `FOLD_CHI2` from there, an ellipse of the area pi FOLD_CHI2 sqrt(det S), and chance puts one of the
spots without a star into it so much the more rarely the smaller it is.
"""

import math

from relnav.arrays import Codes, Matrix
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import tangent_basis_into
from relnav.sensors.dual_field.attitude_fit import gather_field, join
from relnav.sensors.dual_field.evidence import FOLD_CHI2, log_choices
from relnav.sensors.dual_field.matching import (
    PRIOR,
    SCRATCH,
    Frame,
    aberrate_into,
    log_chance_in_field,
    tight_chord2,
)
from relnav.sensors.dual_field.sky import SkyArrays

LOG_SECOND_BY_CHANCE = math.log(1e-4)
"""Stars of a second field that chance shows more often are not believed: a frame's false spots then falsify fewer of
the tracked attitudes than the test of the fold refuses true ones (27 in 10,000), and what is left has an attitude of
its own, that of the other field."""

SECOND_ROWS = 14
"""Rows of `work`: covariance (3) and mean (1) of what the other field sees, information (6), gradients (2), a star's
direction (1) and a spot's distance (1)."""


@kernel
def richer_field(match: Codes, n: int) -> int:
    """The field that has more of the n spots' matches; 0 of equals."""
    ahead = 0
    for k in range(n):
        if match[k, 0] >= 0:
            ahead += 1 - 2 * match[k, 1]
    return 0 if ahead >= 0 else 1


@kernel
def matches_in(match: Codes, n: int, field: int) -> int:
    """Number of the n spots that have a star in a field."""
    count = 0
    for k in range(n):
        count += match[k, 0] >= 0 and match[k, 1] == field
    return count


@kernel
def second_field_told(
    frame: Frame, sky: SkyArrays, match: Codes, A: Matrix, cov: Matrix, prior: Matrix, sigma_prior: float, work: Matrix
) -> bool:
    """Whether the matches in the field that has fewer are its stars rather than chance.

    A, cov as fitted to all matches; prior (3, 3), sigma_prior rad: the attitude that was predicted. The first of them
    is looked for where field, fold and prior predict it, and tells the fold; the others must then fall on their stars.
    """
    n = frame.sigma2.shape[0]
    strong = richer_field(match, n)
    weak = 1 - strong
    fewer, left = matches_in(match, n, weak), float(n - matches_in(match, n, strong))
    if fewer == 0:
        return False
    predict_field(frame, sky, match, A, weak, prior, sigma_prior, work)
    log, first = log_choices(left, fewer) + math.log(fewer), True
    for k in range(n):
        if match[k, 0] < 0 or match[k, 1] != weak:
            continue
        if first:
            distance2, area = innovation(frame, sky, k, match, A, work)
            if fewer == 1 and distance2 > FOLD_CHI2:
                return False
            log += log_chance_in_field(frame, k, weak, FOLD_CHI2 * area)
            first = False
        else:
            log += log_chance_in_field(frame, k, weak, tight_chord2(frame, k, weak, cov))
    return log < LOG_SECOND_BY_CHANCE


@kernel
def predict_field(
    frame: Frame, sky: SkyArrays, match: Codes, A: Matrix, weak: int, prior: Matrix, sigma_prior: float, work: Matrix
) -> None:
    """Write what stars of the field `weak` see of the attitude, by the other field, the fold and the prior alone.

    Covariance into work[:3] and mean, as a turn of A, into work[3]: the turn d of field 0, or d + phi of field 1.
    """
    C, mean, Fa, Fb, ga, gb, v = work[0:3], work[3], work[4:7], work[7:10], work[10], work[11], work[12]
    gather_field(frame, sky, match, A, 1 - weak, Fb, gb, v)
    known, toward = 1.0 / (sigma_prior * sigma_prior), work[13]
    for r in range(3):
        p, q = (r + 1) % 3, (r + 2) % 3
        toward[r] = ga[r] = 0.0
        for c in range(3):  # prior = exp(-[toward x]) A
            toward[r] += 0.5 * (prior[p, c] * A[q, c] - prior[q, c] * A[p, c])
            Fa[r, c] = 0.0
    for r in range(3):  # the prior is of what field 0 sees
        if weak == 0:
            Fa[r, r], ga[r] = known, known * toward[r]
        else:
            Fb[r, r] += known
            gb[r] += known * toward[r]
    slip = frame.slip
    join(Fa, Fb, ga, gb, slip[PRIOR : PRIOR + 3], C, mean, slip[SCRATCH : SCRATCH + 6])


@kernel
def innovation(frame: Frame, sky: SkyArrays, k: int, match: Codes, A: Matrix, work: Matrix) -> tuple[float, float]:
    """Square of the distance of spot k from where `predict_field` puts its star, r^T S^-1 r, and sqrt(det S)."""
    C, mean, basis, v = work[0:3], work[3], work[4:6].reshape((3, 2)), work[12]
    star, w = sky.stars[match[k, 0]], frame.W[match[k, 1] * frame.sigma2.shape[0] + k]
    aberrate_into(star[0], star[1], star[2], frame.beta, 1.0, v)
    q = work[13]
    for r in range(3):
        q[r] = A[r, 0] * v[0] + A[r, 1] * v[1] + A[r, 2] * v[2]
    tangent_basis_into(q, basis)
    S00, S01, S11, r0, r1 = frame.sigma2[k], 0.0, frame.sigma2[k], 0.0, 0.0
    for r in range(3):  # the turn theta moves q by q x theta: (t x q) . theta along t, and t0 x q = -t1, t1 x q = t0
        t0, t1 = basis[r, 0], basis[r, 1]
        r0 += t0 * (w[r] - q[r]) + t1 * mean[r]
        r1 += t1 * (w[r] - q[r]) - t0 * mean[r]
        for c in range(3):
            S00 += t1 * C[r, c] * basis[c, 1]
            S01 -= t1 * C[r, c] * basis[c, 0]
            S11 += t0 * C[r, c] * basis[c, 0]
    det = S00 * S11 - S01 * S01
    return (r0 * r0 * S11 - 2.0 * r0 * r1 * S01 + r1 * r1 * S00) / det, math.sqrt(det)
