"""How the spots move with everything that can be a little off: pose, markers, camera mounting, chaser attitude."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from relnav.arrays import Matrix, Stack
from relnav.geometry.linear_algebra import cross_matrix
from relnav.sensors.three_marker.camera import project
from relnav.sensors.three_marker.sensor import MarkerCamera


@dataclass(frozen=True)
class SpotJacobians:
    """Derivatives of n spots, px per m or rad, each (n, 2, 3) and computed on request.

    With p = C s + r and D = d(spot)/dp through the lens: dp/dr = I, dp/dtheta = -C [s x], dp/ds = C, dp/dc_B = -C_KB,
    dp/deps = [p x], dp/dalpha = C_KB [q x], q = C_KB^T p + c_B the marker from the chaser's centre of mass.

    Attributes
    ----------
    position : (n, 2, 3)
        D, by the target's position r, camera axes.
    points_m, in_camera_m : (n, 3)
        s and p.
    dcm_cam_from_target : (3, 3)
        C.
    camera : MarkerCamera
    """

    position: Stack
    points_m: Matrix
    in_camera_m: Matrix
    dcm_cam_from_target: Matrix
    camera: MarkerCamera

    @cached_property
    def marker(self) -> Stack:
        """(n, 2, 3) by the marker's own position, target axes."""
        by_marker: Stack = self.position @ self.dcm_cam_from_target
        return by_marker

    @property
    def attitude(self) -> Stack:
        """(n, 2, 3) by a turn of the target, C = C_hat exp([theta x]), target axes."""
        by_attitude: Stack = -self.marker @ cross_matrix(self.points_m)
        return by_attitude

    @property
    def lever_arm(self) -> Stack:
        """(n, 2, 3) by the camera's position in the chaser, chaser axes, chaser and target held."""
        by_lever: Stack = -self.position @ self.camera.dcm_cam_from_chaser
        return by_lever

    @property
    def mounting(self) -> Stack:
        """(n, 2, 3) by a turn of the camera, C_KB = exp(-[eps x]) C_KB_hat, camera axes, its lens held."""
        by_mounting: Stack = self.position @ cross_matrix(self.in_camera_m)
        return by_mounting

    @property
    def chaser_attitude(self) -> Stack:
        """(n, 2, 3) by a turn of the chaser about its centre of mass, C_BI = exp(-[alpha x]) C_BI_hat, chaser axes."""
        mount = self.camera.dcm_cam_from_chaser
        from_chaser = self.in_camera_m @ mount + np.array(self.camera.position_m)
        by_chaser: Stack = self.position @ mount @ cross_matrix(from_chaser)
        return by_chaser


def spot_jacobians(points_m: Matrix, pose: Matrix, camera: MarkerCamera) -> SpotJacobians:
    """Derivatives of the spots of markers (n, 3) m, target axes, under a pose (4, 3), rows 0-2 C, row 3 r.

    NaN for a marker that is not visible.
    """
    p = points_m @ pose[:3].T + pose[3]
    return SpotJacobians(project(p, camera).jacobian_px_m, points_m, p, pose[:3], camera)
