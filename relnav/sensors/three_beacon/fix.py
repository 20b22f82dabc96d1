"""One image to one position: check the spots, choose the closed form, map spot noise into the result."""

import math

import numpy as np

from relnav._kernel import kernel
from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.geometry.pinhole import unit_ray
from relnav.geometry.spherical import range_azimuth_elevation, range_azimuth_elevation_jacobian
from relnav.sensors.measurement import DEGENERATE, NOT_SEEN, OFF_DETECTOR, OK
from relnav.sensors.three_beacon.parallel import solve_parallel, solve_parallel_jacobian
from relnav.sensors.three_beacon.perspective import position_jacobian, solve_perspective

PERSPECTIVE = 0
PARALLEL = 1
# Rows of scratch that the closed forms need: the solver's 24, then rays, Jacobians, position
RAYS_ROW = 24
WORK_ROWS = 33
MEASURE_ROWS = 37


@kernel
def coordinate_usable(value: float, half_size: float) -> bool:
    """Whether a spot coordinate is a number on the detector (false for NaN and infinity too)."""
    return abs(value) <= half_size


@kernel
def solve_fix(
    spots: Matrix, f: float, half_x: float, half_y: float, a: float, b: float, projection: int, p: Vector, work: Matrix
) -> int:
    """Write the sensor's docking-frame position (3,) m of the spots (3, 2) m into p; returns a Status code.

    half_x, half_y: half the detector's size, m. work (33, 6) is scratch; rows 24-26 then hold the unit rays.
    """
    status = OK
    for i in range(3):
        for j in range(2):
            value = spots[i, j]
            if value != value:
                return NOT_SEEN
            if not coordinate_usable(value, half_x if j == 0 else half_y):
                status = OFF_DETECTOR
    if status != OK:
        return status
    for i in range(3):
        unit_ray(spots[i, 0], spots[i, 1], f, work[RAYS_ROW + i])
    if projection == PARALLEL:
        return solve_parallel(spots, f, a, b, p)
    return solve_perspective(work[RAYS_ROW : RAYS_ROW + 3], a, b, p, work[0:24])


@kernel
def perspective_jacobian(p: Vector, u: Matrix, f: float, a: float, b: float, jacobian: Matrix, work: Matrix) -> bool:
    """Write d(range, azimuth, elevation)/d(spots) of the exact fix p with camera-frame rays u into jacobian (3, 6).

    False where singular. work (33, 6) is scratch; rows 24-26 are left alone.
    """
    to_angles, to_position = work[27:30], work[30:33]
    if not range_azimuth_elevation_jacobian(p, to_angles):
        return False
    if not position_jacobian(p, u, f, a, b, to_position, work[0:22]):
        return False
    for i in range(3):
        for k in range(6):
            jacobian[i, k] = (
                to_angles[i, 0] * to_position[0, k]
                + to_angles[i, 1] * to_position[1, k]
                + to_angles[i, 2] * to_position[2, k]
            )
    return True


@kernel
def fix_jacobian(
    p: Vector, spots: Matrix, f: float, a: float, b: float, projection: int, jacobian: Matrix, work: Matrix
) -> bool:
    """Write d(range, azimuth, elevation)/d(A'x, A'y, B'x, B'y, C'x, C'y) at the fix p of the spots; False if singular.

    jacobian (3, 6): m or rad per m on the detector. work (33, 6) is scratch.
    """
    if projection == PARALLEL:
        return solve_parallel_jacobian(spots, f, a, b, jacobian)
    for i in range(3):
        unit_ray(spots[i, 0], spots[i, 1], f, work[RAYS_ROW + i])
    return perspective_jacobian(p, work[RAYS_ROW : RAYS_ROW + 3], f, a, b, jacobian, work)


@kernel
def measure_into(
    spots: Matrix,
    f: float,
    half_x: float,
    half_y: float,
    sigma: float,
    a: float,
    b: float,
    projection: int,
    rae: Vector,
    covariance: Matrix,
    work: Matrix,
) -> int:
    """Write (range m, azimuth rad, elevation rad) and its covariance sigma^2 J J^T; returns a Status code.

    rae (3,), covariance (3, 3); work (37, 6) is scratch. sigma: 1-sigma of each spot coordinate, m.
    """
    p = work[33]
    jacobian = work[34:37]
    status = solve_fix(spots, f, half_x, half_y, a, b, projection, p, work)
    if status != OK:
        return status
    if not fix_jacobian(p, spots, f, a, b, projection, jacobian, work):
        return DEGENERATE
    range_azimuth_elevation(p, rae)
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(6):
                total += jacobian[i, k] * jacobian[j, k]
            covariance[i, j] = sigma * sigma * total
    return OK


@kernel
def measure_batch(
    spots: Stack,
    f: float,
    half_x: float,
    half_y: float,
    sigma: float,
    a: float,
    b: float,
    projection: int,
    rae: Matrix,
    covariance: Stack,
    status: Codes,
) -> None:
    """`measure_into` over images (n, 3, 2): rae (n, 3), covariance (n, 3, 3), status (n,); NaN where not OK."""
    work = np.zeros((MEASURE_ROWS, 6))
    for e in range(spots.shape[0]):
        status[e] = measure_into(spots[e], f, half_x, half_y, sigma, a, b, projection, rae[e], covariance[e], work)
        if status[e] != OK:
            for i in range(3):
                rae[e, i] = math.nan
                for j in range(3):
                    covariance[e, i, j] = math.nan
