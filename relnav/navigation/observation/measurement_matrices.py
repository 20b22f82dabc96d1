"""What the filter uses of the last image, as matrices, for steady states; and errors of a detector's field."""

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.navigation.blocks import NODES
from relnav.navigation.memory import Memory
from relnav.navigation.observation.beacon_geometry import uses_coordinates


def rows_in_use(m: Memory) -> tuple[Matrix, Vector, Matrix, Codes]:
    """What the last image gave, as matrices: H (k, 6), residuals (k,), R (k, k), and the group of each row (k,).

    Residuals and rows are those of the measured values themselves, correlated as R says.
    """
    groups = m.groups
    if not uses_coordinates(m.sensor):
        variance = groups["variance"][0]
        size = int(np.sum(variance > 0.0))
        lower = np.tril(m.fix["factor"][:size, :size], -1) + np.eye(size)
        r = lower @ np.diag(variance[:size]) @ lower.T
        innovation = groups["innovation"][0, :size].copy()
        return lower @ groups["gradient"][0, :size], innovation, r, np.zeros(size, dtype=np.int64)
    beacon, axis = np.nonzero(groups["variance"][:, :2] > 0.0)
    h, residual = groups["gradient"][beacon, axis], groups["residual"][beacon, axis]
    turns = m.sensor["attitude_noise"] * m.turns[2 * beacon + axis]
    together = turns @ turns.T
    np.fill_diagonal(together, groups["variance"][beacon, axis])  # the attitude's noise is in them
    return h, residual, together, beacon


def field_errors(spots_m: Matrix, center_m: Vector, half_width_m: Vector, sigma_m: Vector) -> Matrix:
    """What one sigma of each node of a detector's field does to every coordinate, (2 n, nodes of x and of y) m.

    spots_m (n, 2), NaN = anywhere; box of the field (2,), (2,); sigma_m (n,) of each spot's coordinates.
    """
    u = np.clip((np.nan_to_num(spots_m) - center_m) / half_width_m, -1.0, 1.0)
    distance = np.abs(0.5 * (NODES - 1) * (u[..., None] + 1.0) - np.arange(NODES))  # (n, 2, NODES)
    weights = np.maximum(0.0, 1.0 - distance)
    weights /= np.linalg.norm(weights, axis=-1, keepdims=True)
    of_spot = np.einsum("ni,nj->nij", weights[:, 0], weights[:, 1]).reshape(len(spots_m), -1) * sigma_m[:, None]
    errors = np.zeros((len(spots_m), 2, 2, NODES * NODES))
    errors[:, 0, 0], errors[:, 1, 1] = of_spot, of_spot
    return errors.reshape(2 * len(spots_m), -1)
