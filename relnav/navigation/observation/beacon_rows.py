"""What one image of the beacons says of the state: residuals, measurement rows and noise, for each method.

`spots`, attitude known: the detector coordinates, h(x) = central projection of each beacon; a group a beacon.
`spots`, attitude unknown: the attitude-free invariants of the rays (three beacons: three, two beacons: one).
`fix`: range, azimuth and elevation of the closed form, with R = J S J^T evaluated at the PREDICTED geometry: at the
measured spots R would depend on their noise, and fewer epochs stay consistent. Only while the prediction is no better
than a guess (sigma above 2 % of the range, and above that of one image) is R taken at the fix itself. From a good
prediction the fix is found by Newton's method alone: it is the same root as that of the closed form's passes, which
are needed from nowhere.

Rows of a beacon are independent. Those of a fix or of invariants are one group, correlated: they are kept as L^-1 z and
L^-1 H with R = L diag(variance) L^T.
"""

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import anywhere, held, select
from relnav.estimation.factored import decorrelate
from relnav.estimation.rows import say_nothing
from relnav.geometry.spherical import docking_difference, range_azimuth_elevation_jacobian
from relnav.navigation.memory import FIX, SPOTS, Memory
from relnav.navigation.observation.beacon_arm import add_arm_noise
from relnav.navigation.observation.beacon_geometry import (
    camera_position_dock,
    fix_of_spots,
    implied_attitude,
    prior_beats_image,
    prior_is_tight,
    see_beacon,
    uses_coordinates,
)
from relnav.sensors.measurement import BEHIND, DEGENERATE, NO_CONVERGENCE, NOT_SEEN, OFF_DETECTOR, OK, OUTSIDE_DOMAIN
from relnav.sensors.three_beacon.fix import COORDINATES, PERSPECTIVE, image_rays, image_usable
from relnav.sensors.three_beacon.implied import turn_of_rays
from relnav.sensors.three_beacon.invariants import invariants, position_gradient, rays_from_position, spot_gradient
from relnav.sensors.three_beacon.parallel import solve_parallel_jacobian
from relnav.sensors.three_beacon.perspective import (
    gradient_inverse,
    implicit_jacobian,
    inside_domain,
    newton_step,
    settle,
)


@kernel
def take_in_coordinates(sensor: Record, beacons: Record, groups: Record, spots: Matrix) -> tuple[int, int, int]:
    """Decide which coordinates of the spots (n, 2) m can be used; (beacons seen, coordinates usable, Status code)."""
    seen, usable, status = 0, 0, OK
    half = sensor["half_width"]
    for i in range(beacons.shape[0]):
        sigma, variance = beacons[i]["spot_sigma"], groups[i]["variance"]
        groups[i]["tested"], groups[i]["rows"] = 1, 2
        x, y = spots[i, 0], spots[i, 1]
        on_x, on_y = abs(x) <= half[0], abs(y) <= half[1]
        beside = ((x == x) & (not on_x)) | ((y == y) & (not on_y))
        on_x, on_y, status = on_x & (not beside), on_y & (not beside), select(beside, OFF_DETECTOR, status)
        variance[0], variance[1] = select(on_x, sigma[0] * sigma[0], 0.0), select(on_y, sigma[1] * sigma[1], 0.0)
        seen = select((x == x) | (y == y), seen + 1, seen)
        usable = usable + select(on_x, 1, 0) + select(on_y, 1, 0)
    return seen, usable, select(seen > 0, status, NOT_SEEN)


@kernel
def linearise_coordinates(
    sensor: Record, mount: Matrix, beacons: Record, groups: Record, x: Vector, spots: Matrix
) -> int:
    """Write residuals and rows of the beacons in use at x; returns how many coordinates are behind (dropped)."""
    f, dropped = sensor["focal_length"], 0
    for i in range(beacons.shape[0]):
        group = groups[i]
        variance = group["variance"]
        used = (variance[0] > 0.0) | (variance[1] > 0.0)
        if anywhere(used):
            depth = see_beacon(x, mount, beacons[i]["position"], f, spots[i], group["residual"], group["gradient"])
            used = held(used)
            behind = used & (not depth > 0.0)
            if anywhere(behind):
                for k in range(2):
                    dropped = select(behind & (variance[k] > 0.0), dropped + 1, dropped)
                    variance[k] = select(behind, 0.0, variance[k])
            say_nothing(group, behind | (not used))
    return dropped


@straight_line(jacobian=(3, COORDINATES), sigma=(3, 3), factor=(3, 3), variances=(3,))
def correlated_noise(jacobian: Matrix, sigma: Matrix, factor: Matrix, variances: Vector) -> bool:
    """Write L and d of R = J S J^T = L diag(d) L^T; sigma: a row a beacon, of its noise x, y, and lasting error."""
    r, weighted = np.zeros((3, 3)), np.zeros((3, COORDINATES))
    for k in range(COORDINATES):
        own, lasting = sigma[k // 2, k % 2], sigma[k // 2, 2]
        variance = own * own + lasting * lasting
        for i in range(3):
            weighted[i, k] = jacobian[i, k] * variance
    for i in range(3):
        for j in range(i + 1):
            for k in range(COORDINATES):
                r[i, j] += weighted[i, k] * jacobian[j, k]
    return decorrelate(r, factor, variances)


@straight_line(
    p=(3,), inverse=(3, 3), u=(3, 3), sigma=(3, 3), jacobian=(3, COORDINATES), factor=(3, 3), variances=(3,)
)  # fmt: skip
def fix_noise(
    p: Vector,
    inverse: Matrix,
    u: Matrix,
    f: float,
    sigma: Matrix,
    jacobian: Matrix,
    factor: Matrix,
    variances: Vector,
) -> bool:
    """Write J = d(range, azimuth, elevation) / d spots at p, seen along camera-frame rays u, and L, d of their noise.

    inverse (3, 3) is (dg/dp)^-1 at p. False where singular.
    """
    to_angles, to_position = np.zeros((3, 3)), np.zeros((3, COORDINATES))
    regular = range_azimuth_elevation_jacobian(p, to_angles)
    implicit_jacobian(inverse, u, f, to_position)
    for i in range(3):
        for k in range(COORDINATES):
            total = 0.0
            for j in range(3):
                total += to_angles[i, j] * to_position[j, k]
            jacobian[i, k] = total
    return regular & correlated_noise(jacobian, sigma, factor, variances)


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
def spot_sigmas(beacons: Record, sigma: Matrix) -> None:
    """Write the sigmas of the spots of A, B and C, rows (x, y, lasting), into sigma (3, 3)."""
    for i in range(3):
        own = beacons[i]["spot_sigma"]
        sigma[i, 0], sigma[i, 1], sigma[i, 2] = own[0], own[1], beacons[i]["lasting_sigma"]


@kernel
def _attitude_of_image(sensor: Record, fix: Record, dcm: Matrix, work: Matrix) -> bool:
    """Write into dcm the rotation (triad) that turns the rays of the fix into the measured ones. work (14, 3)."""
    a, b = sensor["half_spacing"], sensor["c_distance"]
    return bool(turn_of_rays(fix["rays"], fix["position"], a, b, dcm, work))


@kernel
def _fix_near_prediction(m: Memory, place: Vector, work: Matrix, spots: Matrix, whole: bool) -> int:
    """Position of the image by Newton's method from the predicted place; NO_CONVERGENCE if that does not settle.

    Where an image is not whole what is predicted takes its place: it is not taken in.
    """
    sensor, fix = m.sensor, m.fix
    p, rays, inverse, g = fix["position"], fix["rays"], fix["inverse"], fix["value"]
    a, b = sensor["half_spacing"], sensor["c_distance"]
    image_rays(spots, sensor["focal_length"], rays)
    if anywhere(not whole):
        rays_in_camera(place, a, b, sensor["cam_from_dock"], work)
        for i in range(3):
            for j in range(3):
                rays[i, j] = select(whole, rays[i, j], work[i, j])
    invariants(rays, g)
    p[0], p[1], p[2] = place[0], place[1], place[2]
    regular, _, _ = newton_step(g, a, b, p, inverse, 1.0)
    if not regular or not settle(g, a, b, p, work):
        return NO_CONVERGENCE
    if not inside_domain(p, b):
        return OUTSIDE_DOMAIN
    return implied_attitude(sensor, m.beacons, rays, p)


@kernel
def _prepare_position(m: Memory, spots: Matrix, whole: bool) -> int:
    """Take the closed form (or its invariants) of whole images as the measurement, noise at the predicted geometry."""
    sensor, fix, scratch, place = m.sensor, m.fix, m.scratch, m.prior["place"]
    factor, variance, jacobian, inverse = fix["factor"], m.groups[0]["variance"], fix["jacobian"], fix["inverse"]
    f, a, b = sensor["focal_length"], sensor["half_spacing"], sensor["c_distance"]
    sigma, rays = scratch["three"], scratch["rays"]
    exact = sensor["projection"] == PERSPECTIVE
    tight = prior_is_tight(m.prior)
    status = _fix_near_prediction(m, place, rays, spots, whole) if exact and tight else NO_CONVERGENCE
    near = status == OK
    if status in (NO_CONVERGENCE, OUTSIDE_DOMAIN):
        status = fix_of_spots(sensor, m.beacons, scratch["closed_form"], spots, fix["position"], fix["rays"])
    if status != OK:
        return status
    p = place if tight or prior_beats_image(m) else fix["position"]
    if not (near or gradient_inverse(p, a, b, inverse)):
        return NO_CONVERGENCE
    dcm = sensor["cam_from_dock"]
    if sensor["attitude_known"] == 0:
        dcm = scratch["turn"]
        if not _attitude_of_image(sensor, fix, dcm, scratch["triads"]):
            return NO_CONVERGENCE
    if not rays_in_camera(p, a, b, dcm, rays):
        return NO_CONVERGENCE
    spot_sigmas(m.beacons, sigma)
    if sensor["method"] == FIX and exact:
        if not fix_noise(p, inverse, rays, f, sigma, jacobian, factor, variance):
            return DEGENERATE
        return OK if add_arm_noise(m, p, factor, variance) else DEGENERATE
    if sensor["method"] == FIX:
        predicted = scratch["numbers"]
        for i in range(3):
            predicted[i, 0] = f * rays[i, 0] / rays[i, 2]
            predicted[i, 1] = f * rays[i, 1] / rays[i, 2]
        if not solve_parallel_jacobian(predicted, f, a, b, jacobian):
            return NO_CONVERGENCE
    else:
        invariants(fix["rays"], fix["value"])
        spot_gradient(rays, f, jacobian)
    if not correlated_noise(jacobian, sigma, factor, variance):
        return DEGENERATE
    return OK if sensor["method"] == SPOTS or add_arm_noise(m, p, factor, variance) else DEGENERATE


@kernel
def _unseen(spots: Matrix) -> int:
    """Number of the one beacon that is not seen at all; the last such if there are more."""
    out = 3
    for i in range(3):
        if spots[i, 0] != spots[i, 0] and spots[i, 1] != spots[i, 1]:
            out = i
    return out


@kernel
def _prepare_pair(m: Memory, spots: Matrix) -> bool:
    """Two beacons, attitude unknown: one number, the squared chord |u_i - u_j|^2 between their rays.

    Only from a tight prior: the angle bends by (dx / r)^2 / 2 of itself, 2e-4 then, beside noise of 1e-2 in one image.
    From a wide one (after a long gap) it would make the filter overconfident; it then waits for three beacons.
    """
    f, rays, jacobian, scratch = m.sensor["focal_length"], m.fix["rays"], m.fix["jacobian"], m.scratch["pair"]
    missing, row = _unseen(spots), 0
    image_rays(spots, f, scratch)
    for i in range(3):
        if i != missing:
            for j in range(3):
                rays[row, j] = scratch[i, j]
            row += 1
    rays[2, 0], rays[2, 1], rays[2, 2] = 0.0, 0.0, 1.0  # any ray: g1 does not use it
    invariants(rays, m.fix["value"])
    spot_gradient(rays, f, jacobian)
    variance, column = 0.0, 4
    for i in range(2, -1, -1):
        sigma, lasting = m.beacons[i]["spot_sigma"], m.beacons[i]["lasting_sigma"]
        for k in range(1, -1, -1):
            if i == missing:
                jacobian[0, 2 * i + k] = 0.0
            else:  # from the column among the two rays to the beacon's own
                column -= 1
                jacobian[0, 2 * i + k] = jacobian[0, column]
                variance += jacobian[0, column] ** 2 * (sigma[k] ** 2 + lasting**2)
    m.groups[0]["variance"][0] = variance
    return variance > 0.0


@kernel
def _sees_a_pair(spots: Matrix, half: Vector) -> bool:
    """Whether two spots are there and the third is not."""
    seen, whole = 0, 0
    for i in range(3):
        x, y = spots[i, 0], spots[i, 1]
        seen = select((x == x) | (y == y), seen + 1, seen)
        whole = select((abs(x) <= half[0]) & (abs(y) <= half[1]), whole + 1, whole)
    pair: bool = (seen == 2) & (whole == 2)
    return pair


@kernel
def prepare_position(m: Memory, spots: Matrix) -> tuple[int, int, int]:
    """Decide what a fix or invariants of the image give, and with which noise, at the predicted place.

    Returns (groups seen, rows usable, Status code): the whole image is one group.
    """
    group, half = m.groups[0], m.sensor["half_width"]
    variance = group["variance"]
    variance[0], variance[1], variance[2] = 0.0, 0.0, 0.0
    group["rows"], group["tested"] = 3, 1
    if m.sensor["method"] == SPOTS and _sees_a_pair(spots, half) and prior_is_tight(m.prior):
        if _prepare_pair(m, spots):
            return 1, 1, OK
        return 1, 0, DEGENERATE
    status = image_usable(spots, half[0], half[1])
    whole = status == OK
    if anywhere(whole):
        whole = held(whole)
        found = _prepare_position(m, spots, whole)
        status, whole = select(whole, found, status), whole & (found == OK)
        for k in range(3):
            variance[k] = select(whole, variance[k], 0.0)
    return select(status == NOT_SEEN, 0, 1), select(status == OK, 3, 0), status


@straight_line(p=(3,), fix=(3,), dock=(3, 4), factor=(3, 3), h=(3, COORDINATES), residual=(3,), innovation=(3,))
def fix_rows(
    p: Vector, fix: Vector, dock: Matrix, factor: Matrix, h: Matrix, residual: Vector, innovation: Vector
) -> bool:
    """Write the independent rows of (range, azimuth, elevation) at p, and the residuals of the fix, both kinds."""
    to_angles, difference = np.zeros((3, 3)), np.zeros(3)
    regular = range_azimuth_elevation_jacobian(p, to_angles)
    docking_difference(fix, p, difference)
    for m in range(3):
        innovation[m] = difference[m]
        residual[m] = difference[m]
        for k in range(m):
            residual[m] -= factor[m, k] * residual[k]
        for j in range(3):
            h[m, j] = to_angles[m, 0] * dock[0, j] + to_angles[m, 1] * dock[1, j] + to_angles[m, 2] * dock[2, j]
            for k in range(m):
                h[m, j] -= factor[m, k] * h[k, j]
    return regular


@kernel
def _linearise_invariants(m: Memory, p: Vector, spots: Matrix) -> None:
    """Write the independent rows of the invariants (three, or one of a pair) at p (3,), docking frame."""
    sensor, group, vectors, dock = m.sensor, m.groups[0], m.scratch["vectors"], m.kept["dock"]
    rays, distance, predicted, d = m.scratch["rays"], vectors[0], vectors[1], m.scratch["three"]
    residual, innovation, h, factor = group["residual"], group["innovation"], group["gradient"], m.fix["factor"]
    size = 3 if group["variance"][1] > 0.0 else 1
    rays_from_position(p, sensor["half_spacing"], sensor["c_distance"], rays, distance)
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
    for r in range(size):
        innovation[r] = m.fix["value"][r] - predicted[r]
        residual[r] = innovation[r]
        for k in range(r):
            residual[r] -= factor[r, k] * residual[k]
        for j in range(3):
            total = 0.0
            for q in range(3):
                total += d[r, q] * dock[q, j]
            for k in range(r):
                total -= factor[r, k] * h[k, j]
            h[r, j] = total


@kernel
def linearise_position(m: Memory, x: Vector, spots: Matrix) -> bool:
    """Write the independent rows of the fix or the invariants at the state x; False if there are none there."""
    p, dock, group = m.scratch["vectors"][2], m.kept["dock"], m.groups[0]
    camera_position_dock(x, m.sensor["offset"], dock, p)
    if m.sensor["method"] == FIX:
        h, residual, innovation = group["gradient"], group["residual"], group["innovation"]
        return bool(fix_rows(p, m.fix["position"], dock, m.fix["factor"], h, residual, innovation))
    _linearise_invariants(m, p, spots)
    return True


@kernel
def observe(m: Memory, x: Vector, spots: Matrix) -> tuple[int, int, int]:
    """Decide what of the image is used and with which noise, and linearise it, at the predicted state x (and prior).

    Returns (groups seen, rows usable, Status code).
    """
    if uses_coordinates(m.sensor):
        seen, usable, reason = take_in_coordinates(m.sensor, m.beacons, m.groups, spots)
        dropped = linearise_coordinates(m.sensor, m.kept["mount"], m.beacons, m.groups, x, spots)
        return seen, usable - dropped, BEHIND if dropped > 0 else reason
    seen, usable, reason = prepare_position(m, spots)
    if anywhere(usable > 0):
        if not linearise_position(m, x, spots):
            usable = 0
        say_nothing(m.groups[0], usable == 0)
    return seen, usable, reason


@kernel
def observe_again(m: Memory, x: Vector, spots: Matrix) -> bool:
    """Linearise what is in use at another state; False if the image is impossible there."""
    if uses_coordinates(m.sensor):
        return linearise_coordinates(m.sensor, m.kept["mount"], m.beacons, m.groups, x, spots) == 0
    return linearise_position(m, x, spots)
