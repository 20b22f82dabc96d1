"""Where a track begins: the position from one image alone, with the covariance that follows from its spots.

From beacons A, B and C by the closed form. From any other three or more beacons (A and B have left the detector, near
the port) by least squares, if the camera's attitude is known: then every spot is two planes that meet in the camera.
"""

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.dynamics.error_state import MOTION, VELOCITY
from relnav.estimation.factored import factorize_into
from relnav.geometry.linear_algebra import invert_three
from relnav.geometry.spherical import position_from_angles_jacobian
from relnav.navigation.memory import Memory
from relnav.navigation.observation.beacon_arm import arm_covariance, swings
from relnav.navigation.observation.beacon_considered import (
    add_attitude_noise,
    add_considered_noise,
    start_sensitivities_of_fix,
    start_sensitivities_of_planes,
)
from relnav.navigation.observation.beacon_geometry import fix_of_spots, uses_coordinates
from relnav.navigation.observation.beacon_rows import linearise_coordinates, spot_sigmas, take_in_coordinates
from relnav.sensors.measurement import DEGENERATE, NOT_SEEN, OK
from relnav.sensors.three_beacon.fix import COORDINATES, fix_jacobian


@straight_line(
    dock=(3, 4), from_angles=(3, 3), jacobian=(3, COORDINATES), sigma=(3, 3), covariance=(MOTION, MOTION)
)  # fmt: skip
def _start_covariance(
    dock: Matrix, from_angles: Matrix, jacobian: Matrix, sigma: Matrix, velocity_sigma: float, covariance: Matrix
) -> None:
    """Covariance of a track that starts from one image: G S G^T in position, G = dock^T from_angles jacobian."""
    g = np.zeros((3, COORDINATES))
    for i in range(3):
        for k in range(COORDINATES):
            for j in range(3):
                for m in range(3):
                    g[i, k] += dock[j, i] * from_angles[j, m] * jacobian[m, k]
            g[i, k] *= sigma[k // 2, k % 2]
    for i in range(MOTION):
        for j in range(MOTION):
            covariance[i, j] = velocity_sigma * velocity_sigma if i == j else 0.0
    for i in range(3):
        covariance[i, i] = 0.0
        for j in range(3):
            for k in range(COORDINATES):
                covariance[i, j] += g[i, k] * g[j, k]


@kernel
def _start_of_fix(m: Memory, track: Record, sensitivities: Matrix, spots: Matrix) -> int:
    """Set a track by the closed form: its covariance J S J^T, turned from angles into `lvlh_ccsds`, and the arm's."""
    sensor, scratch, p, x = m.sensor, m.scratch, m.fix["position"], track["state"]
    work = scratch["closed_form"]
    status = fix_of_spots(sensor, m.beacons, work, spots, p, m.fix["rays"])
    if status != OK:
        return status
    jacobian, from_angles, covariance = m.fix["jacobian"], scratch["turn"], scratch["covariance"]
    f, a, b = sensor["focal_length"], sensor["half_spacing"], sensor["c_distance"]
    if not fix_jacobian(p, spots, f, a, b, sensor["projection"], jacobian, work):
        return DEGENERATE
    if not start_sensitivities_of_fix(m, p, spots, jacobian, sensitivities):
        return DEGENERATE
    if not position_from_angles_jacobian(p, from_angles):
        return DEGENERATE
    dock, sigma, velocity_sigma = m.kept["dock"], scratch["three"], m.motion["initial_velocity_sigma"]
    spot_sigmas(m.beacons, sigma)
    _start_covariance(dock, from_angles, jacobian, sigma, velocity_sigma, covariance)
    if swings(m):
        arm_covariance(m, from_angles)
        for i in range(3):
            for j in range(3):
                covariance[i, j] += from_angles[i, j]
    if not factorize_into(covariance, track["ld"]):
        return DEGENERATE
    for i in range(3):
        x[i] = dock[0, i] * p[0] + dock[1, i] * p[1] + dock[2, i] * p[2] - sensor["offset"][i]
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
def _meet_planes(m: Memory, spots: Matrix, normal: Matrix, inverse: Matrix, x: Vector) -> bool:
    """Write the point (3,) nearest to the planes of the usable coordinates: linear, every plane with equal weight.

    f c_axis = s c_z with c = mount (beacon - x) - lever:  n . x = n . beacon - (f l_axis - s l_z),
    n = f mount_axis - s mount_z. `normal` has three rows and a scratch row for n and one for the right side.
    """
    mount, f, n, right = m.kept["mount"], m.sensor["focal_length"], normal[3], normal[4]
    for i in range(5):
        for j in range(3):
            normal[i, j] = 0.0
    for beacon in range(m.beacons.shape[0]):
        position = m.beacons[beacon]["position"]
        for axis in range(2):
            if m.groups[beacon]["variance"][axis] > 0.0:
                s = spots[beacon, axis]
                value = s * mount[2, 3] - f * mount[axis, 3]
                for j in range(3):
                    n[j] = f * mount[axis, j] - s * mount[2, j]
                    value += n[j] * position[j]
                _add_row(normal[0:3], right, n, value, 1.0)
    x[0], x[1], x[2] = 0.0, 0.0, 0.0
    return _solve_normal(normal[0:3], right, inverse, x)


@kernel
def _spot_equations(groups: Record, normal: Matrix) -> tuple[float, int]:
    """Write the normal equations of the linearised spots; returns their squared residuals in sigmas, and how many."""
    for i in range(5):
        for j in range(3):
            normal[i, j] = 0.0
    total, rows = 0.0, 0
    for i in range(groups.shape[0]):
        variance, residuals, h = groups[i]["variance"], groups[i]["residual"], groups[i]["gradient"]
        for axis in range(2):
            if variance[axis] > 0.0:
                weight, residual = 1.0 / variance[axis], residuals[axis]
                _add_row(normal[0:3], normal[4], h[axis], residual, weight)
                total += weight * residual * residual
                rows += 1
    return total, rows


@kernel
def _start_of_planes(m: Memory, track: Record, sensitivities: Matrix, spots: Matrix) -> int:
    """Set a track by least squares over all whole beacons, three or more, that must agree; a Status code.

    The planes' meeting point, then one Gauss-Newton step with the spots' noise; its normal matrix is the information.
    The track is left alone unless the image can begin one: it may be a trial that goes on.
    """
    normal, inverse, covariance, x = m.scratch["normal"], m.scratch["turn"], m.scratch["covariance"], m.fixed["at"]
    mount, none = m.kept["mount"], m.news
    _, usable, _ = take_in_coordinates(m.sensor, m.beacons, m.groups, spots)
    if usable < COORDINATES:
        return NOT_SEEN
    if not _meet_planes(m, spots, normal, inverse, x):
        return DEGENERATE
    if linearise_coordinates(m.sensor, mount, m.beacons, m.groups, x, spots) > 0:
        return DEGENERATE
    for j in range(sensitivities.shape[0]):
        for i in range(MOTION):
            none[j, i] = 0.0
    add_considered_noise(m, x, none, spots)
    _spot_equations(m.groups, normal)
    if not _solve_normal(normal[0:3], normal[4], inverse, x):
        return DEGENERATE
    if linearise_coordinates(m.sensor, mount, m.beacons, m.groups, x, spots) > 0:
        return DEGENERATE
    chi2, rows = _spot_equations(m.groups, normal)
    if not (rows >= COORDINATES and chi2 <= m.gate[rows - 4]):
        return DEGENERATE
    if not invert_three(normal[0:3], inverse):
        return DEGENERATE
    velocity2 = m.motion["initial_velocity_sigma"] * m.motion["initial_velocity_sigma"]
    for i in range(MOTION):
        for j in range(MOTION):
            covariance[i, j] = velocity2 if i == j else 0.0
    for i in range(3):
        for j in range(3):
            covariance[i, j] = 0.5 * (inverse[i, j] + inverse[j, i])
    if not factorize_into(covariance, track["ld"]):
        return DEGENERATE
    state = track["state"]
    for i in range(3):
        state[i], state[VELOCITY + i] = x[i], 0.0
    start_sensitivities_of_planes(m, track, spots, sensitivities)
    add_attitude_noise(m, track)
    return OK


@kernel
def start(m: Memory, track: Record, sensitivities: Matrix, spots: Matrix) -> int:
    """Set a track, and its sensitivities (m, 6), from one image (n, 2) m alone, with zero velocity; a Status code."""
    status = _start_of_fix(m, track, sensitivities, spots)
    if status != OK and m.beacons.shape[0] > 3 and uses_coordinates(m.sensor):
        other = _start_of_planes(m, track, sensitivities, spots)
        status = OK if other == OK else status
    return status
