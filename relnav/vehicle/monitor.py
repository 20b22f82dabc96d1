"""A second filter that watches the first: the same events, but every error that lasts estimated.

Where errors are considered, innovations hang together in time, and a sum of squared ones is no chi-square. Of a filter
that estimates all of them they are white as long as the vehicle is as stated, so that their sums can be tested. Per
sensor the squared innovations of some ten seconds are added up with weights that fade,

    X = sum w NIS,   M = sum w dof,   V = sum w^2 2 dof,   w = exp(-age / FADES_S)

X is then nearly M / nu times a chi-square of nu = 2 M^2 / V degrees of freedom, and the cube root of X / M normal about
1 - 2 / (9 nu) with variance 2 / (9 nu) (Wilson and Hilferty 1931, The distribution of chi-square): a deviation above
ALARM_SIGMA is an alarm. One that ends there has a probability of 3e-6. A single observation counts for no more than the
gate lets pass: one glint is no lasting fault.

Such a sum sees whatever is odd, and a slow drift late. What `relnav.vehicle.drifts` looks for sees that.
"""

import math
from dataclasses import replace
from typing import NamedTuple

from relnav.estimation.state_layout import StateLayout

FADES_S = 10.0
ALARM_SIGMA = 4.5


class Sums(NamedTuple):
    """X, M and V of one sensor at t_s."""

    t_s: float
    nis: float = 0.0
    dof: float = 0.0
    variance: float = 0.0

    def after(self, t_s: float, nis: float, dof: int) -> "Sums":
        """The same with one observation more, the older ones faded."""
        fade = math.exp((self.t_s - t_s) / FADES_S)
        return Sums(t_s, fade * self.nis + nis, fade * self.dof + dof, fade * fade * self.variance + 2.0 * dof)

    @property
    def deviation(self) -> float:
        """How far the sum lies above what is expected, in 1-sigma; NaN before the first observation."""
        if self.dof == 0.0:
            return math.nan
        return deviation_of(self.nis / self.dof, 2.0 * self.dof**2 / self.variance)


def deviation_of(ratio: float, dof: float) -> float:
    """How far a chi-square over its degrees of freedom lies above what is expected, 1-sigma (Wilson and Hilferty)."""
    share = 2.0 / (9.0 * dof)
    return float((ratio ** (1.0 / 3.0) - 1.0 + share) / math.sqrt(share))


def all_estimated(layout: StateLayout) -> StateLayout:
    """The same errors, none of them only considered."""
    return StateLayout(tuple(replace(block, role="estimated") for block in layout.blocks))
