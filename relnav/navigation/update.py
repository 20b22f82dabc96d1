"""The measurement update of one epoch: gate, then an iterated extended Kalman update on the factors.

The gate asks of each group (a beacon, or the whole fix), and of all that pass together, whether their squared
innovation under the prior is credible; NIS is that of everything seen, before the gate, from the same innovation
covariance as the gain. The update is relinearised (Gauss-Newton) while the correction is large enough for the bending
of h to show: image error f (dx / d)^2 above a tenth of the spot noise, d the distance to the nearest beacon. In steady
state once is enough.
"""

import math

from relnav._kernel import kernel
from relnav.arrays import Matrix, Vector
from relnav.estimation.factored import innovation_variance, scalar_update
from relnav.navigation.block import (
    CLOCK,
    GAIN,
    GATE,
    INNOVATION,
    P_ROWS,
    RESIDUAL,
    RESULT,
    SENSOR,
    VARIANCE,
    X_AT,
    X_WORK,
    H,
)
from relnav.navigation.observation import linearise, make_independent, prepare
from relnav.navigation.sight import POINT, camera_position_dock, uses_coordinates
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, UPDATED

MAX_ITERATIONS = 10
LONE_GATE_SHARE = 0.01


@kernel
def copy_rows(source: Matrix, target: Matrix) -> None:
    """Copy a matrix with six columns."""
    for i in range(source.shape[0]):
        for j in range(6):
            target[i, j] = source[i, j]


@kernel
def _take(block: Matrix, at: Vector, m: int) -> float:
    """Take row m into X_WORK, linearised at `at`; returns its squared innovation over its variance."""
    x = block[X_WORK]
    e = block[RESIDUAL, m]
    for j in range(6):
        e -= block[H + m, j] * (x[j] - at[j])
    alpha = scalar_update(x, block[X_WORK + 1 : X_WORK + 7], block[H + m], block[VARIANCE, m], e, block[GAIN])
    return float(e * e / alpha)


@kernel
def _sweep(block: Matrix, track: Matrix, at: Vector) -> float:
    """Update a copy of the track (7, 6) in X_WORK with every row in use; returns their NIS (exact for at = prior)."""
    copy_rows(track, block[X_WORK : X_WORK + P_ROWS])
    nis = 0.0
    for m in range(6):
        if block[VARIANCE, m] > 0.0:
            nis += _take(block, at, m)
    return nis


@kernel
def _groups_nis(block: Matrix, track: Matrix, groups: int) -> tuple[float, int]:
    """NIS and degrees of freedom of a set of beacons (bit i of `groups` = beacon i) under the prior."""
    copy_rows(track, block[X_WORK : X_WORK + P_ROWS])
    nis, dof = 0.0, 0
    for m in range(6):
        if block[VARIANCE, m] > 0.0 and (groups >> (m // 2)) & 1:
            nis += _take(block, track[0], m)
            dof += 1
    return nis, dof


@kernel
def _credible(block: Matrix, track: Matrix, groups: int) -> bool:
    nis, dof = _groups_nis(block, track, groups)
    return dof > 0 and nis <= block[GATE, dof - 1]


@kernel
def _gate_groups(block: Matrix, track: Matrix) -> int:
    """Drop the rows of beacons that are not credible; returns how many beacons pass.

    Each beacon must be credible alone, and those left together: while the prior is wide a glint can pass alone but
    contradict the others. Then the one pair that agrees is kept; if no pair does, or more than one, none is.
    """
    groups = 0
    for i in range(3):
        if _credible(block, track, 1 << i):
            groups |= 1 << i
    if groups > 0 and not _credible(block, track, groups):
        agreeing, found = 0, 0
        if groups == 7:
            for i in range(3):
                if _credible(block, track, 7 - (1 << i)):
                    agreeing += 1
                    found = 7 - (1 << i)
        groups = found if agreeing == 1 else 0
    passed = 0
    for i in range(3):
        if (groups >> i) & 1:
            passed += 1
        else:
            block[VARIANCE, 2 * i] = 0.0
            block[VARIANCE, 2 * i + 1] = 0.0
    return passed


@kernel
def _bends(block: Matrix, at: Vector) -> bool:
    """Whether the step from `at` to X_WORK is long enough for a second linearisation to matter."""
    p, sensor = block[POINT], block[SENSOR]
    camera_position_dock(block, at, p)
    d2 = (p[0] - sensor[5]) ** 2 + p[1] * p[1] + p[2] * p[2]
    moved = 0.0
    for j in range(3):
        moved += (block[X_WORK, j] - at[j]) ** 2
    return bool(sensor[0] * moved > 0.1 * sensor[3] * d2)


@kernel
def _lone_beacon_is_telling(block: Matrix, track: Matrix) -> bool:
    """Whether a single beacon, if it is single, is predicted so well that a glint would hardly pass for it.

    Its gate, an ellipse of area pi g sqrt(det S), must cover less than 1 % of the detector; after a long coast it does
    not, and the filter waits for two beacons.
    """
    lone, beacons = 0, 0
    for i in range(3):
        if block[VARIANCE, 2 * i] > 0.0 or block[VARIANCE, 2 * i + 1] > 0.0:
            lone = i
            beacons += 1
    if beacons != 1:
        return True
    ud, hx, hy = track[1:7], block[H + 2 * lone], block[H + 2 * lone + 1]
    noise = block[SENSOR, 3] ** 2
    xx, yy = innovation_variance(ud, hx, hx) + noise, innovation_variance(ud, hy, hy) + noise
    xy = innovation_variance(ud, hx, hy)
    area = math.pi * block[GATE, 1] * math.sqrt(max(0.0, xx * yy - xy * xy))
    return bool(area < LONE_GATE_SHARE * 4.0 * block[SENSOR, 1] * block[SENSOR, 2])


@kernel
def position_variance(track: Matrix) -> float:
    """Sum of the three position variances of a track (7, 6)."""
    total = 0.0
    for i in range(3):
        total += track[1 + i, i]
        for j in range(i + 1, 6):
            total += track[1 + i, j] * track[1 + i, j] * track[1 + j, j]
    return float(total)


@kernel
def correct(block: Matrix, track: Matrix, spots: Matrix) -> int:
    """Update a track (7, 6), state and factors, with one image (3, 2) m; returns an epoch status, details in RESULT."""
    x, result, innovation = track[0], block[RESULT], block[INNOVATION]
    result[1], result[2], result[4] = math.nan, 0.0, 0.0
    for m in range(6):
        innovation[m] = math.nan
    block[CLOCK, 5] = position_variance(track)
    seen, usable, reason = prepare(block, x, spots)
    result[3] = reason
    result[5] = 0.0
    if seen == 0:
        return PREDICTED
    if usable == 0 or not linearise(block, x, spots):
        return REJECTED
    if uses_coordinates(block) and not _lone_beacon_is_telling(block, track):
        return PREDICTED
    dof = 0
    for m in range(6):
        if block[VARIANCE, m] > 0.0:
            innovation[m] = block[RESIDUAL, m]
            dof += 1
    make_independent(block)
    nis = _sweep(block, track, x)
    result[1], result[2] = nis, dof
    passed = seen
    if uses_coordinates(block):
        if usable < 2 * seen or not nis <= block[GATE, 0]:
            passed = _gate_groups(block, track)
            if passed > 0:
                _sweep(block, track, x)
    elif not nis <= block[GATE, dof - 1]:
        passed = 0
    if passed == 0:
        return REJECTED
    at = block[X_AT]
    iterations = 1
    while iterations < MAX_ITERATIONS:
        source = block[X_AT] if iterations > 1 else x
        if not _bends(block, source):
            break
        for j in range(6):
            at[j] = block[X_WORK, j]
        if not linearise(block, at, spots):
            break
        make_independent(block)
        _sweep(block, track, at)
        iterations += 1
    result[4], result[5] = iterations, passed
    copy_rows(block[X_WORK : X_WORK + P_ROWS], track)
    return UPDATED if passed == seen else PARTIAL
