"""Range, azimuth and elevation of a point in the docking frame, with their Jacobian.

Eq. (13) of Cai, Zhao, Sun, Qiao, Dai (1996),
"Determination of target relative position and range by PSD optical sensor system":
azimuth = atan2(y, x), elevation = atan2(-z, hypot(x, y)): azimuth turns in the docking plane from the docking axis x
toward y, and elevation is positive toward -z. They are not the (elevation toward +z) angles of a textbook.
"""

import math

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import quotient


@straight_line(p=(3,), out=(3,))
def range_azimuth_elevation(p: Vector, out: Vector) -> None:
    """Write (range m, azimuth rad, elevation rad) of the docking-frame position p (3,) m into out (3,)."""
    horizontal = math.sqrt(p[0] * p[0] + p[1] * p[1])
    out[0] = math.sqrt(horizontal * horizontal + p[2] * p[2])
    out[1] = math.atan2(p[1], p[0])
    out[2] = math.atan2(-p[2], horizontal)


@straight_line(p=(3,), out=(3, 3))
def range_azimuth_elevation_jacobian(p: Vector, out: Matrix) -> bool:
    """Write d(range, azimuth, elevation)/dp into out (3, 3); False (and no meaning) at the poles x = y = 0."""
    x, y, z = p[0], p[1], p[2]
    h2 = x * x + y * y
    r2 = h2 + z * z
    regular: bool = h2 > 1e-24 * r2
    h = math.sqrt(h2)
    r = math.sqrt(r2)
    per_r, per_h2, per_h_r2 = quotient(1.0, r, 0.0), quotient(1.0, h2, 0.0), quotient(1.0, h * r2, 0.0)
    out[0, 0], out[0, 1], out[0, 2] = x * per_r, y * per_r, z * per_r
    out[1, 0], out[1, 1], out[1, 2] = -y * per_h2, x * per_h2, 0.0
    out[2, 0], out[2, 1], out[2, 2] = x * z * per_h_r2, y * z * per_h_r2, -h2 * per_h_r2
    return regular


@straight_line(p=(3,), q=(3,), out=(3,))
def docking_difference(p: Vector, q: Vector, out: Vector) -> None:
    """Write (range, azimuth, elevation) of p minus that of q into out (3,), the angles within [-pi, pi].

    Each angle as atan2 of the sine and cosine of the difference: no wrapping, no digits lost between close points.
    """
    hp, hq = math.sqrt(p[0] * p[0] + p[1] * p[1]), math.sqrt(q[0] * q[0] + q[1] * q[1])
    out[0] = math.sqrt(hp * hp + p[2] * p[2]) - math.sqrt(hq * hq + q[2] * q[2])
    out[1] = math.atan2(q[0] * p[1] - q[1] * p[0], q[0] * p[0] + q[1] * p[1])
    out[2] = math.atan2(hp * q[2] - hq * p[2], hp * hq + p[2] * q[2])


@kernel
def position_from_angles(rae: Vector, out: Vector) -> None:
    """Write the docking-frame position (3,) m of (range m, azimuth rad, elevation rad) into out; inverse of (13)."""
    cos_el = math.cos(rae[2])
    out[0] = rae[0] * cos_el * math.cos(rae[1])
    out[1] = rae[0] * cos_el * math.sin(rae[1])
    out[2] = -rae[0] * math.sin(rae[2])


@kernel
def position_from_angles_jacobian(p: Vector, out: Matrix) -> bool:
    """Write dp/d(range, azimuth, elevation) at the position p into out (3, 3); False at the poles x = y = 0."""
    x, y, z = p[0], p[1], p[2]
    h = math.sqrt(x * x + y * y)
    r = math.sqrt(h * h + z * z)
    if not h > 1e-12 * r:
        return False
    out[0, 0], out[0, 1], out[0, 2] = x / r, -y, x * z / h
    out[1, 0], out[1, 1], out[1, 2] = y / r, x, y * z / h
    out[2, 0], out[2, 1], out[2, 2] = z / r, 0.0, -h
    return True
