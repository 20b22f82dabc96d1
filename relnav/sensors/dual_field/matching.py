"""Which spots fall on stars under an attitude: the search's inner kernels.

`match` (n, 2) holds a spot's star (-1: none) and field. An attitude is A with w = A v, v the star's apparent direction.
"""

import math
from typing import NamedTuple

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.sensors.dual_field.sky import SkyArrays, nearest_star, none_near

LOOSEST_CHORD2 = 9e-6
"""No spot is looked for farther than 3 mrad from where a pair predicts it."""

PRIOR, SHIFT, SECOND, INFORMATION, GRADIENT, STEP, SCRATCH, SLIP_ROWS = 0, 3, 4, 7, 13, 15, 17, 26
"""Rows of `Frame.slip`: covariance of the fold's error s (3), its estimate (1), covariance of the attitude that field 1
sees (3); the rest is scratch of the fit."""


class Frame(NamedTuple):
    """One image as the kernels read it.

    Attributes
    ----------
    W : (2 n, 3)
        Directions of the n spots if seen in field 0, then if seen in field 1.
    sigma2 : (n,)
        Variance of each direction about an axis normal to it, rad^2; the largest, where `information` is told.
    information : (2 n, 6) or (0, 6)
        Inverse covariance of each direction across itself, rad^-2, where spots have covariances of their own: entries
        xx, xy, xz, yy, yz, zz of a matrix that is zero along the direction.
    magnitude : (2 n,)
        Of the star that each spot would be, seen in field 0, then seen in field 1; any number where `gate` is infinite.
    counts : (2 n,)
        Stars of the sky within the gate of each, times `CLUSTERING`.
    beta : (3,)
        Observer's velocity in units of that of light.
    fold : (3, 3)
        From field 0 to field 1.
    gate : float
        Largest difference of magnitude between a spot and its star.
    fields : int
        1 or 2.
    slip : (SLIP_ROWS, 3)
        The fold's error, see `attitude_fit`: what is known of it, and what the fit says.
    """

    W: Matrix
    sigma2: Vector
    information: Matrix
    magnitude: Vector
    counts: Vector
    beta: Vector
    fold: Matrix
    gate: float
    fields: int
    slip: Matrix


@kernel
def aberrate_into(x: float, y: float, z: float, b: Vector, sign: float, out: Vector) -> None:
    """Write the direction (3,) that an observer moving with sign * b (3,) sees for the unit vector (x, y, z)."""
    if b[0] == 0.0 and b[1] == 0.0 and b[2] == 0.0:
        out[0], out[1], out[2] = x, y, z
        return
    ub = sign * (x * b[0] + y * b[1] + z * b[2])
    inverse_g = math.sqrt(1.0 - b[0] * b[0] - b[1] * b[1] - b[2] * b[2])
    f = sign * (1.0 + ub / (1.0 + inverse_g))
    scale = 1.0 / (1.0 + ub)
    out[0] = (x * inverse_g + b[0] * f) * scale
    out[1] = (y * inverse_g + b[1] * f) * scale
    out[2] = (z * inverse_g + b[2] * f) * scale


@kernel
def aberration_undone(x: float, y: float, z: float, b: Vector) -> tuple[float, float, float]:
    """The catalogue direction of an apparent one, to first order: within 2 mas."""
    along = 1.0 + x * b[0] + y * b[1] + z * b[2]
    return x * along - b[0], y * along - b[1], z * along - b[2]


@kernel
def looked_up(W: Matrix, row: int, A: Matrix, b: Vector) -> tuple[float, float, float]:
    """The catalogue direction that a row of `W` looks at under A."""
    w0, w1, w2 = W[row, 0], W[row, 1], W[row, 2]
    return aberration_undone(
        A[0, 0] * w0 + A[1, 0] * w1 + A[2, 0] * w2,
        A[0, 1] * w0 + A[1, 1] * w1 + A[2, 1] * w2,
        A[0, 2] * w0 + A[1, 2] * w1 + A[2, 2] * w2,
        b,
    )


@kernel
def looked_up_with_slip(frame: Frame, row: int, field: int, A: Matrix) -> tuple[float, float, float]:
    """The same with the fold as the fit has found it, for a row of the given field."""
    if field == 0:
        return looked_up(frame.W, row, A, frame.beta)
    w0, w1, w2 = frame.W[row, 0], frame.W[row, 1], frame.W[row, 2]
    s = frame.slip[SHIFT]
    t0, t1, t2 = w0 + s[1] * w2 - s[2] * w1, w1 + s[2] * w0 - s[0] * w2, w2 + s[0] * w1 - s[1] * w0
    return aberration_undone(
        A[0, 0] * t0 + A[1, 0] * t1 + A[2, 0] * t2,
        A[0, 1] * t0 + A[1, 1] * t1 + A[2, 1] * t2,
        A[0, 2] * t0 + A[1, 2] * t1 + A[2, 2] * t2,
        frame.beta,
    )


@kernel
def variance_across(w: Vector, C: Matrix) -> float:
    """Variance, over both axes across the direction w (3,), by which a small turn of covariance C moves it."""
    w0, w1, w2 = w[0], w[1], w[2]
    along = (
        w0 * (C[0, 0] * w0 + 2.0 * C[0, 1] * w1)
        + w1 * (C[1, 1] * w1 + 2.0 * C[1, 2] * w2)
        + w2 * (C[2, 2] * w2 + 2.0 * C[0, 2] * w0)
    )
    return float(max(0.0, C[0, 0] + C[1, 1] + C[2, 2] - along))


@kernel
def tight_chord2(frame: Frame, k: int, field: int, cov: Matrix) -> float:
    """Square of five sigma of spot k and of the attitude (cov, or that of field 1) about its direction."""
    C = cov if field == 0 else frame.slip[SECOND : SECOND + 3]
    spread = frame.sigma2[k] + variance_across(frame.W[field * frame.sigma2.shape[0] + k], C)
    return float(min(LOOSEST_CHORD2, 25.0 * spread))


@kernel
def log_chance_of_match(frame: Frame, k: int, chord2: float) -> float:
    """Logarithm of the probability that a spot thrown at random over the sky falls on a star so close."""
    stars = frame.counts[k]
    if frame.fields == 2:
        stars += frame.counts[frame.sigma2.shape[0] + k]
    return float(math.log(min(1.0, 0.25 * stars * chord2)))


@kernel
def log_chance_in_field(frame: Frame, k: int, field: int, chord2: float) -> float:
    """The same where only stars seen in one field count."""
    return float(math.log(min(1.0, 0.25 * frame.counts[field * frame.sigma2.shape[0] + k] * chord2)))


@kernel
def slip_variance(frame: Frame) -> float:
    """Bound on the variance, rad^2, by which the fold's error moves a direction of the other field; 0 for one field."""
    prior = frame.slip
    return float(prior[0, 0] + prior[1, 1] + prior[2, 2])


@kernel
def spread_chord2(sigma2: float, d2: float, norm2: float) -> float:
    """Square of four sigma of a direction under the attitude of a pair, up to `LOOSEST_CHORD2`.

    `d2` is that of the sine of its angle from the sum of the pair's two directions, `norm2` that of the sum's length.
    """
    return float(min(LOOSEST_CHORD2, 16.0 * sigma2 * (1.5 + 2.0 * d2 / (4.0 - norm2))))


@kernel
def loose_chord2(W: Matrix, row: int, sigma2: float, m0: float, m1: float, m2: float) -> float:
    """Square of the tolerance for one row of `W` under the attitude of a pair whose two directions add up to m."""
    norm2 = m0 * m0 + m1 * m1 + m2 * m2
    along = max(0.0, W[row, 0] * m0 + W[row, 1] * m1 + W[row, 2] * m2)
    return spread_chord2(sigma2, max(0.0, 1.0 - along * along / norm2), norm2)


@kernel
def match_loosely(
    frame: Frame, sky: SkyArrays, i: int, j: int, field: int, A: Matrix, match: Codes, out: Vector
) -> int:
    """Match the other spots under the attitude of one pair (i, j); returns how many fall on a star.

    An attitude from two stars a chord s apart is off by sigma / sqrt 2 at their middle and turned about it by
    sqrt 2 sigma / s: four sigma of that is the tolerance.
    out[0] is the logarithm of the probability that spots thrown at random over the sky would match as these did.
    """
    W, sigma2, magnitude, b, stars, cells = frame.W, frame.sigma2, frame.magnitude, frame.beta, sky.stars, sky.cells
    n = sigma2.shape[0]
    p, q = field * n + i, field * n + j
    m0, m1, m2 = W[p, 0] + W[q, 0], W[p, 1] + W[q, 1], W[p, 2] + W[q, 2]
    found, log_chance = 0, 0.0
    for k in range(n):
        match[k, 0] = -1
        if k in (i, j):
            continue
        for way in range(frame.fields):
            f = field if way == 0 else 1 - field
            x, y, z = looked_up(W, f * n + k, A, b)
            t2 = loose_chord2(W, f * n + k, sigma2[k], m0, m1, m2)
            if f != field:
                t2 = min(LOOSEST_CHORD2, t2 + 16.0 * slip_variance(frame))
            if none_near(sky.near, x, y, z, t2):
                continue
            star = nearest_star(stars, cells, x, y, z, t2, magnitude[f * n + k], frame.gate)
            if star >= 0:
                match[k, 0], match[k, 1] = star, f
                log_chance += log_chance_of_match(frame, k, t2)
                found += 1
                break
    out[0] = log_chance
    return found


@kernel
def match_tightly(
    frame: Frame, sky: SkyArrays, i: int, j: int, A: Matrix, cov: Matrix, match: Codes, out: Vector
) -> int:
    """Match every spot within five sigma of itself and of the attitude (cov); a star is taken once. Returns how many.

    out[0] as in `match_loosely` and out[1] the number of matches, both over the spots other than i and j.
    """
    n, stars = frame.sigma2.shape[0], sky.stars
    found = 0
    out[0], out[1] = 0.0, 0.0
    for k in range(n):
        match[k, 0] = -1
        nearest2, log_chance = 1e300, 0.0
        for f in range(frame.fields):
            t2 = tight_chord2(frame, k, f, cov)
            x, y, z = looked_up_with_slip(frame, f * n + k, f, A)
            star = nearest_star(stars, sky.cells, x, y, z, t2, frame.magnitude[f * n + k], frame.gate)
            if star >= 0:
                d2 = (stars[star, 0] - x) ** 2 + (stars[star, 1] - y) ** 2 + (stars[star, 2] - z) ** 2
                if d2 < nearest2:
                    nearest2, log_chance = d2, log_chance_of_match(frame, k, t2)
                    match[k, 0], match[k, 1] = star, f
        for q in range(k):
            if match[q, 0] == match[k, 0]:
                match[k, 0] = -1  # the brighter spot keeps the star
        if match[k, 0] >= 0:
            found += 1
            if k not in (i, j):
                out[0] += log_chance
                out[1] += 1.0
    return found


@entry
def turn(A: Matrix, dx: float, dy: float, dz: float) -> None:
    """Turn the frame of A by the small rotation d (rad) in place, exp(-[d x]) A by Cayley's formula: a rotation."""
    x, y, z = 0.5 * dx, 0.5 * dy, 0.5 * dz
    s = x * x + y * y + z * z
    for column in range(3):
        a0, a1, a2 = A[0, column], A[1, column], A[2, column]
        along = 2.0 * (x * a0 + y * a1 + z * a2)
        A[0, column] = ((1.0 - s) * a0 + along * x - 2.0 * (y * a2 - z * a1)) / (1.0 + s)
        A[1, column] = ((1.0 - s) * a1 + along * y - 2.0 * (z * a0 - x * a2)) / (1.0 + s)
        A[2, column] = ((1.0 - s) * a2 + along * z - 2.0 * (x * a1 - y * a0)) / (1.0 + s)
