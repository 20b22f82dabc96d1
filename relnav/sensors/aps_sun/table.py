"""The run-time form of a calibration: bicubic polynomials on a grid of cells, from a spot to a unit vector.

No arctangent is needed: a spot gives tan(alpha) and tan(beta), and a square root the unit vector.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel


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
        """(4,): x of the first node px, cells per px, y of the first node px, cells per px."""
        return np.array(
            [self.x_px[0], 1.0 / (self.x_px[1] - self.x_px[0]), self.y_px[0], 1.0 / (self.y_px[1] - self.y_px[0])]
        )

    def directions(self, spots_px: Matrix) -> Matrix:
        """Unit vectors (N, 3) of spots (N, 2) px; NaN outside the grid."""
        spots = np.ascontiguousarray(spots_px, dtype=np.float64)
        out = np.empty((len(spots), 3))
        nx, ny = self.cells.shape[:2]
        direction_batch(spots, self.grid, self._rows, nx, ny, out)
        return out

    def tangents_with_slope(self, x_px: float, y_px: float) -> Matrix:
        """(2, 3) at one spot, rows alpha and beta: the tangent and its derivatives by x and y, 1/px; NaN outside."""
        out = np.empty((2, 3))
        nx, ny = self.cells.shape[:2]
        tangents_into(x_px, y_px, self.grid, self._rows, nx, ny, out)
        return out

    def direction_of(self, x_px: float, y_px: float, xx: float, xy: float, yy: float) -> Matrix:
        """(8, 3): what `direction_into` writes of a spot and its covariance px^2, then its tangents and their slope."""
        out = np.empty((8, 3))
        nx, ny = self.cells.shape[:2]
        spot_into(x_px, y_px, xx, xy, yy, self.grid, self._rows, nx, ny, out)
        return out

    @cached_property
    def _rows(self) -> Matrix:
        """The cells as the kernels read them, (nx ny, 32)."""
        return self.cells.reshape(-1, 32)


@kernel
def bicubic(c: Vector, first: int, u: float, v: float) -> tuple[float, float, float]:
    """Value of sum c_ij u^i v^j, 16 coefficients from `first` on, and its derivatives by u and v: Horner's scheme."""
    value, along_u, along_v = 0.0, 0.0, 0.0
    for step in range(4):
        k = first + 12 - 4 * step
        along_u = along_u * u + value
        value = value * u + ((c[k + 3] * v + c[k + 2]) * v + c[k + 1]) * v + c[k]
        along_v = along_v * u + (3.0 * c[k + 3] * v + 2.0 * c[k + 2]) * v + c[k + 1]
    return value, along_u, along_v


@kernel
def tangents_into(x: float, y: float, grid: Vector, cells: Matrix, nx: int, ny: int, out: Matrix) -> None:
    """Write (tan alpha, tan beta) of a spot and their derivatives into out (2, 3); NaN outside the grid."""
    u, v = (x - grid[0]) * grid[1], (y - grid[2]) * grid[3]
    if not (u >= 0.0 and u <= nx and v >= 0.0 and v <= ny):
        for axis in range(2):
            out[axis, 0] = out[axis, 1] = out[axis, 2] = math.nan
        return
    i, j = min(int(u), nx - 1), min(int(v), ny - 1)
    for axis in range(2):
        value, along_u, along_v = bicubic(cells[i * ny + j], 16 * axis, u - i, v - j)
        out[axis, 0], out[axis, 1], out[axis, 2] = value, along_u * grid[1], along_v * grid[3]


@kernel
def direction_into(tangents: Matrix, xx: float, xy: float, yy: float, out: Matrix) -> None:
    """Write a direction, its derivatives and its covariance into out (6, 3).

    tangents (2, 3) as of `tangents_into`; xx, xy, yy px^2 of the spot. Row 0 is the unit vector s = (t, 1) / |(t, 1)|,
    rows 1 and 2 D = ds/d(x, y) = (I - s s^T) dt / |(t, 1)|, rows 3 to 5 the covariance D R D^T.
    """
    a, b = tangents[0, 0], tangents[1, 0]
    z = 1.0 / math.sqrt(1.0 + a * a + b * b)
    out[0, 0], out[0, 1], out[0, 2] = a * z, b * z, z
    for axis in range(2):
        da, db = tangents[0, 1 + axis], tangents[1, 1 + axis]
        along = z * (a * da + b * db)
        out[1 + axis, 0] = z * (da - a * z * along)
        out[1 + axis, 1] = z * (db - b * z * along)
        out[1 + axis, 2] = -z * z * along
    for i in range(3):
        p, q = xx * out[1, i] + xy * out[2, i], xy * out[1, i] + yy * out[2, i]
        for j in range(3):
            out[3 + i, j] = p * out[1, j] + q * out[2, j]


@entry
def spot_into(
    x: float, y: float, xx: float, xy: float, yy: float, grid: Vector, cells: Matrix, nx: int, ny: int, out: Matrix
) -> None:
    """`tangents_into` rows 6 and 7 of out (8, 3), and of them `direction_into` rows 0 to 5."""
    tangents_into(x, y, grid, cells, nx, ny, out[6:8])
    direction_into(out[6:8], xx, xy, yy, out)


@kernel
def direction_batch(spots: Matrix, grid: Vector, cells: Matrix, nx: int, ny: int, out: Matrix) -> None:
    """Write the unit vector of every spot (n, 2) px into out (n, 3); NaN outside the grid.

    cells (nx ny, 32) are those of `DirectionTable` in one row a cell.
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
        tx = bicubic(cells[i * ny + j], 0, u, v)[0]
        ty = bicubic(cells[i * ny + j], 16, u, v)[0]
        z = 1.0 / math.sqrt(1.0 + tx * tx + ty * ty)
        out[k, 0] = tx * z
        out[k, 1] = ty * z
        out[k, 2] = z
