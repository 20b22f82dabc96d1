"""Whether the latest innovations together are those of a filter that knows its own covariance.

One gate sees one innovation. A state that drifts off (a rate that was told wrong, a torque that nobody told) shows in
each of them by less than the noise, and in all of them to the same side. Innovations of a right filter are independent,
but for errors that last: with y_i of covariance N_i + A_i A_i^T, A_i (3, LASTING) what one sigma of each lasting error
does to it, the sum of the latest k has the covariance

    sum N_i + (sum A_i)(sum A_i)^T

and three degrees of freedom. Every k from two to RECENT is tried: a large drift shows in few, a small one in many.
"""

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.estimation.attitude import LASTING
from relnav.geometry.linear_algebra import cholesky, solve_lower

RECENT = 12
LIMIT_PROBABILITY = 1.0 - 1e-6
"""Of a sum, to be believed: eleven a measurement, not independent, make less than one false alarm in 90,000."""

_F = np.float64

INNOVATION = np.dtype([("value", _F, 3), ("noise", _F, (3, 3)), ("lasting", _F, (3, LASTING))])
SUMS = np.dtype([("value", _F, 3), ("covariance", _F, (3, 3)), ("factor", _F, (3, 3)), ("all", INNOVATION)])
"""Scratch of `sums_are_credible`."""


@kernel
def remember_innovation(one: Record, value: Vector, covariance: Matrix, lasting: Matrix) -> None:
    """Write an innovation (3,), its whole covariance (3, 3) and its A (3, LASTING)."""
    y, noise, seen = one["value"], one["noise"], one["lasting"]
    for i in range(3):
        y[i] = value[i]
        for k in range(LASTING):
            seen[i, k] = lasting[i, k]
        for j in range(3):
            noise[i, j] = covariance[i, j]
            for k in range(LASTING):
                noise[i, j] -= lasting[i, k] * lasting[j, k]


@kernel
def sums_are_credible(recent: Record, count: int, sums: Record, limit: float) -> bool:
    """Whether every sum of the latest innovations is within a limit of chi-square; recent (RECENT,), a ring.

    count: how many were remembered, the latest at (count - 1) modulo RECENT.
    """
    value, covariance, factor, total = sums["value"], sums["covariance"], sums["factor"], sums["all"]
    y, noise, seen = total["value"], total["noise"], total["lasting"]
    for i in range(3):
        y[i] = 0.0
        for j in range(3):
            noise[i, j] = 0.0
        for k in range(LASTING):
            seen[i, k] = 0.0
    for back in range(min(count, RECENT)):
        one = recent[(count - 1 - back) % RECENT]
        for i in range(3):
            y[i] += one["value"][i]
            for j in range(3):
                noise[i, j] += one["noise"][i, j]
            for k in range(LASTING):
                seen[i, k] += one["lasting"][i, k]
        for i in range(3):
            value[i] = y[i]
            for j in range(i + 1):
                covariance[i, j] = noise[i, j]
                for k in range(LASTING):
                    covariance[i, j] += seen[i, k] * seen[j, k]
        if back > 0 and cholesky(covariance, 0.0, factor) and not solve_lower(factor, value) <= limit:
            return False
    return True
