"""What a sensor says about the errors of a vehicle's state: rows, in groups that a gate takes or leaves as one."""

from dataclasses import dataclass

from relnav.arrays import Matrix, Vector


@dataclass(frozen=True)
class Rows:
    """Rows about n errors.

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

    residual: Vector
    jacobian: Matrix
    noise: Matrix
    group: int
