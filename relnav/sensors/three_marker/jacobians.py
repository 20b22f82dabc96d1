"""How the spots move with everything that can be a little off: pose, markers, camera mounting, chaser attitude."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack
from relnav.sensors.three_marker.camera import project
from relnav.sensors.three_marker.sensor import MarkerCamera


@dataclass(frozen=True)
class SpotJacobians:
    """Derivatives of n spots, px per m or rad, each (n, 2, 3); NaN for a marker that is not visible.

    Attributes
    ----------
    position : (n, 2, 3)
        By the target's position r, camera axes.
    attitude : (n, 2, 3)
        By a turn of the target, C = C_hat exp([theta x]), target axes.
    marker : (n, 2, 3)
        By the marker's own position, target axes.
    lever_arm : (n, 2, 3)
        By the camera's position in the chaser, chaser axes, chaser and target held.
    mounting : (n, 2, 3)
        By a turn of the camera, C_KB = exp(-[eps x]) C_KB_hat, camera axes, its lens held.
    chaser_attitude : (n, 2, 3)
        By a turn of the chaser about its centre of mass, C_BI = exp(-[alpha x]) C_BI_hat, chaser axes, target held.
    """

    position: Stack
    attitude: Stack
    marker: Stack
    lever_arm: Stack
    mounting: Stack
    chaser_attitude: Stack


def cross_matrix(v: Matrix) -> Stack:
    """[v x] of each row, (n, 3, 3): [v x] w = v x w."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out


def spot_jacobians(points_m: Matrix, pose: Matrix, camera: MarkerCamera) -> SpotJacobians:
    """Derivatives of the spots of markers (n, 3) m, target axes, under a pose (4, 3), rows 0-2 C, row 3 r.

    With p = C s + r and D = d(spot)/dp through the lens: dp/dr = I, dp/dtheta = -C [s x], dp/ds = C, dp/dc_B = -C_KB,
    dp/deps = [p x], dp/dalpha = C_KB [q x], q = C_KB^T p + c_B the marker from the chaser's centre of mass.
    """
    dcm, position = pose[:3], pose[3]
    p = points_m @ dcm.T + position
    D = project(p, camera).jacobian_px_m
    mount = camera.dcm_cam_from_chaser
    from_chaser = p @ mount + np.array(camera.position_m)
    return SpotJacobians(
        position=D,
        attitude=-D @ dcm @ cross_matrix(points_m),
        marker=D @ dcm,
        lever_arm=-D @ mount,
        mounting=D @ cross_matrix(p),
        chaser_attitude=D @ mount @ cross_matrix(from_chaser),
    )
