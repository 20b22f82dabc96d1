"""Rotation vectors: dcm exp([v x]), the v between two attitudes, and the error of an attitude.

The error of the attitude of a frame b is, in every sensor and filter, the small rotation vector theta (3,) rad in the
axes of b that turns the estimated frame into the true one (Markley and Crassidis 2014, ch. 6):

    dcm_a_from_b_true = dcm_a_from_b exp([theta x]),   dcm_b_from_a_true = exp(-[theta x]) dcm_b_from_a

so that a vector known in a has true components v_b - theta x v_b = v_b + [v_b x] theta.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel


@kernel
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


def turned(dcm: Matrix, vector: Vector) -> Matrix:
    """A rotation turned by a rotation vector: dcm exp([vector x]), (3, 3)."""
    out = np.empty((3, 3))
    turn_by_rotation_vector(np.ascontiguousarray(dcm), np.ascontiguousarray(vector), out)
    return out


def rotation_vector_between(dcm: Matrix, reference: Matrix) -> Vector:
    """Rotation vector v (3,) rad with dcm = reference exp([v x]), its length at most pi."""
    turn = np.asarray(reference).T @ np.asarray(dcm)
    sine_axis = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = math.sqrt(float(sine_axis @ sine_axis))
    cosine = 0.5 * (float(turn[0, 0] + turn[1, 1] + turn[2, 2]) - 1.0)
    if cosine > -0.9 or sine > 0.1:
        vector: Vector = sine_axis * (math.atan2(sine, cosine) / sine if sine > 1e-8 else 1.0)
        return vector
    # near half a turn the antisymmetric part vanishes; the symmetric one is cos 1 + (1 - cos) axis axis^T
    symmetric = 0.5 * (turn + turn.T) - cosine * np.eye(3)
    axis: Vector = symmetric[:, int(np.argmax(np.diag(symmetric)))]
    axis = axis / np.linalg.norm(axis)
    sign = -1.0 if float(axis @ sine_axis) < 0.0 else 1.0
    half_turn: Vector = sign * math.atan2(sine, cosine) * axis
    return half_turn


def attitude_error(dcm_b_from_a: Matrix, dcm_b_from_a_true: Matrix) -> Vector:
    """Error theta (3,) rad of the estimated attitude of a frame b, in its axes: see above."""
    return rotation_vector_between(np.asarray(dcm_b_from_a_true).T, np.asarray(dcm_b_from_a).T)
