"""The measurement update: what a sensor says as rows, gated group by group, taken in on the factors of P = L D L^T.

A sensor writes groups: residuals z - h(x), gradient rows, and variances of their noise (0 = row not used), where a
group is what the gate takes or leaves as one: a spot, or a whole fix. Nothing here knows a sensor.

Noise of different groups may be correlated (what turns all spots of an image together): the sensor then writes its
covariance R as a whole, and the rows in use are made independent, L^-1 z and L^-1 H with R = L diag L^T, each time
another choice of groups is asked about.

The gate asks of each group, and of all that pass together, whether their squared innovation under the prior is
credible; NIS is that of everything seen, before the gate, from the same innovation covariance as the gain.
"""

import math
from typing import NamedTuple

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, square, straight_line, variant, vector
from relnav.codegen.together import anywhere, held, quotient, select
from relnav.codegen.trace import Shape
from relnav.estimation.factored import innovation_variance, scalar_update


def row_pattern(n: int) -> Shape:
    """A row of an image: it sees positions and attitudes, every first half of six states, not their rates."""
    return "***000" * (n // 6)


def _seen_twice(n: int) -> Shape:
    return "***000" * (n // 6), "***000" * (n // 6)


def track_type(n: int) -> np.dtype[np.void]:
    """A track: its state, and the factors of the covariance of its n errors."""
    return np.dtype([("state", np.float64, n), ("ld", np.float64, (n, n))])


def group_type(n: int) -> np.dtype[np.void]:
    """A group of at most three rows about n errors.

    residual z - h(x), of the independent rows; variance of their noise, 0 = not used; gradient dh/dx; innovation, of
    the numbers as they were measured; spread, variance of each row's innovation when it was taken in; rows, how many
    there are; tested, whether the gate has not left the group out.
    """
    number, whole = np.float64, np.int64
    return np.dtype(
        [
            ("residual", number, 3),
            ("variance", number, 3),
            ("gradient", number, (3, n)),
            ("innovation", number, 3),
            ("spread", number, 3),
            ("rows", whole),
            ("tested", whole),
        ]
    )


@straight_line(from_state=vector, from_ld=square, state=vector, ld=square)
def copy_numbers(from_state: Vector, from_ld: Matrix, state: Vector, ld: Matrix) -> None:
    """Copy a state and the lower triangle of its factors."""
    for i in range(ld.shape[0]):
        state[i] = from_state[i]
        for j in range(i + 1):
            ld[i, j] = from_ld[i, j]


@kernel
def copy_rows(source: Matrix, target: Matrix) -> None:
    """Copy rows."""
    for c in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[c, j] = source[c, j]


@kernel
def copy_track(source: Record, target: Record) -> None:
    """Copy a track: state and the lower triangle of its factors."""
    copy_numbers(source["state"], source["ld"], target["state"], target["ld"])


@straight_line(state=vector, ld=square, at=vector, h=row_pattern)
def take(state: Vector, ld: Matrix, at: Vector, h: Vector, variance: float, residual: float) -> tuple[float, float]:
    """Update a track with one row, linearised at `at`; returns its squared innovation and the innovation's variance."""
    e = residual
    for j in range(state.shape[0]):
        e = e - h[j] * (state[j] - at[j])
    return e * e, scalar_update(state, ld, h, variance, e)


@straight_line(state=vector, ld=square, at=vector, h=_seen_twice, residual=(2,))
def take_pair(
    state: Vector, ld: Matrix, at: Vector, h: Matrix, residual: Vector, variance_first: float, variance_second: float
) -> tuple[float, float, float, float]:
    """`take` two rows."""
    first, alpha_first = take(state, ld, at, h[0], variance_first, residual[0])
    second, alpha_second = take(state, ld, at, h[1], variance_second, residual[1])
    return first, alpha_first, second, alpha_second


@kernel
def say_nothing(group: Record, where: bool) -> None:
    """Let the rows of a group say nothing, where that is so of one run, and another goes on with them."""
    if anywhere(where):
        residual, gradient = group["residual"], group["gradient"]
        for k in range(group["rows"]):
            residual[k] = select(where, 0.0, residual[k])
            for j in range(gradient.shape[1]):
                gradient[k, j] = select(where, 0.0, gradient[k, j])


@kernel
def give_back(track: Record, work: Record, where: bool) -> None:
    """Let the update in work be the track as it was, where that is so of one run, and others are updated."""
    if anywhere(where):
        for i in range(track["state"].shape[0]):
            work["state"][i] = select(where, track["state"][i], work["state"][i])
            for j in range(i + 1):
                work["ld"][i, j] = select(where, track["ld"][i, j], work["ld"][i, j])


class Observed(NamedTuple):
    """What an image says: groups (g,); and where their noise is correlated, R of all rows, group after group.

    noise (2 g, 2 g) of groups of two rows, factor (2 g, 2 g) and independent (g,) scratch; of size zero where the
    groups are independent as they are.
    """

    groups: Record
    noise: Matrix
    factor: Matrix
    independent: Record


@kernel
def _make_independent(seen: Observed) -> bool:
    """Write the rows under test as independent ones; False if their covariance is not positive definite."""
    groups, r, factor, out = seen.groups, seen.noise, seen.factor, seen.independent
    for i in range(2 * groups.shape[0]):
        group, own, k = groups[i // 2], out[i // 2], i % 2
        own["tested"], own["rows"] = group["tested"], 2
        own["variance"][k] = 0.0
        if group["tested"] == 0 or not group["variance"][k] > 0.0:
            continue
        d, residual, h = r[i, i], group["residual"][k], own["gradient"][k]
        for c in range(h.shape[0]):
            h[c] = group["gradient"][k, c]
        for j in range(i):
            if not out[j // 2]["variance"][j % 2] > 0.0:
                continue
            total = r[i, j]
            for m in range(j):
                if out[m // 2]["variance"][m % 2] > 0.0:
                    total -= factor[i, m] * factor[j, m] * out[m // 2]["variance"][m % 2]
            before = out[j // 2]
            factor[i, j] = total / before["variance"][j % 2]
            d -= factor[i, j] * total
            residual -= factor[i, j] * before["residual"][j % 2]
            for c in range(h.shape[0]):
                h[c] -= factor[i, j] * before["gradient"][j % 2, c]
        if not d > 0.0:
            return False
        own["variance"][k], own["residual"][k] = d, residual
    return True


@kernel
def sweep(track: Record, at: Vector, seen: Observed, work: Record) -> tuple[float, int]:
    """Update a copy of the track in `work` with every row under test; returns NIS (exact for at = prior) and dof.

    NIS is infinite where the rows' noise is not positive definite; nothing is then taken in.
    """
    copy_track(track, work)
    state, ld = work["state"], work["ld"]
    nis, dof = 0.0, 0
    groups = seen.groups
    if seen.noise.shape[0] > 0:
        if not _make_independent(seen):
            return math.inf, 1
        groups = seen.independent
    for i in range(groups.shape[0]):
        group = groups[i]
        tested = group["tested"] > 0
        if not anywhere(tested):
            continue
        variance, residual, h, spread = group["variance"], group["residual"], group["gradient"], group["spread"]
        first, second = variance[0] > 0.0, variance[1] > 0.0
        if group["rows"] == 2 and ((first & second) | (not (first | second))):
            taken = tested & first
            if anywhere(taken):  # of a run that does not take them in the rows say nothing (`say_nothing`)
                taken = held(taken)
                own_first, own_second = select(taken, variance[0], 1.0), select(taken, variance[1], 1.0)
                e2, alpha, f2, beta = take_pair(state, ld, at, h, residual, own_first, own_second)
                spread[0], spread[1] = alpha, beta
                nis += e2 / alpha + f2 / beta
                dof = select(taken, dof + 2, dof)
            continue
        begin, end = 0, group["rows"]
        if group["rows"] == 2:  # one coordinate
            begin, end = (0, 1) if first else (1, 2)
        for k in range(begin, end):
            taken = tested & (variance[k] > 0.0)
            if anywhere(taken):
                taken = held(taken)
                e2, alpha = take(state, ld, at, h[k], select(taken, variance[k], 1.0), residual[k])
                spread[k] = alpha
                nis += e2 / alpha
                dof = select(taken, dof + 1, dof)
    return nis, dof


@kernel
def log_determinant(seen: Observed) -> float:
    """Of the innovation covariance of all rows that the last sweep took in, of correlated groups."""
    total = 0.0
    for i in range(seen.groups.shape[0]):
        if seen.independent[i]["tested"] > 0:
            total += math.log(seen.independent[i]["spread"][0]) + math.log(seen.independent[i]["spread"][1])
    return total


@kernel
def credible(track: Record, seen: Observed, gate: Vector, work: Record) -> tuple[bool, float]:
    """Whether the groups under test agree with the prior and one another; their NIS."""
    nis, dof = sweep(track, track["state"], seen, work)
    return (dof > 0) & (nis <= gate[dof - 1]), nis


@kernel
def _agreeing(track: Record, seen: Observed, gate: Vector, work: Record, passing: int) -> int:
    """Shrink a contradictory set under test until it agrees; returns its size, 0 if nothing can be told.

    One group at a time is left out, the one without which the rest agree best. Two that agree are believed only if no
    other two do: two glints may.
    """
    groups = seen.groups
    while passing > 2:
        best, least, agreeing = -1, math.inf, 0
        for i in range(groups.shape[0]):
            if groups[i]["tested"] > 0:
                groups[i]["tested"] = 0
                good, nis = credible(track, seen, gate, work)
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


own_variance = variant(innovation_variance, "own_variance", h1=row_pattern, h2=row_pattern)
"""Of what the prior says of a row, given twice."""


@straight_line(ld=square, h=_seen_twice, residual=(2,), variance=(2,))
def pair_nis(ld: Matrix, h: Matrix, residual: Vector, variance: Vector) -> float:
    """Squared innovation of two rows under the prior, over their covariance."""
    xx = innovation_variance(ld, h[0], h[0]) + variance[0]
    yy = innovation_variance(ld, h[1], h[1]) + variance[1]
    xy = innovation_variance(ld, h[0], h[1])
    x, y = residual[0], residual[1]
    return quotient(x * x * yy - 2.0 * x * y * xy + y * y * xx, xx * yy - xy * xy, 0.0)


@straight_line(ld=square, h=_seen_twice, variance=(2,))
def pair_covariance(ld: Matrix, h: Matrix, variance: Vector, covariance: float) -> tuple[float, float, float]:
    """Innovation covariance (xx, xy, yy) of two rows; covariance: that of their noise."""
    xx = innovation_variance(ld, h[0], h[0]) + variance[0]
    yy = innovation_variance(ld, h[1], h[1]) + variance[1]
    return xx, innovation_variance(ld, h[0], h[1]) + covariance, yy


@kernel
def _alone(ld: Matrix, seen: Observed, i: int) -> tuple[float, int]:
    """NIS and degrees of freedom of a group of two rows by itself."""
    group = seen.groups[i]
    variance, residual, h = group["variance"], group["residual"], group["gradient"]
    first, second = variance[0] > 0.0, variance[1] > 0.0
    if not anywhere(first | second):
        return 0.0, 0
    if (first & second) | (not (first | second)):
        if seen.noise.shape[0] == 0:
            return pair_nis(ld, h, residual, variance), select(first, 2, 0)
        xx, xy, yy = pair_covariance(ld, h, variance, seen.noise[2 * i, 2 * i + 1])
        x, y = residual[0], residual[1]
        return (x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy), select(first, 2, 0)
    k = 0 if first else 1
    return residual[k] ** 2 / (innovation_variance(ld, h[k], h[k]) + variance[k]), 1


@kernel
def gate_groups(track: Record, seen: Observed, gate: Vector, work: Record, nis: float, dof: int) -> int:
    """Leave groups out that are not credible; returns how many groups pass. `work` then holds the update.

    Each group must be credible alone, and those left together: while the prior is wide a glint can pass alone but
    contradict the others. nis and dof are those of all, which `work` holds.
    """
    groups = seen.groups
    if groups.shape[0] == 1:
        good = nis <= gate[dof - 1]
        groups[0]["tested"] = select(good, 1, 0)
        if anywhere(good):
            say_nothing(groups[0], not held(good))
        return select(good, 1, 0)
    passing, usable = 0, 0
    for i in range(groups.shape[0]):
        alone, numbers = _alone(track["ld"], seen, i)
        good = (numbers > 0) & (alone <= gate[numbers - 1])
        groups[i]["tested"] = select(good, 1, 0)
        usable, passing = select(numbers > 0, usable + 1, usable), select(good, passing + 1, passing)
        if anywhere(good):
            say_nothing(groups[i], not held(good))
    if not anywhere(not ((passing == usable) & (nis <= gate[dof - 1]))):
        return passing
    together = False
    if passing > 0:
        together, _ = credible(track, seen, gate, work)
        if not together:
            passing = _agreeing(track, seen, gate, work, passing)
    for i in range(groups.shape[0]):
        out = (passing == 0) | (groups[i]["tested"] == 0)
        groups[i]["tested"] = select(out, 0, 1)
        if seen.noise.shape[0] == 0:
            variance = groups[i]["variance"]
            variance[0], variance[1] = select(out, 0.0, variance[0]), select(out, 0.0, variance[1])
    if passing > 0 and not together:
        sweep(track, track["state"], seen, work)
    return passing
