"""What a sensor says about the errors of a vehicle's state: rows, in groups that a gate takes or leaves as one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Rows:
    """Rows about n errors; those of k filters side by side have the filter as another axis before all.

    Attributes
    ----------
    residual : (m,)
        Measured less predicted; NaN where there is nothing to be used.
    jacobian : (m, n)
        d(measured)/d(errors).
    noise : (m, m)
        Covariance of the measurement's noise, of independent groups.
    group : int
        Rows a group: 2 of a spot or a sun direction, 3 of an attitude.
    """

    residual: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    noise: NDArray[np.float64]
    group: int


def empty_rows(filters: int, rows: int, errors: int, group: int) -> Rows:
    """Rows of several filters to be written, zero so far."""
    residual, noise = np.zeros((filters, rows)), np.zeros((filters, rows, rows))
    return Rows(residual, np.zeros((filters, rows, errors)), noise, group)
