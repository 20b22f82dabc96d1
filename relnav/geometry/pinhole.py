"""Central projection: camera axes x right, y down, z boresight; x = f X/Z, y = f Y/Z on the detector."""

import math

from relnav._kernel import kernel
from relnav.arrays import Vector


@kernel
def project(c: Vector, f: float, out: Vector) -> bool:
    """Write the image (2,) of the camera-frame point c (3,) into out, in the unit of f; False if c is not in front."""
    if not c[2] > 0.0:
        return False
    out[0] = f * c[0] / c[2]
    out[1] = f * c[1] / c[2]
    return True


@kernel
def project_jacobian_row(c: Vector, f: float, axis: int, out: Vector) -> None:
    """Write d(image coordinate `axis`)/dc into out (3,): f/Z (e_axis - (c_axis/Z) e_z)."""
    g = f / c[2]
    out[0] = 0.0
    out[1] = 0.0
    out[axis] = g
    out[2] = -g * c[axis] / c[2]


@kernel
def unit_ray(x: float, y: float, f: float, out: Vector) -> None:
    """Write the unit vector (3,) from the camera toward the point seen at (x, y) on the detector into out."""
    norm = math.sqrt(x * x + y * y + f * f)
    out[0] = x / norm
    out[1] = y / norm
    out[2] = f / norm
