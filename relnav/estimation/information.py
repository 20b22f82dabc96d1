"""What an update tells of three errors: by how much the ellipsoid of their covariance shrinks, nats."""

import math

from relnav.arrays import Matrix
from relnav.codegen.kernel import kernel


@kernel
def information_gained(before: float, after: float) -> float:
    """Half the logarithm by which the squared volume (`squared_volume`) of an ellipsoid of errors shrank, nats."""
    return 0.5 * math.log(max(before / after, 1e-300))


@kernel
def squared_volume(P: Matrix, at: int) -> float:
    """Determinant of three rows and columns of a covariance."""
    a, b, c = P[at, at], P[at, at + 1], P[at, at + 2]
    d, e, f = P[at + 1, at + 1], P[at + 1, at + 2], P[at + 2, at + 2]
    return float(a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d))
