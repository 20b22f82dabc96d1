"""Roll, pitch and yaw of a camera that faces a docking target, as of aircraft.

They are those of the camera's forward, right and down (its z, x, y) from the same three of a camera that looks along
the docking axis at O with its y along z of the docking frame. Yaw about down, then pitch about right, then roll about
forward (3-2-1): positive to the right, up, and right side down.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector

_FORWARD_RIGHT_DOWN_FROM_CAM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_FACING_FROM_DOCK = np.diag([-1.0, -1.0, 1.0])
"""Forward, right and down of a camera that looks along the docking axis."""
_LEVEL = 1e-6
"""Cosine of the pitch below which roll and yaw are one turn."""


def roll_pitch_yaw(dcm_cam_from_dock: Matrix) -> Vector:
    """Roll, pitch and yaw of an attitude (3, 3), rad, (3,)."""
    facing_from_camera = (_FORWARD_RIGHT_DOWN_FROM_CAM @ dcm_cam_from_dock @ _FACING_FROM_DOCK.T).T
    (c, _, _), (s, _, _), (down, roll_sine, roll_cosine) = facing_from_camera.tolist()
    return np.array([math.atan2(roll_sine, roll_cosine), math.atan2(-down, math.hypot(c, s)), math.atan2(s, c)])


def roll_pitch_yaw_jacobian(angles: Vector) -> Matrix:
    """d(roll, pitch, yaw) / d theta, (3, 3), theta in docking axes; NaN where the camera looks straight up or down.

    With R = Rz(yaw) Ry(pitch) Rx(roll) of facing axes from the camera's, dR = [w x] R and w = -facing_from_dock theta.
    """
    _, pitch, yaw = angles.tolist()
    c, s, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    if not abs(cp) > _LEVEL:
        return np.full((3, 3), np.nan)
    by_angles = np.array([[c * cp, -s, 0.0], [s * cp, c, 0.0], [-sp, 0.0, 1.0]])
    out: Matrix = np.linalg.solve(by_angles, -_FACING_FROM_DOCK)
    return out
