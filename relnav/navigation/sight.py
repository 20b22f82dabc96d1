"""Where the camera and the beacons are for a state, and whether a fix can be believed there."""

import math

from relnav._kernel import kernel
from relnav.arrays import Matrix, Vector
from relnav.navigation.block import ATTITUDE, BEACONS, CLOCK, DOCK, SENSOR, SETTINGS, SPOTS, WORK
from relnav.sensors.measurement import MISALIGNED, OK, SWAPPED
from relnav.sensors.three_beacon.fix import RAYS_ROW, WORK_ROWS, solve_fix
from relnav.sensors.three_beacon.invariants import rays_from_position

# Rows of WORK; the first belong to the closed form
P_DOCK = WORK + WORK_ROWS
JACOBIAN = P_DOCK + 1  # 3 rows
LOCAL = P_DOCK + 4  # 3 rows
RAYS = P_DOCK + 7  # 3 rows
POINT = P_DOCK + 10
IMAGE = P_DOCK + 11


@kernel
def attitude_known(block: Matrix) -> bool:
    """Whether the camera's attitude may be used."""
    return bool(block[SETTINGS, 2] > 0.0)


@kernel
def uses_coordinates(block: Matrix) -> bool:
    """Whether the measurement is the detector coordinates themselves, one group a beacon."""
    return bool(block[SETTINGS, 1] == SPOTS and block[SETTINGS, 2] > 0.0)


@kernel
def camera_position_dock(block: Matrix, x: Vector, p: Vector) -> None:
    """Write the camera's position in the docking frame of the state x into p (3,): lever arms included."""
    s0, s1, s2 = x[0], x[1], x[2]
    for k in range(3):
        lever = block[ATTITUDE + k, 3]
        s0 += block[ATTITUDE + k, 0] * lever
        s1 += block[ATTITUDE + k, 1] * lever
        s2 += block[ATTITUDE + k, 2] * lever
    s0 -= block[DOCK, 3]
    s1 -= block[DOCK + 1, 3]
    s2 -= block[DOCK + 2, 3]
    for k in range(3):
        p[k] = block[DOCK + k, 0] * s0 + block[DOCK + k, 1] * s1 + block[DOCK + k, 2] * s2


@kernel
def beacon_in_camera(block: Matrix, x: Vector, beacon: int, c: Vector) -> None:
    """Write beacon `beacon` in camera axes, seen from the camera of the state x, into c (3,)."""
    d0, d1, d2 = block[BEACONS + beacon, 0] - x[0], block[BEACONS + beacon, 1] - x[1], block[BEACONS + beacon, 2] - x[2]
    for k in range(3):
        c[k] = (
            block[ATTITUDE + k, 0] * d0
            + block[ATTITUDE + k, 1] * d1
            + block[ATTITUDE + k, 2] * d2
            - block[ATTITUDE + k, 3]
        )


COS_MISALIGNED = 0.984807753012208  # 10 deg


@kernel
def fix_of_spots(block: Matrix, spots: Matrix, p: Vector) -> int:
    """Closed form of the spots into p (3,) m, docking frame; a Status code.

    Where the attitude is known, the camera attitude that the fix implies must be the stated one to 10 deg, by the line
    from B to A and the line of sight: far more than any attitude hold is off, far less than a glint or a pair of
    exchanged beacons turns the image.
    """
    sensor = block[SENSOR]
    projection = int(block[SETTINGS, 0])
    work = block[WORK : WORK + WORK_ROWS]
    status = solve_fix(spots, sensor[0], sensor[1], sensor[2], sensor[4], sensor[5], projection, p, work)
    if status != OK or not attitude_known(block):
        return status
    rays_from_position(p, sensor[4], sensor[5], work[0:3], work[3])
    along, across = 0.0, 0.0  # of A - B and of A + B: measured against predicted, camera axes
    d2, o2, e2, q2 = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        d, o = 0.0, 0.0
        for j in range(3):
            axis = 0.0  # dcm_cam_from_dock[k, j]
            for m in range(3):
                axis += block[ATTITUDE + k, m] * block[DOCK + j, m]
            d += axis * (work[0, j] - work[1, j])
            o += axis * (work[0, j] + work[1, j])
        e, q = work[RAYS_ROW, k] - work[RAYS_ROW + 1, k], work[RAYS_ROW, k] + work[RAYS_ROW + 1, k]
        along += d * e
        across += o * q
        d2, o2, e2, q2 = d2 + d * d, o2 + o * o, e2 + e * e, q2 + q * q
    if along > COS_MISALIGNED * math.sqrt(d2 * e2) and across > COS_MISALIGNED * math.sqrt(o2 * q2):
        return OK
    return SWAPPED if along < 0.0 else MISALIGNED


@kernel
def prior_is_tight(block: Matrix, x: Vector) -> bool:
    """Whether the predicted geometry can stand for the true one: position sigma below 2 % of the range."""
    p = block[POINT]
    camera_position_dock(block, x, p)
    return bool(block[CLOCK, 5] < 4e-4 * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]))
