"""A pair of rows that was refused for long and is used again: what was wrong with it is over, or the gate has grown.

While one spot is refused and others are used, the state knows less and less of what that spot would tell, and its gate
grows: an error that stays is at last inside it. What has come back is good where it agrees with the prediction. It is
not where it surprises, or where it lies to the side where it lay.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere, held, select
from relnav.estimation.rows import pair_covariance

LONG_S = 3.0
SURPRISE = -2.0 * math.log(0.01)
"""Chi-square of two, of a pair that comes back: a good one is beyond it once in a hundred."""
REMEMBERED, LEFT = 0.2, 0.25
"""Weight of an image in the mean of what a refused pair is off; the share of it that noise may hide, no more."""

_F = np.float64

RETURNING = [
    ("refused", _F),  # s for which it has been seen and not used
    ("off", _F, 2),  # mean of its residual over the last images that refused it
    ("surprise", _F),  # NIS of its own, where it was refused for long
]
"""Fields of what is known of a pair."""


@kernel
def note_pair(
    known: Record, ld: Matrix, gradient: Matrix, variance: Vector, covariance: float, residual: Vector, seen: bool
) -> None:
    """Note by how much a pair that is seen is off as predicted; covariance: of the noise of the two rows."""
    x, y, off = residual[0], residual[1], known["off"]
    along, length2 = x * off[0] + y * off[1], off[0] * off[0] + off[1] * off[1]
    long = seen & (known["refused"] > LONG_S)
    if anywhere(long):
        xx, xy, yy = pair_covariance(ld, gradient, variance, covariance)
        surprise = (x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy)
        known["surprise"] = select(held(long), select(along > LEFT * length2, math.inf, surprise), known["surprise"])
    weight = select(known["refused"] > 0.0, REMEMBERED, 1.0)
    for k in range(2):
        off[k] = select(seen, off[k] + weight * (residual[k] - off[k]), off[k])


@kernel
def returns_wrong(known: Record, used: bool, refused: bool, dt: float) -> bool:
    """Count how long a pair is refused, others not; whether it was for long and is used though it surprises."""
    wrong: bool = used & (known["refused"] > LONG_S) & (known["surprise"] > SURPRISE)
    known["refused"] = select(used, 0.0, select(refused, known["refused"] + dt, known["refused"]))
    return wrong
