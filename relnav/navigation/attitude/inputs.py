"""A measured attitude with its covariance, looked at in one compiled call: in Python that takes longer than its use."""

from relnav.arrays import Matrix
from relnav.codegen.kernel import entry
from relnav.geometry.linear_algebra import cholesky
from relnav.navigation.told import is_an_attitude

ASYMMETRY, LEAST_PIVOT = 1e-9, 1e-12
LARGEST_RAD2 = 1e100
"""Of a measured attitude's covariance: far beyond a turn, and its products stay finite."""


@entry
def can_be_used(dcm: Matrix, covariance: Matrix, symmetric: Matrix, factor: Matrix) -> bool:
    """Whether dcm is a rotation and covariance finite, symmetric and positive definite, both (3, 3).

    Writes the covariance, symmetric to the last bit, into symmetric (3, 3); factor (3, 3) is scratch.
    """
    if covariance.shape[0] != 3 or covariance.shape[1] != 3 or not is_an_attitude(dcm):
        return False
    largest, apart = 0.0, 0.0
    for i in range(3):
        for j in range(3):
            if not (abs(covariance[i, j]) <= LARGEST_RAD2 and abs(covariance[j, i]) <= LARGEST_RAD2):  # NaN too
                return False
            symmetric[i, j] = 0.5 * (covariance[i, j] + covariance[j, i])
            largest = max(largest, abs(symmetric[i, j]))
            apart = max(apart, abs(covariance[i, j] - covariance[j, i]))
    return apart <= ASYMMETRY * largest and cholesky(symmetric, LEAST_PIVOT, factor)
