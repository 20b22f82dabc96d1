"""The measurement update: what a sensor says as rows, gated group by group, taken in on the factors of P = L D L^T.

A sensor writes groups: residuals z - h(x), gradient rows, and variances of independent noise (0 = row not used), where
a group is what the gate takes or leaves as one: a spot, or a whole fix. Nothing here knows a sensor.

The gate asks of each group, and of all that pass together, whether their squared innovation under the prior is
credible; NIS is that of everything seen, before the gate, from the same innovation covariance as the gain.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, quotient, straight_line
from relnav.estimation.factored import innovation_variance, scalar_update


def track_type(n: int) -> np.dtype[np.void]:
    """A track: its state, and the factors of the covariance of its n errors."""
    return np.dtype([("state", np.float64, n), ("ld", np.float64, (n, n))])


def group_type(n: int) -> np.dtype[np.void]:
    """A group of at most three rows about n errors.

    residual z - h(x), of the independent rows; variance of their noise, 0 = not used; gradient dh/dx; innovation, of
    the numbers as they were measured; rows, how many there are; tested, whether the gate has not left the group out.
    """
    number, whole = np.float64, np.int64
    return np.dtype(
        [
            ("residual", number, 3),
            ("variance", number, 3),
            ("gradient", number, (3, n)),
            ("innovation", number, 3),
            ("rows", whole),
            ("tested", whole),
        ]
    )


@straight_line(from_state=(6,), from_ld=(6, 6), state=(6,), ld=(6, 6))
def copy_numbers(from_state: Vector, from_ld: Matrix, state: Vector, ld: Matrix) -> None:
    """Copy a state and the lower triangle of its factors."""
    for i in range(6):
        state[i] = from_state[i]
        for j in range(i + 1):
            ld[i, j] = from_ld[i, j]


@kernel
def copy_track(source: Record, target: Record) -> None:
    """Copy a track: state and the lower triangle of its factors."""
    copy_numbers(source["state"], source["ld"], target["state"], target["ld"])


@straight_line(state=(6,), ld=(6, 6), at=(6,), h="***000")
def take(state: Vector, ld: Matrix, at: Vector, h: Vector, variance: float, residual: float) -> tuple[float, float]:
    """Update a track with one row, linearised at `at`; returns its squared innovation and the innovation's variance."""
    e = residual
    for j in range(3):
        e = e - h[j] * (state[j] - at[j])
    return e * e, scalar_update(state, ld, h, variance, e)


@straight_line(state=(6,), ld=(6, 6), at=(6,), h=("***000", "***000"), residual=(2,), variance=(2,))
def take_pair(
    state: Vector, ld: Matrix, at: Vector, h: Matrix, residual: Vector, variance: Vector
) -> tuple[float, float, float, float]:
    """`take` two rows."""
    first, alpha_first = take(state, ld, at, h[0], variance[0], residual[0])
    second, alpha_second = take(state, ld, at, h[1], variance[1], residual[1])
    return first, alpha_first, second, alpha_second


@kernel
def sweep(track: Record, at: Vector, groups: Record, work: Record) -> tuple[float, int]:
    """Update a copy of the track in `work` with every row under test; returns NIS (exact for at = prior) and dof."""
    copy_track(track, work)
    state, ld = work["state"], work["ld"]
    nis, dof = 0.0, 0
    for i in range(groups.shape[0]):
        group = groups[i]
        if group["tested"] == 0:
            continue
        variance, residual, h = group["variance"], group["residual"], group["gradient"]
        if group["rows"] == 2 and variance[0] > 0.0 and variance[1] > 0.0:
            e2, alpha, f2, beta = take_pair(state, ld, at, h, residual, variance)
            nis += e2 / alpha + f2 / beta
            dof += 2
        else:
            for k in range(group["rows"]):
                if variance[k] > 0.0:
                    e2, alpha = take(state, ld, at, h[k], variance[k], residual[k])
                    nis += e2 / alpha
                    dof += 1
    return nis, dof


@kernel
def credible(track: Record, groups: Record, gate: Vector, work: Record) -> tuple[bool, float]:
    """Whether the groups under test agree with the prior and one another; their NIS."""
    nis, dof = sweep(track, track["state"], groups, work)
    return dof > 0 and nis <= gate[dof - 1], nis


@kernel
def _agreeing(track: Record, groups: Record, gate: Vector, work: Record, passing: int) -> int:
    """Shrink a contradictory set under test until it agrees; returns its size, 0 if nothing can be told.

    One group at a time is left out, the one without which the rest agree best. Two that agree are believed only if no
    other two do: two glints may.
    """
    while passing > 2:
        best, least, agreeing = -1, math.inf, 0
        for i in range(groups.shape[0]):
            if groups[i]["tested"] > 0:
                groups[i]["tested"] = 0
                good, nis = credible(track, groups, gate, work)
                groups[i]["tested"] = 1
                if good:
                    agreeing += 1
                if best < 0 or nis < least:
                    best, least = i, nis
        groups[best]["tested"] = 0
        passing -= 1
        if agreeing == 1 or (agreeing > 1 and passing > 2):
            return passing
    return 0


@straight_line(ld=(6, 6), h=("***000", "***000"), residual=(2,), variance=(2,))
def pair_nis(ld: Matrix, h: Matrix, residual: Vector, variance: Vector) -> float:
    """Squared innovation of two rows under the prior, over their covariance."""
    xx = innovation_variance(ld, h[0], h[0]) + variance[0]
    yy = innovation_variance(ld, h[1], h[1]) + variance[1]
    xy = innovation_variance(ld, h[0], h[1])
    x, y = residual[0], residual[1]
    return quotient(x * x * yy - 2.0 * x * y * xy + y * y * xx, xx * yy - xy * xy, 0.0)


@kernel
def _alone(ld: Matrix, group: Record) -> tuple[float, int]:
    """NIS and degrees of freedom of a group of two rows by itself."""
    variance, residual, h = group["variance"], group["residual"], group["gradient"]
    if variance[0] > 0.0 and variance[1] > 0.0:
        return pair_nis(ld, h, residual, variance), 2
    for k in range(2):
        if variance[k] > 0.0:
            return residual[k] ** 2 / (innovation_variance(ld, h[k], h[k]) + variance[k]), 1
    return 0.0, 0


@kernel
def gate_groups(track: Record, groups: Record, gate: Vector, work: Record, nis: float, dof: int) -> int:
    """Drop the rows of groups that are not credible; returns how many groups pass. `work` then holds the update.

    Each group must be credible alone, and those left together: while the prior is wide a glint can pass alone but
    contradict the others. nis and dof are those of all, which `work` holds.
    """
    if groups.shape[0] == 1:
        return 1 if nis <= gate[dof - 1] else 0
    passing, usable = 0, 0
    for i in range(groups.shape[0]):
        alone, numbers = _alone(track["ld"], groups[i])
        good = numbers > 0 and alone <= gate[numbers - 1]
        groups[i]["tested"] = 1 if good else 0
        usable += 1 if numbers > 0 else 0
        passing += 1 if good else 0
    if passing == usable and nis <= gate[dof - 1]:
        return passing
    if passing > 0:
        together, _ = credible(track, groups, gate, work)
        if not together:
            passing = _agreeing(track, groups, gate, work, passing)
    for i in range(groups.shape[0]):
        if passing == 0 or groups[i]["tested"] == 0:
            groups[i]["variance"][0], groups[i]["variance"][1] = 0.0, 0.0
    if passing > 0:
        sweep(track, track["state"], groups, work)
    return passing
