"""What the filter uses of the last image, as matrices, for other estimators: the reference engine, steady states."""

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.navigation.block import (
    GRADIENT,
    JACOBIAN,
    OBSERVED,
    POSITION,
    R_FACTOR,
    RESIDUAL,
    VARIANCE,
    H,
    beacon_count,
    beacon_row,
)
from relnav.navigation.sight import uses_coordinates


def rows_in_use(block: Matrix) -> tuple[Matrix, Vector, Matrix, Codes]:
    """What the last image gave, as matrices: H (m, 6), residuals (m,), R (m, m), and the group of each row (m,).

    Residuals and rows are those of the measured values themselves, correlated as R says.
    """
    if not uses_coordinates(block):
        size = int(np.sum(block[VARIANCE, :3] > 0.0))
        lower = np.tril(block[R_FACTOR : R_FACTOR + size, :size], -1) + np.eye(size)
        r = lower @ np.diag(block[VARIANCE, :size]) @ lower.T
        return lower @ block[H : H + size], block[RESIDUAL, 3 : 3 + size].copy(), r, np.zeros(size, dtype=np.int64)
    h, residual, variance, groups = [], [], [], []
    for i in range(beacon_count(block)):
        row = beacon_row(block, i)
        for k in range(2):
            if block[row + OBSERVED, 2 + k] > 0.0:
                h.append(block[row + GRADIENT + k].copy())
                residual.append(block[row + OBSERVED, k])
                variance.append(block[row + OBSERVED, 2 + k])
                groups.append(i)
    return np.array(h).reshape(-1, 6), np.array(residual), np.diag(variance), np.array(groups, dtype=np.int64)


def lasting_in_use(block: Matrix) -> Matrix:
    """What one sigma of each coordinate's lasting error does to the numbers of `rows_in_use`, (rows, m)."""
    count = beacon_count(block)
    sigma = np.repeat([block[beacon_row(block, i) + POSITION, 5] for i in range(count)], 2)
    if not uses_coordinates(block):
        size = int(np.sum(block[VARIANCE, :3] > 0.0))
        errors = np.zeros((size, 2 * count))
        errors[:, :6] = block[JACOBIAN : JACOBIAN + size] * sigma[:6]
        return errors
    used = [block[beacon_row(block, i) + OBSERVED, 2 + k] > 0.0 for i in range(count) for k in range(2)]
    rows: Matrix = np.diag(sigma)[used]
    return rows
