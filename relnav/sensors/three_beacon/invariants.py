"""What three rays say whatever the camera's attitude: three signed numbers, regular on the docking axis.

    g1 = |u_A - u_B|^2,   g2 = u_C . (u_A - u_B),   g3 = u_C . (u_A x u_B)

of the unit rays to the beacons. They do not change when the camera turns, so g(rays measured) = g(rays from p) is
three equations for the position p alone. On the axis their gradients are along x, y and z: range, azimuth and
elevation, each with its sign (angles between the rays alone lose the sign of elevation and its first order).
"""

import math

from relnav._kernel import kernel
from relnav.arrays import Matrix, Vector


@kernel
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


@kernel
def invariant_gradient(u: Matrix, number: int, beacon: int, out: Vector) -> None:
    """Write d g[number] / d u[beacon] into out (3,)."""
    j = (beacon + 1) % 3
    m = (beacon + 2) % 3
    for axis in range(3):
        if number == 0:  # g1: +-2 (u_A - u_B)
            d = 2.0 * (u[0, axis] - u[1, axis])
            out[axis] = d if beacon == 0 else (-d if beacon == 1 else 0.0)
        elif number == 1:  # g2: u_C, -u_C, u_A - u_B
            own = u[0, axis] - u[1, axis]
            out[axis] = own if beacon == 2 else (u[2, axis] if beacon == 0 else -u[2, axis])
        else:  # g3 = det(u_A, u_B, u_C): the cross product of the next two rays
            s = (axis + 1) % 3
            t = (axis + 2) % 3
            out[axis] = u[j, s] * u[m, t] - u[j, t] * u[m, s]


@kernel
def rays_from_position(p: Vector, a: float, b: float, u: Matrix, distance: Vector) -> None:
    """Write the unit rays (docking axes) from p (3,) m to beacons A, B, C into u, and their lengths into distance."""
    for i in range(3):
        v0 = (b if i == 2 else 0.0) - p[0]
        v1 = (a if i == 0 else (-a if i == 1 else 0.0)) - p[1]
        v2 = -p[2]
        d = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        distance[i] = d
        u[i, 0], u[i, 1], u[i, 2] = v0 / d, v1 / d, v2 / d


@kernel
def position_gradient(u: Matrix, distance: Vector, out: Matrix, work: Vector) -> None:
    """Write dg/dp into out (3, 3): du_i/dp = -(I - u_i u_i^T) / d_i. work (3,) scratch."""
    for number in range(3):
        for axis in range(3):
            out[number, axis] = 0.0
        for i in range(3):
            invariant_gradient(u, number, i, work)
            along = work[0] * u[i, 0] + work[1] * u[i, 1] + work[2] * u[i, 2]
            for axis in range(3):
                out[number, axis] -= (work[axis] - along * u[i, axis]) / distance[i]


@kernel
def spot_gradient(u: Matrix, f: float, out: Matrix, work: Vector) -> None:
    """Write dg/d(A'x, A'y, B'x, B'y, C'x, C'y) into out (3, 6), for camera-frame rays u, per unit of f.

    du/dx_j = (e_j - u u_j) u_z / f (geometry.pinhole.unit_ray). work (3,) scratch.
    """
    for number in range(3):
        for i in range(3):
            invariant_gradient(u, number, i, work)
            along = work[0] * u[i, 0] + work[1] * u[i, 1] + work[2] * u[i, 2]
            for axis in range(2):
                out[number, 2 * i + axis] = (work[axis] - along * u[i, axis]) * u[i, 2] / f


@kernel
def solve_three(m: Matrix, rhs: Vector, out: Vector) -> bool:
    """Solve m (3, 3) out = rhs (3,) by cofactors; False if m is singular to rounding of its rows' lengths."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c01 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c02 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    det = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    scale = 1.0
    for i in range(3):
        scale *= math.sqrt(m[i, 0] * m[i, 0] + m[i, 1] * m[i, 1] + m[i, 2] * m[i, 2])
    if not abs(det) > 1e-10 * scale:
        return False
    r0, r1, r2 = rhs[0], rhs[1], rhs[2]
    out[0] = (
        c00 * r0 + (m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2]) * r1 + (m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]) * r2
    ) / det
    out[1] = (
        c01 * r0 + (m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]) * r1 + (m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]) * r2
    ) / det
    out[2] = (
        c02 * r0 + (m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]) * r1 + (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) * r2
    ) / det
    return True
