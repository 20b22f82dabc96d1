"""What one image says of the state: residuals, measurement rows and noise, for each method.

`spots`, attitude known: the detector coordinates, h(x) = central projection of each beacon.
`spots`, attitude unknown: the attitude-free invariants of the rays (three beacons: three, two beacons: one).
`fix`: range, azimuth and elevation of the closed form, with R = J S J^T evaluated at the PREDICTED geometry: at the
measured spots R would depend on their noise, and fewer epochs stay consistent. Only while the prediction is no better
than a guess (sigma above 2 % of the range) is R taken at the fix itself. From a good prediction the fix is found by
Newton's method alone: it is the same root as that of the closed form's passes, which are needed from nowhere.

Rows of a beacon stand with the beacon, independent. Those of a fix or of invariants are correlated: they are kept as
L^-1 z and L^-1 H with R = L diag(VARIANCE) L^T.
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.estimation.factored import decorrelate
from relnav.geometry.rotation import triad
from relnav.geometry.spherical import docking_difference, range_azimuth_elevation_jacobian
from relnav.navigation.block import (
    ATTITUDE,
    BEACON_ROWS,
    CAM_FROM_DOCK,
    DOCK,
    FIX,
    FIX_AT,
    GRADIENT,
    INVERSE,
    JACOBIAN,
    OBSERVED,
    OFFSET,
    PLACE,
    POSITION,
    R_FACTOR,
    RAYS,
    RESIDUAL,
    SENSOR,
    SETTINGS,
    SPOTS,
    VALUE,
    VARIANCE,
    WORK,
    H,
    beacon_count,
    beacon_row,
)
from relnav.navigation.sight import (
    attitude_known,
    camera_position_dock,
    fix_of_spots,
    implied_attitude,
    prior_is_tight,
    see_beacon,
)
from relnav.sensors.measurement import DEGENERATE, NO_CONVERGENCE, NOT_SEEN, OFF_DETECTOR, OK, OUTSIDE_DOMAIN
from relnav.sensors.three_beacon.fix import PERSPECTIVE, coordinate_usable, image_rays, image_usable
from relnav.sensors.three_beacon.invariants import invariants, position_gradient, rays_from_position, spot_gradient
from relnav.sensors.three_beacon.parallel import solve_parallel_jacobian
from relnav.sensors.three_beacon.perspective import (
    chord_step,
    gradient_inverse,
    implicit_jacobian,
    inside_domain,
    settle,
)

TRIANGLE_ROWS = 9  # from the first beacon's rows to the third's position


@kernel
def take_in_coordinates(block: Matrix, spots: Matrix) -> tuple[int, int, int]:
    """Decide which coordinates of the spots (n, 2) m can be used; (beacons seen, coordinates usable, Status code)."""
    sensor = block[SENSOR]
    seen, usable, status = 0, 0, OK
    for i in range(beacon_count(block)):
        row = beacon_row(block, i)
        position, observed = block[row + POSITION], block[row + OBSERVED]
        observed[2], observed[3], observed[4] = 0.0, 0.0, 1.0
        x, y = spots[i, 0], spots[i, 1]
        if x != x and y != y:
            continue
        seen += 1
        on_x, on_y = coordinate_usable(x, sensor[1]), coordinate_usable(y, sensor[2])
        if (x == x and not on_x) or (y == y and not on_y):
            status = OFF_DETECTOR
            continue
        if on_x:
            observed[2] = position[3] * position[3]
            usable += 1
        if on_y:
            observed[3] = position[4] * position[4]
            usable += 1
    return seen, usable, status if seen > 0 else NOT_SEEN


@kernel
def linearise_coordinates(block: Matrix, x: Vector, spots: Matrix) -> int:
    """Write residuals and rows of the beacons in use at x; returns how many coordinates are behind (dropped)."""
    mount, f = block[ATTITUDE : ATTITUDE + 3], block[SENSOR, 0]
    dropped = 0
    for i in range(beacon_count(block)):
        row = beacon_row(block, i)
        observed = block[row + OBSERVED]
        if observed[2] > 0.0 or observed[3] > 0.0:
            depth = see_beacon(x, mount, block[row + POSITION], f, spots[i], block[row + OBSERVED : row + GRADIENT + 2])
            if not depth > 0.0:
                dropped += int(observed[2] > 0.0) + int(observed[3] > 0.0)
                observed[2], observed[3] = 0.0, 0.0
    return dropped


@straight_line(jacobian=(3, 6), triangle=(TRIANGLE_ROWS, 6), factor=(3, 3), variances=(3,))
def correlated_noise(jacobian: Matrix, triangle: Matrix, factor: Matrix, variances: Vector) -> bool:
    """Write L and d of R = J S J^T = L diag(d) L^T; S from the sigmas in the beacons' POSITION rows."""
    r, weighted = np.zeros((3, 3)), np.zeros((3, 6))
    for k in range(6):
        position = triangle[BEACON_ROWS * (k // 2) + POSITION]
        variance = position[3 + k % 2] * position[3 + k % 2] + position[5] * position[5]
        for i in range(3):
            weighted[i, k] = jacobian[i, k] * variance
    for i in range(3):
        for j in range(i + 1):
            for k in range(6):
                r[i, j] += weighted[i, k] * jacobian[j, k]
    return decorrelate(r, factor, variances)


@straight_line(
    p=(3,), inverse=(3, 3), u=(3, 3), triangle=(TRIANGLE_ROWS, 6), jacobian=(3, 6), factor=(3, 3), variances=(3,)
)  # fmt: skip
def fix_noise(
    p: Vector,
    inverse: Matrix,
    u: Matrix,
    f: float,
    triangle: Matrix,
    jacobian: Matrix,
    factor: Matrix,
    variances: Vector,
) -> bool:
    """Write J = d(range, azimuth, elevation) / d spots at p, seen along camera-frame rays u, and L, d of their noise.

    inverse (3, 3) is (dg/dp)^-1 at p. False where singular.
    """
    to_angles, to_position = np.zeros((3, 3)), np.zeros((3, 6))
    regular = range_azimuth_elevation_jacobian(p, to_angles)
    implicit_jacobian(inverse, u, f, to_position)
    for i in range(3):
        for k in range(6):
            total = 0.0
            for j in range(3):
                total += to_angles[i, j] * to_position[j, k]
            jacobian[i, k] = total
    return regular & correlated_noise(jacobian, triangle, factor, variances)


@straight_line(p=(3,), cam_from_dock=(3, 3), out=(3, 3))
def rays_in_camera(p: Vector, a: float, b: float, cam_from_dock: Matrix, out: Matrix) -> bool:
    """Write the unit rays from p to beacons A, B, C in camera axes into out (3, 3); False if one points backward."""
    u, distance = np.zeros((3, 3)), np.zeros(3)
    rays_from_position(p, a, b, u, distance)
    for i in range(3):
        for k in range(3):
            out[i, k] = cam_from_dock[k, 0] * u[i, 0] + cam_from_dock[k, 1] * u[i, 1] + cam_from_dock[k, 2] * u[i, 2]
    forward: bool = (out[0, 2] > 0.0) & (out[1, 2] > 0.0) & (out[2, 2] > 0.0)
    return forward


@kernel
def _attitude_of_image(block: Matrix, dcm: Matrix, work: Matrix) -> bool:
    """Write into dcm the rotation (triad) that turns the rays of the fix into the measured ones. work (14, 6)."""
    seen, distance = work[0:3], work[3]
    rays_from_position(block[FIX_AT], block[SENSOR, 4], block[SENSOR, 5], seen, distance)
    for j in range(3):
        work[4, j] = seen[0, j] - seen[1, j]
        work[5, j] = seen[0, j] + seen[1, j]
        work[6, j] = block[RAYS, j] - block[RAYS + 1, j]
        work[7, j] = block[RAYS, j] + block[RAYS + 1, j]
    if not triad(work[4], work[5], work[8:11]) or not triad(work[6], work[7], work[11:14]):
        return False
    for i in range(3):
        for j in range(3):
            dcm[i, j] = 0.0
            for k in range(3):
                dcm[i, j] += work[11 + k, i] * work[8 + k, j]
    return True


@kernel
def _fix_near_prediction(block: Matrix, spots: Matrix) -> int:
    """Position of the image by Newton's method from the prediction (PLACE); NO_CONVERGENCE if that does not settle."""
    sensor, place, p, rays = block[SENSOR], block[PLACE], block[FIX_AT], block[RAYS : RAYS + 3]
    status = image_usable(spots, sensor[1], sensor[2])
    if status != OK:
        return status
    inverse, g = block[INVERSE : INVERSE + 3], block[VALUE]
    image_rays(spots, sensor[0], rays)
    invariants(rays, g)
    if not gradient_inverse(place, sensor[4], sensor[5], inverse):
        return NO_CONVERGENCE
    p[0], p[1], p[2] = place[0], place[1], place[2]
    chord_step(g, sensor[4], sensor[5], p, inverse)
    if not settle(g, sensor[4], sensor[5], p, block[WORK : WORK + 3]):
        return NO_CONVERGENCE
    if not inside_domain(p, sensor[5]):
        return OUTSIDE_DOMAIN
    return implied_attitude(block, p)


@kernel
def _prepare_position(block: Matrix, spots: Matrix) -> int:
    """Take the closed form (or its invariants) as the measurement, noise at the predicted geometry."""
    sensor, fix, inverse = block[SENSOR], block[FIX_AT], block[INVERSE : INVERSE + 3]
    factor, variance, jacobian = block[R_FACTOR : R_FACTOR + 3], block[VARIANCE], block[JACOBIAN : JACOBIAN + 3]
    first = beacon_row(block, 0)
    triangle = block[first : first + TRIANGLE_ROWS]
    f, a, b = sensor[0], sensor[4], sensor[5]
    exact = block[SETTINGS, 0] == PERSPECTIVE
    tight = prior_is_tight(block)
    status = _fix_near_prediction(block, spots) if exact and tight else NO_CONVERGENCE
    near = status == OK
    if status in (NO_CONVERGENCE, OUTSIDE_DOMAIN):
        status = fix_of_spots(block, spots, fix)
    if status != OK:
        return status
    p = block[PLACE] if tight else fix
    if not (near or gradient_inverse(p, a, b, inverse)):
        return NO_CONVERGENCE
    dcm, rays = block[CAM_FROM_DOCK : CAM_FROM_DOCK + 3], block[WORK : WORK + 3]
    if not attitude_known(block):
        dcm = block[WORK + 3 : WORK + 6]
        if not _attitude_of_image(block, dcm, block[WORK + 6 : WORK + 20]):
            return NO_CONVERGENCE
    if not rays_in_camera(p, a, b, dcm, rays):
        return NO_CONVERGENCE
    if block[SETTINGS, 1] == FIX and exact:
        return OK if fix_noise(p, inverse, rays, f, triangle, jacobian, factor, variance) else DEGENERATE
    if block[SETTINGS, 1] == FIX:
        predicted = block[WORK + 3 : WORK + 6]
        for i in range(3):
            predicted[i, 0] = f * rays[i, 0] / rays[i, 2]
            predicted[i, 1] = f * rays[i, 1] / rays[i, 2]
        if not solve_parallel_jacobian(predicted, f, a, b, jacobian):
            return NO_CONVERGENCE
    else:
        invariants(block[RAYS : RAYS + 3], block[VALUE])
        spot_gradient(rays, f, jacobian)
    return OK if correlated_noise(jacobian, triangle, factor, variance) else DEGENERATE


@kernel
def _unseen(spots: Matrix) -> int:
    """Number of the one beacon that is not seen at all; the last such if there are more."""
    out = 3
    for i in range(3):
        if spots[i, 0] != spots[i, 0] and spots[i, 1] != spots[i, 1]:
            out = i
    return out


@kernel
def _prepare_pair(block: Matrix, spots: Matrix) -> bool:
    """Two beacons, attitude unknown: one number, the squared chord |u_i - u_j|^2 between their rays.

    Only from a tight prior: the angle bends by (dx / r)^2 / 2 of itself, 2e-4 then, beside noise of 1e-2 in one image.
    From a wide one (after a long gap) it would make the filter overconfident; it then waits for three beacons.
    """
    rays, jacobian, scratch = block[RAYS : RAYS + 3], block[JACOBIAN : JACOBIAN + 3], block[WORK : WORK + 6]
    missing, row = _unseen(spots), 0
    image_rays(spots, block[SENSOR, 0], scratch[0:3])
    for i in range(3):
        if i != missing:
            for j in range(3):
                rays[row, j] = scratch[i, j]
            row += 1
    rays[2, 0], rays[2, 1], rays[2, 2] = 0.0, 0.0, 1.0  # any ray: g1 does not use it
    invariants(rays, block[VALUE])
    spot_gradient(rays, block[SENSOR, 0], jacobian)
    variance, column = 0.0, 4
    for i in range(2, -1, -1):
        position = block[beacon_row(block, i) + POSITION]
        for k in range(1, -1, -1):
            if i == missing:
                jacobian[0, 2 * i + k] = 0.0
            else:  # from the column among the two rays to the beacon's own
                column -= 1
                jacobian[0, 2 * i + k] = jacobian[0, column]
                variance += jacobian[0, column] ** 2 * (position[3 + k] ** 2 + position[5] ** 2)
    block[VARIANCE, 0] = variance
    return variance > 0.0


@kernel
def prepare_position(block: Matrix, spots: Matrix) -> tuple[int, int, int]:
    """Decide what a fix or invariants of the image give, and with which noise, at PLACE.

    Returns (groups seen, rows usable, Status code): the whole image is one group.
    """
    variance, seen, whole = block[VARIANCE], 0, 0
    variance[0], variance[1], variance[2] = 0.0, 0.0, 0.0
    for i in range(3):
        x, y = spots[i, 0], spots[i, 1]
        if x == x or y == y:
            seen += 1
        if coordinate_usable(x, block[SENSOR, 1]) and coordinate_usable(y, block[SENSOR, 2]):
            whole += 1
    if seen == 0:
        return 0, 0, NOT_SEEN
    if block[SETTINGS, 1] == SPOTS and seen == 2 and whole == 2 and prior_is_tight(block):
        if _prepare_pair(block, spots):
            return 1, 1, OK
        return 1, 0, DEGENERATE
    status = _prepare_position(block, spots)
    if status == OK:
        return 1, 3, OK
    variance[0], variance[1], variance[2] = 0.0, 0.0, 0.0
    return 0 if status == NOT_SEEN else 1, 0, status


@straight_line(p=(3,), fix=(3,), dock=(3, 3), factor=(3, 3), h=(3, 6), residual=(6,))
def fix_rows(p: Vector, fix: Vector, dock: Matrix, factor: Matrix, h: Matrix, residual: Vector) -> bool:
    """Write the independent rows of (range, azimuth, elevation) at p, and the residuals of the fix, both kinds."""
    to_angles, difference = np.zeros((3, 3)), np.zeros(3)
    regular = range_azimuth_elevation_jacobian(p, to_angles)
    docking_difference(fix, p, difference)
    for m in range(3):
        residual[3 + m] = difference[m]
        residual[m] = difference[m]
        for k in range(m):
            residual[m] -= factor[m, k] * residual[k]
        for j in range(3):
            h[m, j] = to_angles[m, 0] * dock[0, j] + to_angles[m, 1] * dock[1, j] + to_angles[m, 2] * dock[2, j]
            for k in range(m):
                h[m, j] -= factor[m, k] * h[k, j]
    return regular


@kernel
def _linearise_invariants(block: Matrix, p: Vector, spots: Matrix) -> None:
    """Write the independent rows of the invariants (three, or one of a pair) at p (3,), docking frame."""
    sensor, work = block[SENSOR], block[WORK : WORK + 12]
    rays, distance, predicted, d, residual = work[0:3], work[3], work[4], work[5:8], block[RESIDUAL]
    size = 3 if block[VARIANCE, 1] > 0.0 else 1
    rays_from_position(p, sensor[4], sensor[5], rays, distance)
    if size == 1:  # a pair: put its two beacons first, so that g1 is its chord
        missing, row = _unseen(spots), 0
        for i in range(3):
            if i != missing:
                distance[row] = distance[i]
                for j in range(3):
                    rays[row, j] = rays[i, j]
                row += 1
    invariants(rays, predicted)
    position_gradient(rays, distance, d)
    for m in range(size):
        residual[3 + m] = block[VALUE, m] - predicted[m]
        residual[m] = residual[3 + m]
        for k in range(m):
            residual[m] -= block[R_FACTOR + m, k] * residual[k]
        for j in range(3):
            total = 0.0
            for q in range(3):
                total += d[m, q] * block[DOCK + q, j]
            for k in range(m):
                total -= block[R_FACTOR + m, k] * block[H + k, j]
            block[H + m, j] = total


@kernel
def linearise_position(block: Matrix, x: Vector, spots: Matrix) -> bool:
    """Write the independent rows of the fix or the invariants at the state x; False if there are none there."""
    p, dock = block[WORK + 12], block[DOCK : DOCK + 3]
    camera_position_dock(x, block[OFFSET], dock, p)
    if block[SETTINGS, 1] == FIX:
        factor, h = block[R_FACTOR : R_FACTOR + 3], block[H : H + 3]
        return bool(fix_rows(p, block[FIX_AT], dock, factor, h, block[RESIDUAL]))
    _linearise_invariants(block, p, spots)
    return True
