"""What one image says besides the position: the camera's attitude in the docking frame, with the covariance of both.

Six coordinates of three spots determine six numbers. The closed form gives the three of the position; the turn that
takes the rays from there, in docking axes, into the measured ones is the attitude (Black 1964, `triad`), exactly, as
the position has made their invariants equal. The covariance is that of the inverse: with c = C (b - p) of beacon b,

    ds = f / c_z (I | -s / f) dc,   dc = C (-dp + theta x (b - p)),   (dp, theta) = H^-1 ds,   P = s^2 H^-1 H^-T,

the true attitude being C exp([theta x]), theta in docking axes (`relnav.geometry.rotation_vector`).
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation import triad
from relnav.sensors.measurement import NOT_IMPLIED, ImpliedPose
from relnav.sensors.three_beacon.fix import image_rays
from relnav.sensors.three_beacon.invariants import rays_from_position
from relnav.sensors.three_beacon.sensor import ThreeBeaconSensor


@kernel
def turn_of_rays(rays: Matrix, p: Vector, a: float, b: float, dcm: Matrix, work: Matrix) -> bool:
    """Write into dcm the rotation that turns the rays from p (3,) to the beacons, docking axes, into rays (3, 3).

    False where the rays do not determine it. work (14, 3) is scratch.
    """
    seen, distance = work[0:3], work[3]
    rays_from_position(p, a, b, seen, distance)
    for j in range(3):
        work[4, j] = seen[0, j] - seen[1, j]
        work[5, j] = seen[0, j] + seen[1, j]
        work[6, j] = rays[0, j] - rays[1, j]
        work[7, j] = rays[0, j] + rays[1, j]
    if not triad(work[4], work[5], work[8:11]) or not triad(work[6], work[7], work[11:14]):
        return False
    for i in range(3):
        for j in range(3):
            dcm[i, j] = 0.0
            for k in range(3):
                dcm[i, j] += work[11 + k, i] * work[8 + k, j]
    return True


def implied_pose(spots_m: Matrix, sensor: ThreeBeaconSensor, noise_m: float, position_m: Vector) -> ImpliedPose:
    """Attitude and covariance of an image (3, 2) m whose exact fix is position_m (3,), docking frame.

    noise_m: 1-sigma of each spot coordinate.
    """
    a, b, f = sensor.beacon_half_spacing_m, sensor.beacon_c_distance_m, sensor.focal_length_m
    rays, dcm = np.empty((3, 3)), np.empty((3, 3))
    image_rays(spots_m, f, rays)
    if not turn_of_rays(rays, position_m, a, b, dcm, np.empty((14, 3))):
        return NOT_IMPLIED
    place = sensor.beacons_dock_m[:3] - position_m
    seen = place @ dcm.T
    to_spot = np.zeros((3, 2, 3))
    to_spot[:, 0, 0] = to_spot[:, 1, 1] = f / seen[:, 2]
    to_spot[:, :, 2] = -f * seen[:, :2] / seen[:, 2:] ** 2
    by_pose = np.concatenate([np.broadcast_to(-dcm, (3, 3, 3)), -dcm @ cross_matrix(place)], axis=2)
    back = noise_m * np.linalg.inv((to_spot @ by_pose).reshape(6, 6))
    dcm.setflags(write=False)
    return ImpliedPose(dcm, back @ back.T)
