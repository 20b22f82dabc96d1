"""Whether what is told of an epoch, beside its image, can be taken: looked at where it is taken, in compiled code."""

from relnav.arrays import LARGEST, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.rotation import are_a_rotation


@kernel
def are_credible(values: Vector) -> bool:
    """Whether three numbers are finite, and none beyond LARGEST."""
    credible: bool = values.shape[0] == 3
    for j in range(3):
        credible = credible and bool(abs(values[j]) <= LARGEST)
    return credible


@kernel
def is_an_attitude(dcm: Matrix) -> bool:
    """Whether a matrix is a rotation (3, 3)."""
    if dcm.shape[0] != 3 or dcm.shape[1] != 3:
        return False
    rotates: bool = are_a_rotation(
        dcm[0, 0], dcm[0, 1], dcm[0, 2], dcm[1, 0], dcm[1, 1], dcm[1, 2], dcm[2, 0], dcm[2, 1], dcm[2, 2]
    )
    return rotates
