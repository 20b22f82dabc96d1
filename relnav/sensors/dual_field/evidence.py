"""What a solved frame must show beside its matches: both fields of a two-field sensor, and noise as the model says.

One field of two is explained twice: as field 0, and by another attitude as field 1 in a fold or an image that is not
the model's. Handedness alone tells them apart, and only while the image is the way round that the model says; so an
attitude of a two-field sensor needs stars of both fields, more than chance would put there.
"""

import math

from relnav.arrays import Codes, Matrix
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import invert_three
from relnav.sensors.dual_field.matching import (
    GRADIENT,
    INFORMATION,
    PRIOR,
    SCRATCH,
    SHIFT,
    Frame,
    log_chance_in_field,
    log_chance_of_match,
    looked_up_with_slip,
    slip_variance,
    tight_chord2,
    variance_across,
)
from relnav.sensors.dual_field.sky import SkyArrays, nearest_star

NEAR_CHORD2 = 1e-6
"""A spot without a star closer than 1 mrad to one without a spot is a near miss."""

LOG_NEAR_BY_CHANCE = math.log(1e-6)
"""More near misses than chance gives so rarely are noise, or optics, other than the model's."""

FOLD_CHI2 = 11.8
"""Square of the distance of the fold from the stated one, in units of its and the stars' variance, that chance exceeds
in 27 of 10,000 mirrors (3 sigma): beyond, the error is not the stated one."""


@kernel
def log_choices(of: float, chosen: float) -> float:
    """Logarithm of the number of choices of some of so many."""
    return math.lgamma(of + 1.0) - math.lgamma(chosen + 1.0) - math.lgamma(of - chosen + 1.0)


@kernel
def both_fields_seen(frame: Frame, match: Codes, cov: Matrix, log_pfa: float) -> bool:
    """Whether chance puts as many stars into the field that has fewer with a probability below the stated one.

    The first of them is found as far away as the fold's error moves a star there, and tells that error; the others must
    then fall within five sigma of their stars. Only the stars that may be seen in that field count as near by chance.
    """
    n, in_field_0, in_field_1 = frame.sigma2.shape[0], 0, 0
    for k in range(n):
        in_field_0 += match[k, 0] >= 0 and match[k, 1] == 0
        in_field_1 += match[k, 0] >= 0 and match[k, 1] == 1
    fewer = min(in_field_0, in_field_1)
    if fewer == 0:
        return False
    weak = 0 if in_field_0 < in_field_1 else 1
    left = float(n - max(in_field_0, in_field_1))
    log, first = log_choices(left, fewer) + math.log(fewer), True
    for k in range(n):
        if match[k, 0] >= 0 and match[k, 1] == weak:
            chord2 = tight_chord2(frame, k, weak, cov)
            if first:
                chord2 += 25.0 * variance_across(frame.W[weak * n + k], frame.slip[PRIOR : PRIOR + 3])
            log += log_chance_in_field(frame, k, weak, chord2)
            first = False
    return log < log_pfa


@kernel
def nearly_matched(frame: Frame, sky: SkyArrays, match: Codes, A: Matrix) -> bool:
    """Whether more spots without a star lie beside one than chance explains: then the noise is not the model's.

    Stars that a spot has already are not counted: a bad detector splits spots.
    """
    n = frame.sigma2.shape[0]
    left, near, log = 0, 0, 0.0
    for k in range(n):
        if match[k, 0] >= 0:
            continue
        left += 1
        for f in range(frame.fields):
            x, y, z = looked_up_with_slip(frame, f * n + k, f, A)
            magnitude = frame.magnitude[f * n + k]
            star = nearest_star(sky.stars, sky.cells, x, y, z, NEAR_CHORD2, magnitude, frame.gate)
            taken = star < 0
            for q in range(n):
                taken = taken or match[q, 0] == star
            if not taken:
                near += 1
                log += log_chance_of_match(frame, k, NEAR_CHORD2)
                break
    return near > 0 and log + log_choices(float(left), float(near)) < LOG_NEAR_BY_CHANCE


@kernel
def fold_distance2(frame: Frame) -> float:
    """Square of the distance of the fold that the stars show from the stated one: 2 (mirror) or 3 in the mean.

    With d0 and d1 what either field alone says of the attitude, and P and S the covariances of the fold's error and of
    d1 - d0, it is (d1 - d0)^T (P + S)^-1 (d1 - d0); (P + S)^-1 (d1 - d0) = P^-1 phi, phi the estimate of the error.
    For after `fit_attitude`, whose sums it reads; 0 where a field is not fixed by its stars alone.
    """
    slip = frame.slip
    variance = slip_variance(frame)
    if frame.fields == 1 or not variance > 0.0:
        return 0.0
    C0, C1 = slip[SCRATCH : SCRATCH + 3], slip[SCRATCH + 3 : SCRATCH + 6]
    if not (
        invert_three(slip[INFORMATION : INFORMATION + 3], C0)
        and invert_three(slip[INFORMATION + 3 : INFORMATION + 6], C1)
    ):
        return 0.0
    axes = 2.0 if determinant(frame.fold) < 0.0 else 3.0
    g0, g1, total = slip[GRADIENT], slip[GRADIENT + 1], 0.0
    for r in range(3):
        apart = 0.0
        for c in range(3):
            apart += C1[r, c] * g1[c] - C0[r, c] * g0[c]
        total += apart * slip[SHIFT, r]
    return total * axes / variance


@kernel
def determinant(M: Matrix) -> float:
    """Of a matrix (3, 3)."""
    return float(
        M[0, 0] * (M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1])
        - M[0, 1] * (M[1, 0] * M[2, 2] - M[1, 2] * M[2, 0])
        + M[0, 2] * (M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0])
    )
