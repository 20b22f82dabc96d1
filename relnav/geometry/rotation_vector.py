"""Rotation vectors: dcm exp([v x]), the v between two attitudes, and the error of an attitude.

The error of the attitude of a frame b is, in every sensor and filter, the small rotation vector theta (3,) rad in the
axes of b that turns the estimated frame into the true one (Markley and Crassidis 2014, ch. 6):

    dcm_a_from_b_true = dcm_a_from_b exp([theta x]),   dcm_b_from_a_true = exp(-[theta x]) dcm_b_from_a

so that a vector known in a has true components v_b - theta x v_b = v_b + [v_b x] theta.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import entry


@entry
def turn_by_rotation_vector(dcm: Matrix, v: Vector, out: Matrix) -> None:
    """Write dcm exp([v x]) into out (3, 3), which may not be dcm: Rodrigues' formula, regular at v = 0."""
    angle2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    angle = math.sqrt(angle2)
    if angle > 1e-4:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    else:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    c = 1.0 - b * angle2  # exp([v x]) = c I + a [v x] + b v v^T, c = cos(angle)
    for i in range(3):
        d0, d1, d2 = dcm[i, 0], dcm[i, 1], dcm[i, 2]
        along = b * (d0 * v[0] + d1 * v[1] + d2 * v[2])
        out[i, 0] = c * d0 + a * (d1 * v[2] - d2 * v[1]) + along * v[0]
        out[i, 1] = c * d1 + a * (d2 * v[0] - d0 * v[2]) + along * v[1]
        out[i, 2] = c * d2 + a * (d0 * v[1] - d1 * v[0]) + along * v[2]


@entry
def rotation_vector_into(dcm: Matrix, reference: Matrix, out: Vector) -> None:
    """Write the rotation vector v (3,) rad with dcm = reference exp([v x]) into out, its length at most pi."""
    trace = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = 0.0
        for r in range(3):
            out[i] += 0.5 * (reference[r, k] * dcm[r, j] - reference[r, j] * dcm[r, k])
            trace += reference[r, i] * dcm[r, i]
    sine, cosine = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]), 0.5 * (trace - 1.0)
    if cosine > -0.9 or sine > 0.1:
        scale = math.atan2(sine, cosine) / sine if sine > 1e-8 else 1.0
        for i in range(3):
            out[i] *= scale
        return
    # near half a turn the antisymmetric part vanishes; the symmetric one is cos 1 + (1 - cos) axis axis^T
    best, longest, norm2, along = 0, -2.0, 0.0, 0.0
    for i in range(3):
        own = 0.0
        for r in range(3):
            own += reference[r, i] * dcm[r, i]
        if own > longest:
            best, longest = i, own
    a0, a1, a2 = 0.0, 0.0, 0.0
    for r in range(3):
        a0 += 0.5 * (reference[r, 0] * dcm[r, best] + reference[r, best] * dcm[r, 0])
        a1 += 0.5 * (reference[r, 1] * dcm[r, best] + reference[r, best] * dcm[r, 1])
        a2 += 0.5 * (reference[r, 2] * dcm[r, best] + reference[r, best] * dcm[r, 2])
    a0 -= cosine if best == 0 else 0.0
    a1 -= cosine if best == 1 else 0.0
    a2 -= cosine if best == 2 else 0.0
    norm2 = a0 * a0 + a1 * a1 + a2 * a2
    along = a0 * out[0] + a1 * out[1] + a2 * out[2]
    size = (-1.0 if along < 0.0 else 1.0) * math.atan2(sine, cosine) / math.sqrt(norm2)
    out[0], out[1], out[2] = size * a0, size * a1, size * a2


def turned(dcm: Matrix, vector: Vector) -> Matrix:
    """A rotation turned by a rotation vector: dcm exp([vector x]), (3, 3)."""
    out = np.empty((3, 3))
    turn_by_rotation_vector(np.ascontiguousarray(dcm), np.ascontiguousarray(vector), out)
    return out


def rotation_vector_between(dcm: Matrix, reference: Matrix) -> Vector:
    """Rotation vector v (3,) rad with dcm = reference exp([v x]), its length at most pi."""
    out = np.empty(3)
    rotation_vector_into(
        np.ascontiguousarray(dcm, dtype=np.float64), np.ascontiguousarray(reference, dtype=np.float64), out
    )
    return out


def attitude_error(dcm_b_from_a: Matrix, dcm_b_from_a_true: Matrix) -> Vector:
    """Error theta (3,) rad of the estimated attitude of a frame b, in its axes: see above."""
    return rotation_vector_between(np.asarray(dcm_b_from_a_true).T, np.asarray(dcm_b_from_a).T)
