"""One image to one position: check the spots, choose the closed form, map spot noise into the result."""

import math

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import select
from relnav.geometry.spherical import range_azimuth_elevation, range_azimuth_elevation_jacobian
from relnav.sensors.measurement import DEGENERATE, NOT_SEEN, OFF_DETECTOR, OK
from relnav.sensors.three_beacon.parallel import solve_parallel, solve_parallel_jacobian
from relnav.sensors.three_beacon.perspective import position_jacobian, solve_perspective

PERSPECTIVE = 0
PARALLEL = 1
# Rows of scratch that the closed forms need: the solver's 12, then rays; `measure_into` adds position and Jacobian
RAYS_ROW = 12
COORDINATES = 6
"""Of the three spots that a closed form takes."""
WORK_ROWS = 15
MEASURE_ROWS = 19


@kernel
def image_usable(spots: Matrix, half_x: float, half_y: float) -> int:
    """Whether all three spots (3, 2) m are seen and on the detector; a Status code."""
    seen, inside = True, True
    for i in range(3):
        x, y = spots[i, 0], spots[i, 1]
        seen = seen & (x == x) & (y == y)
        inside = inside & (abs(x) <= half_x) & (abs(y) <= half_y)
    return select(inside, OK, select(seen, OFF_DETECTOR, NOT_SEEN))


@straight_line(spots=(3, 2), u=(3, 3))
def image_rays(spots: Matrix, f: float, u: Matrix) -> None:
    """Write the unit rays (3, 3), camera axes, toward the spots (3, 2) into u."""
    for i in range(3):
        x, y = spots[i, 0], spots[i, 1]
        norm = math.sqrt(x * x + y * y + f * f)
        u[i, 0], u[i, 1], u[i, 2] = x / norm, y / norm, f / norm


@kernel
def solve_fix(
    spots: Matrix, f: float, half_x: float, half_y: float, a: float, b: float, projection: int, p: Vector, work: Matrix
) -> int:
    """Write the sensor's docking-frame position (3,) m of the spots (3, 2) m into p; returns a Status code.

    half_x, half_y: half the detector's size, m. work (15, 6) is scratch; rows 12-14 then hold the unit rays.
    """
    status = image_usable(spots, half_x, half_y)
    if status != OK:
        return status
    image_rays(spots, f, work[RAYS_ROW : RAYS_ROW + 3])
    if projection == PARALLEL:
        return solve_parallel(spots, f, a, b, p)
    return solve_perspective(work[RAYS_ROW : RAYS_ROW + 3], a, b, p, work[0:12])


@straight_line(p=(3,), u=(3, 3), jacobian=(3, 6))
def perspective_jacobian(p: Vector, u: Matrix, f: float, a: float, b: float, jacobian: Matrix) -> bool:
    """Write d(range, azimuth, elevation)/d(spots) of the exact fix p with camera-frame rays u into jacobian (3, 6).

    False where singular.
    """
    to_angles, to_position = np.zeros((3, 3)), np.zeros((3, 6))
    has_angles = range_azimuth_elevation_jacobian(p, to_angles)
    regular = position_jacobian(p, u, f, a, b, to_position)
    for i in range(3):
        for k in range(6):
            jacobian[i, k] = (
                to_angles[i, 0] * to_position[0, k]
                + to_angles[i, 1] * to_position[1, k]
                + to_angles[i, 2] * to_position[2, k]
            )
    return has_angles & regular


@kernel
def fix_jacobian(
    p: Vector, spots: Matrix, f: float, a: float, b: float, projection: int, jacobian: Matrix, work: Matrix
) -> bool:
    """Write d(range, azimuth, elevation)/d(A'x, A'y, B'x, B'y, C'x, C'y) at the fix p of the spots; False if singular.

    jacobian (3, 6): m or rad per m on the detector. work (15, 6) is scratch.
    """
    if projection == PARALLEL:
        return solve_parallel_jacobian(spots, f, a, b, jacobian)
    image_rays(spots, f, work[RAYS_ROW : RAYS_ROW + 3])
    return bool(perspective_jacobian(p, work[RAYS_ROW : RAYS_ROW + 3], f, a, b, jacobian))


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

    rae (3,), covariance (3, 3); work (19, 6) is scratch. sigma: 1-sigma of each spot coordinate, m.
    """
    p = work[15]
    jacobian = work[16:19]
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
    work: Matrix,
) -> None:
    """`measure_into` over images (n, 3, 2): rae (n, 3), covariance (n, 3, 3), status (n,); NaN where not OK."""
    for e in range(spots.shape[0]):
        status[e] = measure_into(spots[e], f, half_x, half_y, sigma, a, b, projection, rae[e], covariance[e], work)
        if status[e] != OK:
            for i in range(3):
                rae[e, i] = math.nan
                for j in range(3):
                    covariance[e, i, j] = math.nan
