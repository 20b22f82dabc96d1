"""Where a track begins: the position from one image alone, with the covariance that follows from its spots.

From beacons A, B and C by the closed form. From any other three or more beacons (A and B have left the detector, near
the port) by least squares, if the camera's attitude is known: then every spot is two planes that meet in the camera.
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.estimation.factored import factorize_into
from relnav.geometry.linear_algebra import invert_three
from relnav.geometry.spherical import position_from_angles_jacobian
from relnav.navigation.block import (
    ATTITUDE,
    CONTROL,
    DOCK,
    FIX_AT,
    GRADIENT,
    JACOBIAN,
    LAYOUT,
    OBSERVED,
    OFFSET,
    POSITION,
    SENSOR,
    SETTINGS,
    WORK,
    beacon_count,
    beacon_row,
    gate_limit,
)
from relnav.navigation.considered import (
    add_considered_noise,
    start_sensitivities_of_fix,
    start_sensitivities_of_planes,
)
from relnav.navigation.observation import TRIANGLE_ROWS, linearise_coordinates, take_in_coordinates
from relnav.navigation.sight import fix_of_spots, uses_coordinates
from relnav.sensors.measurement import DEGENERATE, NOT_SEEN, OK
from relnav.sensors.three_beacon.fix import fix_jacobian


@straight_line(
    dock=(3, 3), from_angles=(3, 3), jacobian=(3, 6), triangle=(TRIANGLE_ROWS, 6), covariance=(6, 6)
)  # fmt: skip
def _start_covariance(
    dock: Matrix, from_angles: Matrix, jacobian: Matrix, triangle: Matrix, velocity_sigma: float, covariance: Matrix
) -> None:
    """Covariance of a track that starts from one image: G S G^T in position, G = dock^T from_angles jacobian."""
    g = np.zeros((3, 6))
    for i in range(3):
        for k in range(6):
            for j in range(3):
                for m in range(3):
                    g[i, k] += dock[j, i] * from_angles[j, m] * jacobian[m, k]
            g[i, k] *= triangle[4 * (k // 2), 3 + k % 2]
    for i in range(6):
        for j in range(6):
            covariance[i, j] = velocity_sigma * velocity_sigma if i == j else 0.0
    for i in range(3):
        covariance[i, i] = 0.0
        for j in range(3):
            for k in range(6):
                covariance[i, j] += g[i, k] * g[j, k]


@kernel
def _start_of_fix(block: Matrix, track: Matrix, sensitivities: Matrix, spots: Matrix) -> int:
    """Set a track (7, 6) by the closed form: its covariance J S J^T, turned from angles into `lvlh_ccsds` position."""
    sensor, p, x = block[SENSOR], block[FIX_AT], track[0]
    status = fix_of_spots(block, spots, p)
    if status != OK:
        return status
    jacobian, from_angles, covariance = (
        block[JACOBIAN : JACOBIAN + 3],
        block[WORK + 15 : WORK + 18],
        block[WORK : WORK + 6],
    )
    if not fix_jacobian(
        p, spots, sensor[0], sensor[4], sensor[5], int(block[SETTINGS, 0]), jacobian, block[WORK : WORK + 15]
    ):
        return DEGENERATE
    if not start_sensitivities_of_fix(block, p, spots, sensitivities):
        return DEGENERATE
    if not position_from_angles_jacobian(p, from_angles):
        return DEGENERATE
    dock, first = block[DOCK : DOCK + 3], beacon_row(block, 0)
    _start_covariance(dock, from_angles, jacobian, block[first : first + TRIANGLE_ROWS], block[CONTROL, 3], covariance)
    if not factorize_into(covariance, track[1:7]):
        return DEGENERATE
    for i in range(3):
        x[i] = dock[0, i] * p[0] + dock[1, i] * p[1] + dock[2, i] * p[2] - block[OFFSET, i]
        x[3 + i] = 0.0
    return OK


@kernel
def _solve_normal(normal: Matrix, right: Vector, inverse: Matrix, x: Vector) -> bool:
    """Add normal^-1 right (3,) to x; False if the normal matrix (3, 3) is singular."""
    if not invert_three(normal, inverse):
        return False
    for i in range(3):
        x[i] += inverse[i, 0] * right[0] + inverse[i, 1] * right[1] + inverse[i, 2] * right[2]
    return True


@kernel
def _add_row(normal: Matrix, right: Vector, row: Vector, value: float, weight: float) -> None:
    """Add one measured row (3,) to the normal equations."""
    for i in range(3):
        right[i] += weight * row[i] * value
        for j in range(3):
            normal[i, j] += weight * row[i] * row[j]


@kernel
def _meet_planes(block: Matrix, spots: Matrix, normal: Matrix, inverse: Matrix, x: Vector) -> bool:
    """Write the point (3,) nearest to the planes of the usable coordinates: linear, every plane with equal weight.

    f c_axis = s c_z with c = mount (beacon - x) - lever:  m . x = m . beacon - (f l_axis - s l_z),
    m = f mount_axis - s mount_z. `normal` has three rows and a scratch row for m and one for the right side.
    """
    mount, f, m, right = block[ATTITUDE : ATTITUDE + 3], block[SENSOR, 0], normal[3], normal[4]
    for i in range(5):
        for j in range(6):
            normal[i, j] = 0.0
    for beacon in range(beacon_count(block)):
        row = beacon_row(block, beacon)
        position = block[row + POSITION]
        for axis in range(2):
            if block[row + OBSERVED, 2 + axis] > 0.0:
                s = spots[beacon, axis]
                value = s * mount[2, 3] - f * mount[axis, 3]
                for j in range(3):
                    m[j] = f * mount[axis, j] - s * mount[2, j]
                    value += m[j] * position[j]
                _add_row(normal[0:3], right, m, value, 1.0)
    x[0], x[1], x[2] = 0.0, 0.0, 0.0
    return _solve_normal(normal[0:3], right, inverse, x)


@kernel
def _spot_equations(block: Matrix, normal: Matrix) -> tuple[float, int]:
    """Write the normal equations of the linearised spots; returns their squared residuals in sigmas, and how many."""
    for i in range(5):
        for j in range(6):
            normal[i, j] = 0.0
    total, rows = 0.0, 0
    for beacon in range(beacon_count(block)):
        row = beacon_row(block, beacon)
        observed = block[row + OBSERVED]
        for axis in range(2):
            if observed[2 + axis] > 0.0:
                weight, residual = 1.0 / observed[2 + axis], observed[axis]
                _add_row(normal[0:3], normal[4], block[row + GRADIENT + axis], residual, weight)
                total += weight * residual * residual
                rows += 1
    return total, rows


@kernel
def _start_of_planes(block: Matrix, track: Matrix, sensitivities: Matrix, spots: Matrix) -> int:
    """Set a track (7, 6) by least squares over all whole beacons, three or more, that must agree; a Status code.

    The planes' meeting point, then one Gauss-Newton step with the spots' noise; its normal matrix is the information.
    The track is left alone unless the image can begin one: it may be a trial that goes on.
    """
    normal, inverse = block[WORK : WORK + 5], block[WORK + 5 : WORK + 8]
    covariance, x = block[WORK + 8 : WORK + 14], block[WORK + 21]
    _, usable, _ = take_in_coordinates(block, spots)
    if usable < 6:
        return NOT_SEEN
    if not _meet_planes(block, spots, normal, inverse, x):
        return DEGENERATE
    if linearise_coordinates(block, x, spots) > 0:
        return DEGENERATE
    end = int(block[LAYOUT, 5])
    none = block[end - sensitivities.shape[0] : end]
    for j in range(sensitivities.shape[0]):
        for i in range(6):
            none[j, i] = 0.0
    add_considered_noise(block, x, none)
    _spot_equations(block, normal)
    if not _solve_normal(normal[0:3], normal[4], inverse, x):
        return DEGENERATE
    if linearise_coordinates(block, x, spots) > 0:
        return DEGENERATE
    chi2, rows = _spot_equations(block, normal)
    if not (rows >= 6 and chi2 <= gate_limit(block, rows - 3)):
        return DEGENERATE
    if not invert_three(normal[0:3], inverse):
        return DEGENERATE
    for i in range(6):
        for j in range(6):
            velocity = block[CONTROL, 3] * block[CONTROL, 3] if i == j else 0.0
            covariance[i, j] = 0.5 * (inverse[i, j] + inverse[j, i]) if i < 3 and j < 3 else velocity
    if not factorize_into(covariance, track[1:7]):
        return DEGENERATE
    for i in range(6):
        track[0, i] = x[i] if i < 3 else 0.0
    start_sensitivities_of_planes(block, x, spots, covariance, sensitivities)
    return OK


@kernel
def start(block: Matrix, track: Matrix, sensitivities: Matrix, spots: Matrix) -> int:
    """Set a track (7, 6), and its sensitivities (m, 6), from one image (n, 2) m alone, with zero velocity.

    Returns a Status code.
    """
    status = _start_of_fix(block, track, sensitivities, spots)
    if status != OK and beacon_count(block) > 3 and uses_coordinates(block):
        other = _start_of_planes(block, track, sensitivities, spots)
        status = OK if other == OK else status
    return status
