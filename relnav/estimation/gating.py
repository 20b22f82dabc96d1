"""Chi-square limits: how large a squared innovation may be before it is not believed.

Written out, because scipy.special alone takes as long to import as a filter takes to its first estimate.
"""

import math
from functools import cache

from relnav.arrays import Vector


def chi_square_tail(value: float, dof: int) -> float:
    """Probability that a chi-square variable with dof degrees of freedom exceeds a value.

    It is Q(dof / 2, value / 2), the regularised incomplete gamma function: from Q(1/2, z) = erfc(sqrt z) or
    Q(1, z) = exp(-z), by Q(a + 1, z) = Q(a, z) + z^a exp(-z) / Gamma(a + 1) (NIST DLMF, 8.8.6).
    """
    z = 0.5 * value
    if not z > 0.0:
        return 1.0
    a, tail = (0.5, math.erfc(math.sqrt(z))) if dof % 2 else (1.0, math.exp(-z))
    while a < 0.5 * dof:
        tail += math.exp(a * math.log(z) - z - math.lgamma(a + 1.0))
        a += 1.0
    return tail


@cache
def chi_square_limit(probability: float, dof: int) -> float:
    """Value that a chi-square variable with dof degrees of freedom stays below with the given probability.

    Raises
    ------
    ValueError
        Unless 0 < probability < 1 and dof >= 1.
    """
    if not 0.0 < probability < 1.0 or dof < 1:
        raise ValueError(f"0 < probability < 1 and dof >= 1 are expected; got {probability!r}, {dof!r}")
    rest, low, high = 1.0 - probability, 0.0, 1.0
    while chi_square_tail(high, dof) > rest:
        low, high = high, 2.0 * high
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if chi_square_tail(middle, dof) > rest else (low, middle)
    return high


def gate_limits(gate_probability: float, most_dof: int = 6) -> Vector:
    """Limits for 1 .. most_dof degrees of freedom, (most_dof,)."""
    import numpy as np

    return np.array([chi_square_limit(gate_probability, dof) for dof in range(1, most_dof + 1)])
