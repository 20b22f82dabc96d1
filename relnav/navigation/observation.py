"""What one image says of the state: residuals, measurement rows and noise, for each method.

`spots`, attitude known: the detector coordinates, h(x) = central projection of each beacon.
`spots`, attitude unknown: the attitude-free invariants of the rays (three beacons: three, two beacons: one).
`fix`: range, azimuth and elevation of the closed form, with R = J S J^T evaluated at the PREDICTED geometry: at the
measured spots R would depend on their noise, and fewer epochs stay consistent. Only while the prediction is no better
than a guess (sigma above 2 % of the range) is R taken at the fix itself.
"""

from relnav._kernel import kernel
from relnav.arrays import Matrix, Vector
from relnav.estimation.factored import decorrelate
from relnav.geometry.pinhole import project, project_jacobian_row, unit_ray
from relnav.geometry.rotation import triad
from relnav.geometry.spherical import range_azimuth_elevation, range_azimuth_elevation_jacobian, wrap_angle
from relnav.navigation.block import (
    ATTITUDE,
    DOCK,
    FIX,
    R_FACTOR,
    RESIDUAL,
    SENSOR,
    SETTINGS,
    SPOTS,
    VALUE,
    VARIANCE,
    WORK,
    H,
)
from relnav.navigation.sight import (
    IMAGE,
    JACOBIAN,
    LOCAL,
    P_DOCK,
    POINT,
    RAYS,
    attitude_known,
    beacon_in_camera,
    camera_position_dock,
    fix_of_spots,
    prior_is_tight,
    uses_coordinates,
)
from relnav.sensors.measurement import (
    BEHIND,
    DEGENERATE,
    NO_CONVERGENCE,
    NOT_SEEN,
    OFF_DETECTOR,
    OK,
)
from relnav.sensors.three_beacon.fix import (
    PERSPECTIVE,
    WORK_ROWS,
    coordinate_usable,
    fix_jacobian,
    perspective_jacobian,
)
from relnav.sensors.three_beacon.invariants import invariants, position_gradient, rays_from_position, spot_gradient


@kernel
def _predicted_rays(block: Matrix, spots: Matrix, p_fix: Vector, p: Vector, rays: Matrix) -> bool:
    """Write into rays (3 rows) the unit rays that a camera at p (docking frame) would see, in camera axes.

    The attitude is the known one, or the one that turns the rays of the fix p_fix into the measured ones (triad).
    """
    sensor, work, local = block[SENSOR], block[WORK : WORK + WORK_ROWS], block[LOCAL : LOCAL + 3]
    if attitude_known(block):
        for i in range(3):
            for j in range(3):
                local[i, j] = 0.0  # dcm_cam_from_dock
                for k in range(3):
                    local[i, j] += block[ATTITUDE + i, k] * block[DOCK + j, k]
    else:
        rays_from_position(p_fix, sensor[4], sensor[5], work[0:3], work[3])
        for i in range(3):
            unit_ray(spots[i, 0], spots[i, 1], sensor[0], work[4 + i])
        for j in range(3):
            work[7, j] = work[0, j] - work[1, j]
            work[8, j] = work[0, j] + work[1, j]
            work[9, j] = work[4, j] - work[5, j]
            work[10, j] = work[4, j] + work[5, j]
        if not triad(work[7], work[8], work[11:14]) or not triad(work[9], work[10], work[14:17]):
            return False
        for i in range(3):
            for j in range(3):
                local[i, j] = 0.0
                for k in range(3):
                    local[i, j] += work[14 + k, i] * work[11 + k, j]
    rays_from_position(p, sensor[4], sensor[5], work[0:3], work[3])
    for i in range(3):
        for k in range(3):
            rays[i, k] = local[k, 0] * work[i, 0] + local[k, 1] * work[i, 1] + local[k, 2] * work[i, 2]
        if not rays[i, 2] > 0.0:
            return False
    return True


@kernel
def _noise_from_jacobian(block: Matrix, jacobian: Matrix) -> bool:
    """R = s^2 J J^T of the rows of jacobian (m, 6), decorrelated into R_FACTOR and VARIANCE."""
    sigma2 = block[SENSOR, 3] ** 2
    size = jacobian.shape[0]
    r = block[LOCAL : LOCAL + size]
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(6):
                total += jacobian[i, k] * jacobian[j, k]
            r[i, j] = sigma2 * total
    return decorrelate(r, block[R_FACTOR : R_FACTOR + 3], block[VARIANCE])


@kernel
def _prepare_fix(block: Matrix, x: Vector, spots: Matrix) -> int:
    """Take the closed form (or its invariants) as the measurement, noise at the predicted geometry."""
    sensor, p, fix = block[SENSOR], block[P_DOCK], block[IMAGE]
    rays, jacobian = block[RAYS : RAYS + 3], block[JACOBIAN : JACOBIAN + 3]
    status = fix_of_spots(block, spots, fix)
    if status != OK:
        return status
    camera_position_dock(block, x, p)
    if not prior_is_tight(block, x):
        p[0], p[1], p[2] = fix[0], fix[1], fix[2]
    if not _predicted_rays(block, spots, fix, p, rays):
        return NO_CONVERGENCE
    f = sensor[0]
    if block[SETTINGS, 1] == FIX:
        range_azimuth_elevation(fix, block[VALUE])
        work = block[WORK : WORK + WORK_ROWS]
        projection = int(block[SETTINGS, 0])
        if projection == PERSPECTIVE:
            usable = perspective_jacobian(p, rays, f, sensor[4], sensor[5], jacobian, work)
        else:
            predicted = block[LOCAL : LOCAL + 3]
            for i in range(3):
                predicted[i, 0] = f * rays[i, 0] / rays[i, 2]
                predicted[i, 1] = f * rays[i, 1] / rays[i, 2]
            usable = fix_jacobian(p, predicted, f, sensor[4], sensor[5], projection, jacobian, work)
        if not usable:
            return NO_CONVERGENCE
    else:
        spot_gradient(rays, f, jacobian, block[WORK : WORK + 9])
        for i in range(3):
            unit_ray(spots[i, 0], spots[i, 1], f, rays[i])
        invariants(rays, block[VALUE])
    if not _noise_from_jacobian(block, jacobian):
        return DEGENERATE
    return OK


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
    f, rays, jacobian = block[SENSOR, 0], block[RAYS : RAYS + 3], block[JACOBIAN : JACOBIAN + 3]
    missing = _unseen(spots)
    row = 0
    for i in range(3):
        if i != missing:
            unit_ray(spots[i, 0], spots[i, 1], f, rays[row])
            row += 1
    rays[2, 0], rays[2, 1], rays[2, 2] = 0.0, 0.0, 1.0  # any ray: g1 does not use it
    invariants(rays, block[VALUE])
    spot_gradient(rays, f, jacobian, block[WORK : WORK + 9])
    return _noise_from_jacobian(block, jacobian[0:1])


@kernel
def prepare(block: Matrix, x: Vector, spots: Matrix) -> tuple[int, int, int]:
    """Decide what of the image is used and with which noise, at the predicted state x.

    Returns (groups seen, rows usable, Status code). Rows of H in use have VARIANCE > 0. A group is what the gate
    takes or leaves as one: a beacon, or the whole fix.
    """
    variance = block[VARIANCE]
    sensor, c, image = block[SENSOR], block[POINT], block[IMAGE]
    seen, whole, usable, status = 0, 0, 0, OK
    for m in range(6):
        variance[m] = 0.0
    for i in range(3):
        present, good, off = False, 0, False
        for k in range(2):
            value = spots[i, k]
            if value == value:
                present = True
                if coordinate_usable(value, sensor[1 + k]):
                    variance[2 * i + k] = sensor[3] * sensor[3]
                    good += 1
                else:
                    off = True
        if off:
            variance[2 * i], variance[2 * i + 1] = 0.0, 0.0
            good, status = 0, OFF_DETECTOR
        if present:
            seen += 1
        if good == 2:
            whole += 1
        usable += good
    if uses_coordinates(block):
        for i in range(3):
            beacon_in_camera(block, x, i, c)
            if not project(c, sensor[0], image):
                for k in range(2):
                    if variance[2 * i + k] > 0.0:
                        usable -= 1
                        variance[2 * i + k] = 0.0
                        status = BEHIND
        return seen, usable, status if seen > 0 else NOT_SEEN
    if seen == 0:
        return 0, 0, NOT_SEEN
    for m in range(6):
        variance[m] = 0.0
    pair = block[SETTINGS, 1] == SPOTS and seen == 2 and whole == 2 and prior_is_tight(block, x)
    if pair:
        if _prepare_pair(block, spots):
            return 1, 1, OK
        return 1, 0, DEGENERATE
    status = _prepare_fix(block, x, spots)
    if status == OK:
        return 1, 3, OK
    for m in range(6):
        variance[m] = 0.0
    return 0 if status == NOT_SEEN else 1, 0, status


@kernel
def _linearise_coordinates(block: Matrix, x: Vector, spots: Matrix) -> bool:
    f, c, image, row = block[SENSOR, 0], block[POINT], block[IMAGE], block[LOCAL]
    for i in range(3):
        if not (block[VARIANCE, 2 * i] > 0.0 or block[VARIANCE, 2 * i + 1] > 0.0):
            continue
        beacon_in_camera(block, x, i, c)
        if not project(c, f, image):
            return False
        for k in range(2):
            m = 2 * i + k
            project_jacobian_row(c, f, k, row)
            for j in range(3):
                total = 0.0
                for q in range(3):
                    total -= row[q] * block[ATTITUDE + q, j]
                block[H + m, j] = total
                block[H + m, 3 + j] = 0.0
            block[RESIDUAL, m] = spots[i, k] - image[k]
    return True


@kernel
def _linearise_position(block: Matrix, x: Vector, spots: Matrix) -> bool:
    """`fix` and invariants: h and dh/dp in the docking frame, turned into the state's axes."""
    sensor, p, d, value = block[SENSOR], block[P_DOCK], block[JACOBIAN : JACOBIAN + 3], block[VALUE]
    predicted, distance, rays = block[POINT], block[IMAGE], block[RAYS : RAYS + 3]
    size = 0
    while size < 3 and block[VARIANCE, size] > 0.0:
        size += 1
    camera_position_dock(block, x, p)
    if block[SETTINGS, 1] == FIX:
        range_azimuth_elevation(p, predicted)
        if not range_azimuth_elevation_jacobian(p, d):
            return False
        for m in range(3):
            difference = value[m] - predicted[m]
            block[RESIDUAL, m] = wrap_angle(difference) if m > 0 else difference
    else:
        rays_from_position(p, sensor[4], sensor[5], rays, distance)
        if size == 1:  # a pair: put its two beacons first, so that g1 is its chord
            missing = _unseen(spots)
            row = 0
            for i in range(3):
                if i != missing:
                    distance[row] = distance[i]
                    for j in range(3):
                        rays[row, j] = rays[i, j]
                    row += 1
        invariants(rays, predicted)
        position_gradient(rays, distance, d, block[WORK : WORK + 9])
        for m in range(size):
            block[RESIDUAL, m] = value[m] - predicted[m]
    for m in range(size):
        for j in range(3):
            total = 0.0
            for q in range(3):
                total += d[m, q] * block[DOCK + q, j]
            block[H + m, j] = total
            block[H + m, 3 + j] = 0.0
    return True


@kernel
def linearise(block: Matrix, x: Vector, spots: Matrix) -> bool:
    """Write residuals and rows of H at the state x for the rows in use; False if the image is impossible there."""
    if uses_coordinates(block):
        return _linearise_coordinates(block, x, spots)
    return _linearise_position(block, x, spots)


@kernel
def make_independent(block: Matrix) -> None:
    """Turn correlated rows into independent ones: residuals and H by L^-1 (no work for detector coordinates)."""
    if uses_coordinates(block):
        return
    for m in range(3):
        if not block[VARIANCE, m] > 0.0:
            return
        for k in range(m):
            entry = block[R_FACTOR + m, k]
            block[RESIDUAL, m] -= entry * block[RESIDUAL, k]
            for j in range(6):
                block[H + m, j] -= entry * block[H + k, j]
