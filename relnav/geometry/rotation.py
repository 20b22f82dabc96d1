"""Rotations: v_b = dcm @ v_a for a dcm named `dcm_b_from_a`; quaternions Hamilton, scalar last (as in scipy)."""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector, numbers
from relnav.codegen.kernel import entry, kernel, plain


def dcm_from_quaternion(quaternion: Vector, name: str = "") -> Matrix:
    """Rotation matrix (3, 3) of a unit quaternion (x, y, z, w); a message says its name.

    Raises
    ------
    ValueError
        If the quaternion is not finite or its norm is off 1 by more than 1e-3 (it is then normalised).
    """
    q, of = np.asarray(quaternion, dtype=np.float64), f"{name}: " if name else ""
    if q.shape != (4,):
        raise ValueError(f"{of}a quaternion has four components (x, y, z, w); got shape {q.shape}")
    out = np.empty((3, 3))
    if not dcm_from_quaternion_into(q, out):
        raise ValueError(f"{of}a rotation quaternion (x, y, z, w) has norm 1 within 1e-3; got {q.tolist()}")
    return out


def is_rotation(dcm: Matrix) -> bool:
    """Whether a matrix is a rotation (3, 3): finite, orthonormal to 1e-6 in every entry, determinant +1."""
    return dcm.shape == (3, 3) and plain(are_a_rotation)(*dcm.ravel().tolist())


def rotation(name: str, value: ArrayLike) -> Matrix:
    """A caller's rotation matrix (3, 3).

    Raises
    ------
    ValueError
        For another shape, and what is not orthonormal, as `is_rotation` says.
    """
    dcm = numbers(name, value)
    if not is_rotation(dcm):
        raise ValueError(f"{name} is a rotation matrix (3, 3); got {dcm.tolist()}")
    return dcm


@kernel
def are_a_rotation(a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float) -> bool:
    """Whether the rows (a, b, c), (d, e, f), (g, h, i) are a rotation, as `is_rotation` says."""
    lengths = max(abs(a * a + b * b + c * c - 1.0), abs(d * d + e * e + f * f - 1.0), abs(g * g + h * h + i * i - 1.0))
    angles = max(abs(a * d + b * e + c * f), abs(a * g + b * h + c * i), abs(d * g + e * h + f * i))
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    finite = math.isfinite(a + b + c + d + e + f + g + h + i)  # else max may pass a NaN over
    return finite and lengths < 1e-6 and angles < 1e-6 and determinant > 0.0


def quaternion_from_dcm(dcm: Matrix) -> Vector:
    """Unit quaternion (x, y, z, w), w >= 0, of a rotation matrix (3, 3): the column of 4 q q^T with the largest square.

    Raises
    ------
    ValueError
        If the matrix is not a rotation to 1e-6.
    """
    R = np.asarray(dcm, dtype=np.float64)
    if not is_rotation(R):
        raise ValueError(f"a rotation matrix (3, 3) is expected; got {R.tolist()}")
    q = np.empty((1, 4))
    plain(quaternions_from_dcm_into)(R[None], q)
    found: Vector = q[0]
    return found


@entry
def quaternions_from_dcm_into(dcm: Stack, out: Matrix) -> None:
    """Write the quaternions (n, 4), w >= 0, of rotations (n, 3, 3); NaN where they are."""
    for k in range(dcm.shape[0]):
        R, q, best = dcm[k], out[k], 0
        q[0], q[1] = 1.0 + R[0, 0] - R[1, 1] - R[2, 2], 1.0 - R[0, 0] + R[1, 1] - R[2, 2]
        q[2], q[3] = 1.0 - R[0, 0] - R[1, 1] + R[2, 2], 1.0 + R[0, 0] + R[1, 1] + R[2, 2]
        for i in range(1, 4):
            best = i if q[i] > q[best] else best
        largest = q[best]
        w = (R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
        for i in range(3):
            q[i] = w[i] if best == 3 else R[i, best] + R[best, i]
        q[3] = 0.0 if best == 3 else w[best]
        q[best] = largest
        size = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        size = -size if q[3] < 0.0 else size
        for i in range(4):
            q[i] /= size


@entry
def dcm_from_quaternion_into(q: Vector, out: Matrix) -> bool:
    """Write the rotation matrix of the quaternion q (4,), normalised, into out; False if its norm is not near 1."""
    norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if not (0.998 < norm2 < 1.002):
        return False
    s = 2.0 / norm2
    x, y, z, w = q[0], q[1], q[2], q[3]
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)
    out[1, 0], out[1, 1], out[1, 2] = s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)
    out[2, 0], out[2, 1], out[2, 2] = s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)
    return True


@kernel
def triad(primary: Vector, secondary: Vector, out: Matrix) -> bool:
    """Write into the rows of out (3, 3) the right-handed triad of two vectors: along the first, then in their plane.

    False if the vectors are parallel to rounding. Two such triads of the same pair, seen in frames a and b, give
    dcm_b_from_a = triad_b^T triad_a (Black 1964).
    """
    n1 = math.sqrt(primary[0] ** 2 + primary[1] ** 2 + primary[2] ** 2)
    if not n1 > 0.0:
        return False
    for i in range(3):
        out[0, i] = primary[i] / n1
    along = secondary[0] * out[0, 0] + secondary[1] * out[0, 1] + secondary[2] * out[0, 2]
    n2 = 0.0
    for i in range(3):
        out[1, i] = secondary[i] - along * out[0, i]
        n2 += out[1, i] ** 2
    n2 = math.sqrt(n2)
    n = math.sqrt(secondary[0] ** 2 + secondary[1] ** 2 + secondary[2] ** 2)
    if not n2 > 1e-12 * n:
        return False
    for i in range(3):
        out[1, i] /= n2
    out[2, 0] = out[0, 1] * out[1, 2] - out[0, 2] * out[1, 1]
    out[2, 1] = out[0, 2] * out[1, 0] - out[0, 0] * out[1, 2]
    out[2, 2] = out[0, 0] * out[1, 1] - out[0, 1] * out[1, 0]
    return True
