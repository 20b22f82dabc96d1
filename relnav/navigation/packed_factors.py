"""The factors L D L^T of a covariance as tracks keep them: their lower triangle row by row, D on its diagonal."""

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import square, straight_line
from relnav.codegen.trace import Shape
from relnav.dynamics.error_state import factor_size


def _packed(n: int) -> Shape:
    return (factor_size(n),)


@straight_line(ld=square, packed=_packed)
def pack_factors(ld: Matrix, packed: Vector) -> None:
    """Write the lower triangle of ld (n, n) into packed (n (n + 1) / 2,)."""
    at = 0
    for i in range(ld.shape[0]):
        for j in range(i + 1):
            packed[at] = ld[i, j]
            at += 1


@straight_line(ld=square, packed=_packed)
def unpack_factors(packed: Vector, ld: Matrix) -> None:
    """Write packed factors (n (n + 1) / 2,) into the lower triangle of ld (n, n)."""
    at = 0
    for i in range(ld.shape[0]):
        for j in range(i + 1):
            ld[i, j] = packed[at]
            at += 1
