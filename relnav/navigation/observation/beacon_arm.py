"""What the noise of the attitude does to a fix: it swings the arm from the chaser's centre of mass to the camera.

A fix is where the camera is, whatever the attitude; the state is the centre of mass. Turns of sigma about every axis
move the end of an arm l by the covariance sigma^2 (|l|^2 I - l l^T).
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.estimation.factored import decorrelate
from relnav.geometry.spherical import range_azimuth_elevation_jacobian
from relnav.navigation.memory import Memory


@kernel
def swings(m: Memory) -> bool:
    """Whether there is both: noise of the attitude, and an arm."""
    mount = m.kept["mount"]
    return bool(m.sensor["attitude_noise"] > 0.0 and (mount[0, 3] != 0.0 or mount[1, 3] != 0.0 or mount[2, 3] != 0.0))


@kernel
def arm_covariance(m: Memory, out: Matrix) -> None:
    """Write the covariance (3, 3) m^2 of the arm's end, axes of `lvlh_ccsds`."""
    mount, arm, length2 = m.kept["mount"], m.scratch["vectors"][3], 0.0
    for i in range(3):
        arm[i] = mount[0, i] * mount[0, 3] + mount[1, i] * mount[1, 3] + mount[2, i] * mount[2, 3]
        length2 += arm[i] * arm[i]
    variance = m.sensor["attitude_noise"] ** 2
    for i in range(3):
        for j in range(3):
            out[i, j] = -variance * arm[i] * arm[j]
        out[i, i] += variance * length2


@straight_line(p=(3,), dock=(3, 4), moved=(3, 3), factor=(3, 3), variances=(3,))
def with_arm_noise(p: Vector, dock: Matrix, moved: Matrix, factor: Matrix, variances: Vector) -> bool:
    """Write L and d of L diag(d) L^T + A moved A^T; A: range, azimuth and elevation at p by the place, `lvlh_ccsds`."""
    to_angles, by_place, r = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    regular = range_azimuth_elevation_jacobian(p, to_angles)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                by_place[i, j] += to_angles[i, k] * dock[k, j]
    for i in range(3):
        for j in range(i + 1):
            r[i, j] = variances[j] if i == j else factor[i, j] * variances[j]
            for k in range(j):
                r[i, j] += factor[i, k] * factor[j, k] * variances[k]
            for k in range(3):
                for n in range(3):
                    r[i, j] += by_place[i, k] * moved[k, n] * by_place[j, n]
    return regular & decorrelate(r, factor, variances)


@kernel
def add_arm_noise(m: Memory, p: Vector, factor: Matrix, variances: Vector) -> bool:
    """Add it to L and d of the noise of a fix at p (3,), docking frame, in range, azimuth and elevation."""
    if not swings(m):
        return True
    moved = m.scratch["pair"]
    arm_covariance(m, moved)
    return with_arm_noise(p, m.kept["dock"], moved, factor, variances)
