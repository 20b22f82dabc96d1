"""The chaser's turn from one time to another, by its gyro's samples.

A sample m_k is the mean rate over the period T that begins at t_k. Within it the rate is taken to change evenly,
w(t_k + u) = m_k + s (u - T/2). From u_1 to u_2 the chaser turns by

    m_k (u_2 - u_1) + s (b(u_2) - b(u_1)),     b(u) = u (u - T) / 2,

and over the whole period by m_k T, whatever s is. With s = 0 an image in its middle would be off by w' T^2 / 8. With
d_k = m_k - m_k-1 the slope was d_k / T half a period ago, and goes on as it has changed: s T = d_k + (d_k - d_k-1) / 2.
Samples of the past alone are used, so that one that comes late changes nothing before its own time.

The slope gets no noise of its own. With noise n of variance N^2 / T in each sample, and g = -b / T^2 <= 1/8, the
attitude at u is off by n_k (u - 3/2 g T) + n_k-1 (1 + 2 g) T + n_k-2 (1 - g/2) T since t_k-2. A walk of the variance
N^2 (u + 2 T) is in the covariance; the one of this is larger by up to 0.082 N^2 T, and no more when the period is over.
"""

import math

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.estimation.schmidt import clear
from relnav.geometry.rotation_vector import turn_by_rotation_vector
from relnav.vehicle.gyro import holding_at
from relnav.vehicle.gyro_errors import take_out

SURE_RAD = 1e-4
"""A slope that turns the chaser by no more than this in half a period is believed at once.

A larger one is if the one before it differs by no more than that, or was of its sign and at least half of it. One wrong
sample makes two slopes, of which neither is so confirmed: it turns the estimate while it holds, but does not bend the
next period too. What is believed of a smaller one is off by ten sigmas of a star sensor at most, and by nothing when
its period is over; a chaser that wobbles by a degree once in six seconds turns by as much in a period of 0.2 s.
"""


@kernel
def _is_next(samples: Matrix, k: int, period: float) -> bool:
    """Whether sample k was taken about a period after the one before it: over a gap there is no slope."""
    return k > 0 and abs(samples[k, 0] - samples[k - 1, 0] - period) < 0.5 * period


@kernel
def slope_into(samples: Matrix, k: int, period: float, slope: Vector) -> bool:
    """Write how fast the rate changes while sample k of (n, 4) holds into slope (3,), rad/s^2; False if it is zero."""
    if not _is_next(samples, k, period):
        return False
    sure, is_told = 8.0 * SURE_RAD / period, False  # of a change of the rate: it turns by an eighth of that in a period
    follows = _is_next(samples, k - 1, period)
    for i in range(3):
        change = samples[k, 1 + i] - samples[k - 1, 1 + i]
        before = samples[k - 1, 1 + i] - samples[k - 2, 1 + i] if follows else 0.0
        if follows and abs(change - before) <= sure:
            change += 0.5 * (change - before)
        elif abs(change) > sure and before * change < 0.5 * change * change:
            change = 0.0
        slope[i] = change / period
        is_told = is_told or change != 0.0
    return is_told


@kernel
def _bend(since: float, period: float) -> float:
    """How far a rate that changes by 1 rad/s^2 has turned, rad, beyond its mean, `since` s after a period began."""
    return 0.5 * since * (since - period) if since < period else 0.0


@kernel
def _add_means(dcm: Matrix, turn: Vector, share: float, left: float, mean: Matrix, early: Matrix) -> None:
    """Add to the means of a step what dcm exp(u [turn x]), u from 0 to 1, gives them over a share of it.

    left: share of the step that comes after. The integrals over u of exp and (1 - u) exp are 1 + b T + c T^2 and
    1/2 + c T + d T^2, T = [turn x]: to rounding of 1e-12, whatever the angle.
    """
    angle2 = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    if angle2 > 0.01:
        angle = math.sqrt(angle2)
        b, c = (1.0 - math.cos(angle)) / angle2, (1.0 - math.sin(angle) / angle) / angle2
        d = (0.5 - b) / angle2
    else:
        b = 0.5 - angle2 / 24.0 * (1.0 - angle2 / 30.0 * (1.0 - angle2 / 56.0))
        c = 1.0 / 6.0 - angle2 / 120.0 * (1.0 - angle2 / 42.0 * (1.0 - angle2 / 72.0))
        d = 1.0 / 24.0 - angle2 / 720.0 * (1.0 - angle2 / 56.0)
    for i in range(3):
        along = dcm[i, 0] * turn[0] + dcm[i, 1] * turn[1] + dcm[i, 2] * turn[2]
        for k in range(3):
            m, n = (k + 1) % 3, (k + 2) % 3
            once, twice = dcm[i, m] * turn[n] - dcm[i, n] * turn[m], along * turn[k] - angle2 * dcm[i, k]
            whole, falling = dcm[i, k] + b * once + c * twice, 0.5 * dcm[i, k] + c * once + d * twice
            mean[i, k] += share * whole
            early[i, k] += 2.0 * share * (left * whole + share * falling)


@kernel
def turn_through(
    samples: Matrix,
    count: int,
    period: float,
    begin: float,
    end: float,
    bias: Vector,
    errors: Vector,
    dcm: Matrix,
    pushes: bool,
    scratch: Record,
) -> None:
    """Turn dcm_inertial_from_chaser, in place, from begin to end by gyro samples less their bias (3,).

    period: of the gyro, s. errors (9,) of the gyro (`gyro_errors`), or none; the turn is then added up in scratch too,
    in `whole`. pushes: write its means over the step into scratch, of the same weight at all times, as
    velocity has it, in `mean`, and of a weight that falls to none at the end, as position has it, in `early`.
    """
    turn, turned, mean, early = scratch["pushed"], scratch["turned"], scratch["mean"], scratch["early"]
    k, step, slope, whole = holding_at(samples, count, begin), end - begin, scratch["slope"], scratch["whole"]
    for i in range(3):
        whole[i] = 0.0
    if pushes:
        clear(mean)
        clear(early)
    while begin < end:
        is_last = k + 1 == count or samples[k + 1, 0] > end
        until = end if is_last else samples[k + 1, 0]
        dt = until - begin
        if dt > 0.0:
            for i in range(3):
                turn[i] = (samples[k, 1 + i] - bias[i]) * dt
            if slope_into(samples, k, period, slope):
                bent = (_bend(until - samples[k, 0], period) if is_last else 0.0) - _bend(begin - samples[k, 0], period)
                for i in range(3):
                    turn[i] += slope[i] * bent
            if len(errors) > 0:
                take_out(errors, turn, slope)
                for i in range(3):
                    whole[i] += turn[i]
            if pushes:
                _add_means(dcm, turn, dt / step, (end - until) / step, mean, early)
            turn_by_rotation_vector(dcm, turn, turned)
            for i in range(3):
                for c in range(3):
                    dcm[i, c] = turned[i, c]
            begin = until
        k += 1
