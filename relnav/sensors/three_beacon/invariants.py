"""What three rays say whatever the camera's attitude: three signed numbers, regular on the docking axis.

    g1 = |u_A - u_B|^2,   g2 = u_C . (u_A - u_B),   g3 = u_C . (u_A x u_B)

of the unit rays to the beacons. They do not change when the camera turns, so g(rays measured) = g(rays from p) is
three equations for the position p alone. On the axis their gradients are along x, y and z: range, azimuth and
elevation, each with its sign (angles between the rays alone lose the sign of elevation and its first order).
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import straight_line


@straight_line(u=(3, 3), g=(3,))
def invariants(u: Matrix, g: Vector) -> None:
    """Write (g1, g2, g3) of the unit rays u (rows A, B, C; three columns used) into g (3,)."""
    g[0] = 0.0
    g[1] = 0.0
    for i in range(3):
        d = u[0, i] - u[1, i]
        g[0] += d * d
        g[1] += u[2, i] * d
    g[2] = (
        u[2, 0] * (u[0, 1] * u[1, 2] - u[0, 2] * u[1, 1])
        + u[2, 1] * (u[0, 2] * u[1, 0] - u[0, 0] * u[1, 2])
        + u[2, 2] * (u[0, 0] * u[1, 1] - u[0, 1] * u[1, 0])
    )


def invariant_gradients(u: Matrix, out: Matrix) -> None:
    """Write d g[number] / d u[beacon] into the rows 3 number + beacon of out (9, 3). A part of what follows.

    Of g1: 2 (u_A - u_B), -2 (u_A - u_B), 0; of g2: u_C, -u_C, u_A - u_B; of g3 = det(u_A, u_B, u_C): u_B x u_C,
    u_C x u_A, u_A x u_B.
    """
    for i in range(3):
        d = u[0, i] - u[1, i]
        out[0, i], out[1, i], out[2, i] = 2.0 * d, -2.0 * d, 0.0
        out[3, i], out[4, i], out[5, i] = u[2, i], -u[2, i], d
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        out[6 + i, 0] = u[j, 1] * u[k, 2] - u[j, 2] * u[k, 1]
        out[6 + i, 1] = u[j, 2] * u[k, 0] - u[j, 0] * u[k, 2]
        out[6 + i, 2] = u[j, 0] * u[k, 1] - u[j, 1] * u[k, 0]


@straight_line(p=(3,), u=(3, 3), distance=(3,))
def rays_from_position(p: Vector, a: float, b: float, u: Matrix, distance: Vector) -> None:
    """Write the unit rays (docking axes) from p (3,) m to beacons A, B, C into u, and their lengths into distance."""
    for i in range(3):
        v0 = (b if i == 2 else 0.0) - p[0]
        v1 = (a if i == 0 else (-a if i == 1 else 0.0)) - p[1]
        v2 = -p[2]
        d = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        near = 1.0 / d
        distance[i] = d
        u[i, 0], u[i, 1], u[i, 2] = v0 * near, v1 * near, v2 * near


@straight_line(u=(3, 3), distance=(3,), out=(9, 3))
def beacon_gradients(u: Matrix, distance: Vector, out: Matrix) -> None:
    """Write d g[number] / d beacon into the rows 3 number + beacon of out: du_i/db_i = (I - u_i u_i^T) / d_i."""
    gradients = np.zeros((9, 3))
    invariant_gradients(u, gradients)
    for number in range(3):
        for i in range(3):
            g = gradients[3 * number + i]
            along = g[0] * u[i, 0] + g[1] * u[i, 1] + g[2] * u[i, 2]
            near = 1.0 / distance[i]
            for j in range(3):
                out[3 * number + i, j] = (g[j] - along * u[i, j]) * near


@straight_line(u=(3, 3), distance=(3,), out=(3, 3))
def position_gradient(u: Matrix, distance: Vector, out: Matrix) -> None:
    """Write dg/dp into out (3, 3): it moves against all beacons."""
    by_beacon = np.zeros((9, 3))
    beacon_gradients(u, distance, by_beacon)
    for number in range(3):
        for j in range(3):
            total = 0.0
            for i in range(3):
                total -= by_beacon[3 * number + i, j]
            out[number, j] = total


@straight_line(u=(3, 3), out=(3, 6))
def spot_gradient(u: Matrix, f: float, out: Matrix) -> None:
    """Write dg/d(A'x, A'y, B'x, B'y, C'x, C'y) into out (3, 6), for camera-frame rays u, per unit of f.

    du/dx_j = (e_j - u u_j) u_z / f.
    """
    gradients = np.zeros((9, 3))
    invariant_gradients(u, gradients)
    for number in range(3):
        for i in range(3):
            g = gradients[3 * number + i]
            along = g[0] * u[i, 0] + g[1] * u[i, 1] + g[2] * u[i, 2]
            scale = u[i, 2] / f
            out[number, 2 * i] = (g[0] - along * u[i, 0]) * scale
            out[number, 2 * i + 1] = (g[1] - along * u[i, 1]) * scale
