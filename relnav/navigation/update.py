"""The measurement update of one epoch: gate, then an iterated extended Kalman update on the factors.

The gate asks of each group (a beacon, or the whole fix), and of all that pass together, whether their squared
innovation under the prior is credible; NIS is that of everything seen, before the gate, from the same innovation
covariance as the gain. The update is relinearised (Gauss-Newton) while the correction is large enough for the bending
of h to show: image error f (dx / d)^2 above a tenth of the spot noise, d the distance to the nearest beacon. In steady
state once is enough.
"""

import math

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, quotient, straight_line
from relnav.estimation.factored import innovation_variance, scalar_update
from relnav.navigation.block import (
    DOCK,
    GRADIENT,
    INNOVATION,
    OBSERVED,
    OFFSET,
    P_ROWS,
    POSITION,
    RESIDUAL,
    RESULT,
    SENSOR,
    VARIANCE,
    X_AT,
    X_WORK,
    H,
    beacon_count,
    beacon_row,
    gate_limit,
)
from relnav.navigation.considered import add_considered_noise, update_sensitivities
from relnav.navigation.observation import (
    linearise_coordinates,
    linearise_position,
    prepare_position,
    take_in_coordinates,
)
from relnav.navigation.sight import locate, uses_coordinates
from relnav.navigation.status import LOST, PARTIAL, PREDICTED, REJECTED, UPDATED
from relnav.sensors.measurement import BEHIND

MAX_ITERATIONS = 10
LONE_GATE_SHARE = 0.01


@straight_line(source=(7, 6), target=(7, 6))
def copy_track(source: Matrix, target: Matrix) -> None:
    """Copy a track: state and the lower triangle of its factors."""
    for i in range(6):
        target[0, i] = source[0, i]
        for j in range(i + 1):
            target[1 + i, j] = source[1 + i, j]


@straight_line(track=(7, 6), at=(6,), h="***000")
def _take(track: Matrix, at: Vector, h: Vector, variance: float, residual: float) -> tuple[float, float]:
    """Update a track with one row, linearised at `at`; returns its squared innovation and the innovation's variance."""
    e = residual
    for j in range(3):
        e = e - h[j] * (track[0, j] - at[j])
    return e * e, scalar_update(track[0], track[1:7], h, variance, e)


@straight_line(track=(7, 6), at=(6,), h=("***000", "***000"), observed=(4,))
def _take_beacon(track: Matrix, at: Vector, h: Matrix, observed: Vector) -> tuple[float, float, float, float]:
    """`_take` both coordinates of a beacon: its gradient rows, and its residuals and variances."""
    first, alpha_first = _take(track, at, h[0], observed[2], observed[0])
    second, alpha_second = _take(track, at, h[1], observed[3], observed[1])
    return first, alpha_first, second, alpha_second


@kernel
def _sweep(block: Matrix, track: Matrix, at: Vector) -> tuple[float, int]:
    """Update a copy of the track (7, 6) in X_WORK with every row in use; returns NIS (exact for at = prior) and dof."""
    work = block[X_WORK : X_WORK + P_ROWS]
    copy_track(track, work)
    nis, dof = 0.0, 0
    if uses_coordinates(block):
        for i in range(beacon_count(block)):
            row = beacon_row(block, i)
            observed = block[row + OBSERVED]
            if observed[4] > 0.0 and observed[2] > 0.0 and observed[3] > 0.0:
                e2, alpha, f2, beta = _take_beacon(work, at, block[row + GRADIENT : row + GRADIENT + 2], observed)
                nis += e2 / alpha + f2 / beta
                dof += 2
            elif observed[4] > 0.0:
                for k in range(2):
                    if observed[2 + k] > 0.0:
                        e2, alpha = _take(work, at, block[row + GRADIENT + k], observed[2 + k], observed[k])
                        nis += e2 / alpha
                        dof += 1
    else:
        for m in range(3):
            if block[VARIANCE, m] > 0.0:
                e2, alpha = _take(work, at, block[H + m], block[VARIANCE, m], block[RESIDUAL, m])
                nis += e2 / alpha
                dof += 1
    return nis, dof


@kernel
def _credible(block: Matrix, track: Matrix) -> tuple[bool, float]:
    """Whether the beacons in the group under test (OBSERVED[4]) agree with the prior and one another; their NIS."""
    nis, dof = _sweep(block, track, track[0])
    return dof > 0 and nis <= gate_limit(block, dof), nis


@kernel
def _agreeing(block: Matrix, track: Matrix, passing: int) -> int:
    """Shrink a contradictory group under test until it agrees; returns its size, 0 if nothing can be told.

    One beacon at a time is left out, the one without which the rest agree best. Two beacons that agree are believed
    only if no other two do: two glints may.
    """
    count = beacon_count(block)
    while passing > 2:
        best, least, agreeing = -1, math.inf, 0
        for i in range(count):
            observed = block[beacon_row(block, i) + OBSERVED]
            if observed[4] > 0.0:
                observed[4] = 0.0
                credible, nis = _credible(block, track)
                observed[4] = 1.0
                if credible:
                    agreeing += 1
                if best < 0 or nis < least:
                    best, least = i, nis
        block[beacon_row(block, best) + OBSERVED, 4] = 0.0
        passing -= 1
        if agreeing == 1 or (agreeing > 1 and passing > 2):
            return passing
    return 0


@straight_line(ld=(6, 6), h=("***000", "***000"), observed=(4,))
def _beacon_nis(ld: Matrix, h: Matrix, observed: Vector) -> float:
    """Squared innovation of a beacon's two coordinates under the prior, over their covariance."""
    xx = innovation_variance(ld, h[0], h[0]) + observed[2]
    yy = innovation_variance(ld, h[1], h[1]) + observed[3]
    xy = innovation_variance(ld, h[0], h[1])
    x, y = observed[0], observed[1]
    return quotient(x * x * yy - 2.0 * x * y * xy + y * y * xx, xx * yy - xy * xy, 0.0)


@kernel
def _lone_nis(block: Matrix, track: Matrix, row: int) -> tuple[float, int]:
    """NIS and degrees of freedom of the beacon with these rows alone."""
    ld, observed, h = track[1:7], block[row + OBSERVED], block[row + GRADIENT : row + GRADIENT + 2]
    if observed[2] > 0.0 and observed[3] > 0.0:
        return _beacon_nis(ld, h, observed), 2
    for k in range(2):
        if observed[2 + k] > 0.0:
            return observed[k] ** 2 / (innovation_variance(ld, h[k], h[k]) + observed[2 + k]), 1
    return 0.0, 0


@kernel
def _gate_beacons(block: Matrix, track: Matrix, nis: float, dof: int) -> int:
    """Drop the rows of beacons that are not credible; returns how many beacons pass. X_WORK then holds the update.

    Each beacon must be credible alone, and those left together: while the prior is wide a glint can pass alone but
    contradict the others. nis and dof are those of all, which X_WORK holds.
    """
    count, passing, usable = beacon_count(block), 0, 0
    for i in range(count):
        row = beacon_row(block, i)
        alone, numbers = _lone_nis(block, track, row)
        credible = numbers > 0 and alone <= gate_limit(block, numbers)
        block[row + OBSERVED, 4] = 1.0 if credible else 0.0
        usable += int(numbers > 0)
        passing += int(credible)
    if passing == usable and nis <= gate_limit(block, dof):
        return passing
    if passing > 0:
        together, _ = _credible(block, track)
        if not together:
            passing = _agreeing(block, track, passing)
    for i in range(count):
        observed = block[beacon_row(block, i) + OBSERVED]
        if passing == 0 or not observed[4] > 0.0:
            observed[2], observed[3] = 0.0, 0.0
    if passing > 0:
        _sweep(block, track, track[0])
    return passing


@kernel
def bends(block: Matrix, at: Vector, x: Vector) -> bool:
    """Whether the step between two states is long enough for a second linearisation to matter."""
    nearest2, moved2 = math.inf, 0.0
    for i in range(beacon_count(block)):
        position = block[beacon_row(block, i) + POSITION]
        d2 = 0.0
        for j in range(3):
            d2 += (position[j] - at[j] - block[OFFSET, j] - block[DOCK + j, 3]) ** 2
        nearest2 = min(nearest2, d2)
    for j in range(3):
        moved2 += (x[j] - at[j]) ** 2
    return bool(block[SENSOR, 0] * moved2 > 0.1 * block[SENSOR, 3] * nearest2)


@kernel
def _lone_beacon_is_telling(block: Matrix, track: Matrix) -> bool:
    """Whether a single beacon, if it is single, is predicted so well that a glint would hardly pass for it.

    Its gate, an ellipse of area pi g sqrt(det S), must cover less than 1 % of the detector; after a long coast it does
    not, and the filter waits for two beacons.
    """
    lone, beacons = 0, 0
    for i in range(beacon_count(block)):
        row = beacon_row(block, i)
        if block[row + OBSERVED, 2] > 0.0 or block[row + OBSERVED, 3] > 0.0:
            lone = row
            beacons += 1
    if beacons != 1:
        return True
    ld, hx, hy, position = track[1:7], block[lone + GRADIENT], block[lone + GRADIENT + 1], block[lone + POSITION]
    xx = innovation_variance(ld, hx, hx) + position[3] * position[3]
    yy = innovation_variance(ld, hy, hy) + position[4] * position[4]
    xy = innovation_variance(ld, hx, hy)
    area = math.pi * gate_limit(block, 2) * math.sqrt(max(0.0, xx * yy - xy * xy))
    return bool(area < LONE_GATE_SHARE * 4.0 * block[SENSOR, 1] * block[SENSOR, 2])


@kernel
def clear_results(block: Matrix) -> None:
    """No NIS, no innovations, nothing used."""
    result = block[RESULT]
    result[1], result[2], result[4], result[5] = math.nan, 0.0, 0.0, 0.0
    for k in range(2 * beacon_count(block)):
        block[INNOVATION + k // 6, k % 6] = math.nan


@kernel
def _keep_innovations(block: Matrix) -> None:
    if uses_coordinates(block):
        for i in range(beacon_count(block)):
            observed = block[beacon_row(block, i) + OBSERVED]
            for k in range(2):
                if observed[2 + k] > 0.0:
                    block[INNOVATION + (2 * i + k) // 6, (2 * i + k) % 6] = observed[k]
    else:
        for m in range(3):
            if block[VARIANCE, m] > 0.0:
                block[INNOVATION, m] = block[RESIDUAL, 3 + m]


@kernel
def observe(block: Matrix, x: Vector, spots: Matrix) -> tuple[int, int, int]:
    """Decide what of the image is used and with which noise, and linearise it, at the predicted state x (and PLACE).

    Returns (groups seen, rows usable, Status code). A group is what the gate takes or leaves as one: a beacon, or the
    whole fix.
    """
    if uses_coordinates(block):
        seen, usable, reason = take_in_coordinates(block, spots)
        dropped = linearise_coordinates(block, x, spots)
        return seen, usable - dropped, BEHIND if dropped > 0 else reason
    seen, usable, reason = prepare_position(block, spots)
    if usable > 0 and not linearise_position(block, x, spots):
        usable = 0
    return seen, usable, reason


@kernel
def linearise_again(block: Matrix, x: Vector, spots: Matrix) -> bool:
    """Linearise what is in use at another state; False if the image is impossible there."""
    if uses_coordinates(block):
        return linearise_coordinates(block, x, spots) == 0
    return linearise_position(block, x, spots)


@kernel
def correct(block: Matrix, track: Matrix, sensitivities: Matrix, spots: Matrix) -> int:
    """Update a track (7, 6), state and factors, and its sensitivities (m, 6), with one image (n, 2) m.

    Returns an epoch status, details in RESULT.
    """
    x, result, work = track[0], block[RESULT], block[X_WORK : X_WORK + P_ROWS]
    clear_results(block)
    if not locate(block, track):
        return LOST
    seen, usable, reason = observe(block, x, spots)
    result[3] = reason
    if seen == 0:
        return PREDICTED
    if usable == 0:
        return REJECTED
    coordinates = uses_coordinates(block)
    if coordinates:
        add_considered_noise(block, x, sensitivities)
    if coordinates and not _lone_beacon_is_telling(block, track):
        return PREDICTED
    _keep_innovations(block)
    nis, dof = _sweep(block, track, x)
    result[1], result[2] = nis, dof
    passed = seen
    if coordinates:  # a part's NIS is at most the whole's, and no whole beacon has fewer than two degrees of freedom
        if usable < 2 * seen or not nis <= gate_limit(block, 2):
            passed = _gate_beacons(block, track, nis, dof)
    elif not nis <= gate_limit(block, dof):
        passed = 0
    if passed == 0:
        return REJECTED
    at = block[X_AT]
    iterations = 1
    while iterations < MAX_ITERATIONS:
        if not bends(block, at if iterations > 1 else x, work[0]):
            break
        for j in range(6):
            at[j] = work[0, j]
        if not linearise_again(block, at, spots):
            break
        _sweep(block, track, at)
        iterations += 1
    result[4], result[5] = iterations, passed
    copy_track(work, track)
    update_sensitivities(block, track, sensitivities, spots)
    return UPDATED if passed == seen else PARTIAL
