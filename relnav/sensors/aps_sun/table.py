"""The run-time form of a calibration: bicubic polynomials on a grid of cells, from a spot to a unit vector.

No arctangent is needed: a spot gives tan(alpha) and tan(beta), and a square root the unit vector.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel


@dataclass(frozen=True)
class DirectionTable:
    """Tangents of the sun direction at the nodes of a grid of spots, and the bicubic spline through them.

    Attributes
    ----------
    x_px, y_px : (nx + 1,), (ny + 1,)
        Evenly spaced nodes.
    tangents : (nx + 1, ny + 1, 2)
        (tan alpha, tan beta) at the nodes.
    """

    x_px: Vector
    y_px: Vector
    tangents: Stack

    @cached_property
    def cells(self) -> Matrix:
        """Coefficients (nx, ny, 2, 4, 4): of u^i v^j, u and v from 0 to 1 across the cell."""
        from scipy.interpolate import RectBivariateSpline

        to_power = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [-3, 3, -2, -1], [2, -2, 1, 1]], dtype=np.float64)
        dx, dy = self.x_px[1] - self.x_px[0], self.y_px[1] - self.y_px[0]
        nx, ny = len(self.x_px) - 1, len(self.y_px) - 1
        out = np.empty((nx, ny, 2, 4, 4))
        for axis in range(2):
            spline = RectBivariateSpline(self.x_px, self.y_px, self.tangents[:, :, axis], s=0.0)
            corner = np.empty((nx, ny, 4, 4))  # rows: f(0), f(1), f'(0), f'(1) in u; columns likewise in v
            for order_x in range(2):
                for order_y in range(2):
                    at_nodes = spline(self.x_px, self.y_px, dx=order_x, dy=order_y) * dx**order_x * dy**order_y
                    for i in range(2):
                        for j in range(2):
                            part = at_nodes[i : nx + i, j : ny + j]
                            corner[:, :, 2 * order_x + i, 2 * order_y + j] = part
            out[:, :, axis] = to_power @ corner @ to_power.T
        return out

    @cached_property
    def grid(self) -> Vector:
        """(x of the first node, cells per px, y of the first node, cells per px)."""
        return np.array(
            [self.x_px[0], 1.0 / (self.x_px[1] - self.x_px[0]), self.y_px[0], 1.0 / (self.y_px[1] - self.y_px[0])]
        )

    def directions(self, spots_px: Matrix) -> Matrix:
        """Unit vectors (N, 3) of spots (N, 2) px; NaN outside the grid."""
        spots = np.ascontiguousarray(spots_px, dtype=np.float64)
        out = np.empty((len(spots), 3))
        nx, ny = self.cells.shape[:2]
        direction_batch(spots, self.grid, self.cells.reshape(nx * ny, 32), nx, ny, out)
        return out

    def tangents_with_slope(self, x_px: float, y_px: float) -> tuple[Vector, Matrix]:
        """(tan alpha, tan beta) (2,) at one spot and d(tangents)/d(spot px) (2, 2); NaN outside the grid."""
        u = (np.array([x_px, y_px]) - self.grid[[0, 2]]) * self.grid[[1, 3]]
        size = np.array(self.cells.shape[:2])
        if not np.all((u >= 0.0) & (u <= size)):
            return np.full(2, np.nan), np.full((2, 2), np.nan)
        cell = np.minimum(u.astype(np.int64), size - 1)
        powers = (u - cell)[:, None] ** np.arange(4)
        slopes = np.concatenate([np.zeros((2, 1)), powers[:, :3] * np.arange(1, 4)], axis=1) * self.grid[[1, 3], None]
        c = self.cells[cell[0], cell[1]]
        value = np.einsum("aij,i,j->a", c, powers[0], powers[1])
        along_x = np.einsum("aij,i,j->a", c, slopes[0], powers[1])
        along_y = np.einsum("aij,i,j->a", c, powers[0], slopes[1])
        return value, np.stack([along_x, along_y], axis=1)


@kernel
def direction_batch(spots: Matrix, grid: Vector, cells: Matrix, nx: int, ny: int, out: Matrix) -> None:
    """Write the unit vector of every spot (n, 2) px into out (n, 3); NaN outside the grid.

    cells (nx ny, 32) are those of `DirectionTable` in one row a cell; written out, because literal places in a row are
    what the compiler reads without looking at their sign.
    """
    x0, per_x, y0, per_y = grid[0], grid[1], grid[2], grid[3]
    for k in range(spots.shape[0]):
        u, v = (spots[k, 0] - x0) * per_x, (spots[k, 1] - y0) * per_y
        if not (u >= 0.0 and u <= nx and v >= 0.0 and v <= ny):
            out[k, 0] = out[k, 1] = out[k, 2] = math.nan
            continue
        i, j = min(int(u), nx - 1), min(int(v), ny - 1)
        u -= i
        v -= j
        c = cells[i * ny + j]
        tx = ((c[15] * v + c[14]) * v + c[13]) * v + c[12]
        ty = ((c[31] * v + c[30]) * v + c[29]) * v + c[28]
        tx = tx * u + ((c[11] * v + c[10]) * v + c[9]) * v + c[8]
        ty = ty * u + ((c[27] * v + c[26]) * v + c[25]) * v + c[24]
        tx = tx * u + ((c[7] * v + c[6]) * v + c[5]) * v + c[4]
        ty = ty * u + ((c[23] * v + c[22]) * v + c[21]) * v + c[20]
        tx = tx * u + ((c[3] * v + c[2]) * v + c[1]) * v + c[0]
        ty = ty * u + ((c[19] * v + c[18]) * v + c[17]) * v + c[16]
        z = 1.0 / math.sqrt(1.0 + tx * tx + ty * ty)
        out[k, 0] = tx * z
        out[k, 1] = ty * z
        out[k, 2] = z
