"""Protection with one sensor, gyro or thrusters at fault: a filter without each in turn, beside the one that is told.

A fault of a sensor, whatever it is and since whenever, is not in the filter that never took it. With d the estimate
less that of the filter without sensor s, and sigma_s of the latter, the error along an axis is at most

    |e| <= |d| + |e_s|,     |e_s| <= k_s sigma_s

so that max(k_0 sigma_0, max over s of |d_s| + k_s sigma_s) bounds it (solution separation, Brown and McBurney 1988,
Self-contained GPS integrity check using maximum solution separation; Brenner 1996, Integrated GPS/inertial fault
detection availability; with the separation as it is instead of its threshold). The probability is shared equally among
"nothing is at fault" and each sensor, gyro and thrusters among them. The filter without the gyro assumes a chaser that
is held in the orbital frame, with a rate that walks as while a gyro is lost. The one without the thrusters takes no
command, be it true or not: in place of the slow acceleration it expects one as of a target that manoeuvres (Singer
1970, Estimating optimal tracking filter performance for manned maneuvering targets), Gauss-Markov in `lvlh_ccsds`,
`lasts_s` long. Its 1-sigma is all that thrusters can give, `largest_m_s2`: Singer's where they push as hard as they can
all the time, as a valve stuck open does. It is told nothing of thrust at all, so that its level holds for one that is
weaker, stronger or turned, and for one that nobody ordered.

Two at fault at once are not covered. After a lock-out an image opens the search in all filters, also in that without
its sensor; but about its pose they know so little (`acquisition`) that the images of others alone say where the target
is. Which of several poses it was has been decided by all.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from relnav.arrays import Vector
from relnav.errors import UsageError
from relnav.vehicle.port import PortState, checked_probability
from relnav.vehicle.rows import Rows

FAULT_PROBABILITY = 1e-3
"""Assumed of each sensor, the gyro and the thrusters in an approach."""


def hide(rows: Rows, filters: Sequence[int]) -> Rows:
    """The rows, with nothing to be used in some filters, in place."""
    for f in filters:
        rows.residual[f] = np.nan
    return rows


def protection_level_m(
    port: PortState, without: Mapping[str, PortState], probability: float, fault_probability: float
) -> Vector:
    """The bound of above along each target axis, (3,) m.

    Parameters
    ----------
    port, without : PortState, mapping
        As told; of the filters without each, by its name.
    probability : float
        Of an error beyond it, an axis.
    fault_probability : float
        Of a fault of each.

    Raises
    ------
    UsageError
        Without such filters, and for what is no probability.
    """
    from scipy.special import ndtri

    if not without:
        raise UsageError("no filter without a sensor was flown: VehicleNavigator(vehicle, separation=True) does")
    share = checked_probability("probability", probability) / (1.0 + len(without))
    fault = checked_probability("fault_probability", fault_probability, may_be_one=True)
    level: Vector = -ndtri(0.5 * share) * port.sigma[:3]
    k = max(0.0, -float(ndtri(min(0.5, 0.5 * share / fault))))
    for other in without.values():
        level = np.maximum(level, np.abs(port.position_m - other.position_m) + k * other.sigma[:3])
    return level
