"""What one sigma of a lasting error does to what the beacons' sensor measures: columns of `beacon_considered.py`."""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import anywhere
from relnav.geometry.linear_algebra import invert_three
from relnav.geometry.spherical import range_azimuth_elevation_jacobian
from relnav.navigation.blocks import ATTITUDE_ERRORS, FIELD_ERRORS, NODES, TOLERANCES_SHARED
from relnav.navigation.memory import FIX, Memory
from relnav.navigation.observation.beacon_geometry import camera_position_dock
from relnav.sensors.three_beacon.fix import COORDINATES
from relnav.sensors.three_beacon.invariants import beacon_gradients, position_gradient, rays_from_position

TOLERANCES = FIELD_ERRORS + ATTITUDE_ERRORS
"""The first of them among the lasting errors."""


@kernel
def _cross(sigma: float, a: Vector, b: Vector, out: Vector) -> None:
    """Write sigma a x b into out (3,)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = sigma * (a[j] * b[k] - a[k] * b[j])


@kernel
def _displacement(m: Memory, beacon: int, tolerance: int, sight: Vector, arm: Vector, out: Vector) -> bool:
    """Write by how much one sigma of a tolerance seems to move a beacon, `lvlh_ccsds` m; False if not at all.

    sight: from the camera to the beacon; arm: from the port to the beacon.
    """
    sigma, mount, dock = m.tolerances, m.kept["mount"], m.kept["dock"]
    if tolerance == 0:  # a longer focal length moves what is off the axis outward
        boresight, along = mount[2], 0.0
        for i in range(3):
            along += boresight[i] * sight[i]
        for i in range(3):
            out[i] = sigma["focal_length"] * (sight[i] - along * boresight[i])
    elif tolerance < 4:
        _cross(-sigma["camera_mounting"], mount[tolerance - 1], sight, out)
    elif tolerance < TOLERANCES_SHARED:
        _cross(sigma["beacon_mounting"], dock[tolerance - 4], arm, out)
    else:
        axis = tolerance - TOLERANCES_SHARED - 3 * beacon
        if axis < 0 or axis > 2:
            return False
        for i in range(3):
            out[i] = sigma["beacon_placement"] * dock[axis, i]
    return True


@kernel
def place_in_field(sensor: Record, spot: Vector, place: Vector) -> None:
    """Write a spot's (2,) m cell and the weights of its nodes, along x and y: place (6,) = i, j, x x, y y."""
    center, half_width = sensor["field_center"], sensor["field_half_width"]
    for axis in range(2):
        u = (spot[axis] - center[axis]) / half_width[axis]
        along = 0.5 * (NODES - 1) * (max(-1.0, min(1.0, u)) + 1.0) if u == u else 0.0
        cell = min(math.floor(along), NODES - 2.0)
        part = along - cell
        norm = math.sqrt(part * part + (1.0 - part) * (1.0 - part))
        place[axis] = cell
        place[2 + 2 * axis] = (1.0 - part) / norm
        place[3 + 2 * axis] = part / norm


@kernel
def _weight(place: Vector, error: int) -> float:
    """Weight of an error of the field for the spot at this place; which axis it is of does not matter."""
    node = error % (NODES * NODES)
    i, j = node // NODES - int(place[0]), node % NODES - int(place[1])
    if i < 0 or i > 1 or j < 0 or j > 1:
        return 0.0
    return float(place[2 + i] * place[4 + j])


@kernel
def _sight_and_arm(m: Memory, x: Vector, beacon: int, sight: Vector, arm: Vector) -> None:
    """Write where a beacon is, (3,) m in `lvlh_ccsds`: from the camera of the state x, and from the port."""
    position, dock, offset = m.beacons[beacon]["position"], m.kept["dock"], m.sensor["offset"]
    for i in range(3):
        arm[i] = position[i] - dock[i, 3]
        sight[i] = arm[i] - x[i] - offset[i]


@straight_line(x=(3,), mount=(3, 4), position=(3,), gradient=(2, 3), turns=(2, 3))
def _rows_by_turn(x: Vector, mount: Matrix, position: Vector, gradient: Matrix, turns: Matrix) -> None:
    """Write what a turn of the chaser about each axis of the camera does to a beacon's two coordinates.

    About its centre of mass, by an axis a it seems to move the beacon by -a x d, d from there: -h (-a x d) = a (d x h).
    """
    d, w = np.zeros(3), np.zeros(3)
    for i in range(3):
        d[i] = position[i] - x[i]
    for k in range(2):
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            w[i] = d[p] * gradient[k, q] - d[q] * gradient[k, p]
        for axis in range(3):
            turns[k, axis] = mount[axis, 0] * w[0] + mount[axis, 1] * w[1] + mount[axis, 2] * w[2]


@kernel
def errors_of_spot(
    m: Memory, x: Vector, beacon: int, spot: Vector, gradient: Matrix, x_row: Vector, y_row: Vector
) -> None:
    """Write a beacon's two rows of `turns`, and its two coordinates by every error, (m,) each; gradient (2, 3) at x.

    A turn of the chaser, about its centre of mass, or a tolerance acts as if it moved the beacon, by delta: on a
    coordinate it does -h delta, h its row of H.
    """
    vectors, place, first = m.scratch["vectors"], m.scratch["places"][0], m.fixed["first_error"]
    sight, arm, moved, mount = vectors[0], vectors[1], vectors[2], m.kept["mount"]
    attitude_sigma, lasting = m.sensor["attitude_sigma"], m.beacons[beacon]["lasting_sigma"]
    _sight_and_arm(m, x, beacon, sight, arm)
    _rows_by_turn(x, mount, m.beacons[beacon]["position"], gradient, m.turns[2 * beacon : 2 * beacon + 2])
    if first < FIELD_ERRORS:
        place_in_field(m.sensor, spot, place)
    for j in range(x_row.shape[0]):
        error = first + j
        x_row[j], y_row[j] = 0.0, 0.0
        if error < FIELD_ERRORS:
            weight = lasting * _weight(place, error)
            if error < NODES * NODES:
                x_row[j] = weight
            else:
                y_row[j] = weight
        elif error < TOLERANCES:
            x_row[j] = attitude_sigma * m.turns[2 * beacon, error - FIELD_ERRORS]
            y_row[j] = attitude_sigma * m.turns[2 * beacon + 1, error - FIELD_ERRORS]
        elif _displacement(m, beacon, error - TOLERANCES, sight, arm, moved):
            h = gradient[0]
            x_row[j] = -(h[0] * moved[0] + h[1] * moved[1] + h[2] * moved[2])
            h = gradient[1]
            y_row[j] = -(h[0] * moved[0] + h[1] * moved[1] + h[2] * moved[2])


@kernel
def errors_of_coordinates(m: Memory, x: Vector, spots: Matrix) -> None:
    """Write `turns` and `by_error` of the coordinates in use, linearised at x (6,); spots (n, 2) m."""
    for i in range(m.beacons.shape[0]):
        variance, gradient = m.groups[i]["variance"], m.groups[i]["gradient"]
        if anywhere((variance[0] > 0.0) | (variance[1] > 0.0)):
            errors_of_spot(m, x, i, spots[i], gradient, m.by_error[2 * i], m.by_error[2 * i + 1])


@kernel
def errors_of_position(m: Memory, x: Vector, spots: Matrix) -> None:
    """Write `by_error` of the independent rows of a fix or of invariants at x (6,): L^-1 of the numbers' errors."""
    factor, by_beacon, places = m.fix["factor"], m.scratch["by_beacon"], m.scratch["places"]
    e, p = m.scratch["vectors"][0], m.scratch["vectors"][1]
    camera_position_dock(x, m.sensor["offset"], m.kept["dock"], p)
    regular = numbers_by_beacon(m, p, m.scratch["gradients"], by_beacon)
    for i in range(3):
        if m.fixed["first_error"] < FIELD_ERRORS:
            place_in_field(m.sensor, spots[i], places[i])
    for j in range(m.by_error.shape[1]):
        for r in range(3):
            m.by_error[r, j] = 0.0
        if regular:
            error_of_numbers(m, spots, places, m.fix["jacobian"], by_beacon, m.fixed["first_error"] + j, e)
            for r in range(3):
                for k in range(r):
                    e[r] -= factor[r, k] * e[k]
                m.by_error[r, j] = e[r]


@kernel
def _arm_of_turn(m: Memory, axis: int, by_beacon: Matrix, number: int) -> float:
    """Number by a turn of the chaser about a camera axis, which swings the arm from its centre of mass to the camera.

    The state's camera is at x + mount^T lever: it moves by mount^T (e x lever), which is as if A, B, C moved back.
    """
    mount, dock, total = m.kept["mount"], m.kept["dock"], 0.0
    j, k = (axis + 1) % 3, (axis + 2) % 3
    for i in range(3):
        along = 0.0
        for c in range(3):
            along += dock[i, c] * (mount[k, c] * mount[j, 3] - mount[j, c] * mount[k, 3])
        for beacon in range(3):
            total -= by_beacon[3 * number + beacon, i] * along
    return total


@kernel
def error_of_numbers(
    m: Memory, spots: Matrix, places: Matrix, jacobian: Matrix, by_beacon: Matrix, j: int, out: Vector
) -> None:
    """Write what one sigma of error j does to three numbers that come of the spots of A, B and C, (n, 2) m.

    places (3, 6): of the spots in the field; jacobian (3, 6): the numbers by the spots; by_beacon (9, 3): number m by
    beacon i in row 3 m + i, docking axes.
    """
    sigma, a, b = m.tolerances, m.sensor["half_spacing"], m.sensor["c_distance"]
    tolerance, axis = j - TOLERANCES, j // (NODES * NODES)
    for r in range(3):
        out[r] = 0.0
        if j < FIELD_ERRORS:
            for i in range(3):
                if jacobian[r, 2 * i + axis] != 0.0:
                    out[r] += jacobian[r, 2 * i + axis] * m.beacons[i]["lasting_sigma"] * _weight(places[i], j)
        elif tolerance < 0:
            out[r] = m.sensor["attitude_sigma"] * _arm_of_turn(m, j - FIELD_ERRORS, by_beacon, r)
        elif tolerance == 0:
            for k in range(COORDINATES):
                if jacobian[r, k] != 0.0:
                    out[r] += sigma["focal_length"] * jacobian[r, k] * spots[k // 2, k % 2]
        elif 4 <= tolerance < TOLERANCES_SHARED:  # e_axis x (A = a e_y, B = -a e_y, C = b e_x), docking axes
            of_a, of_b, of_c = by_beacon[3 * r], by_beacon[3 * r + 1], by_beacon[3 * r + 2]
            if tolerance == 4:
                out[r] = sigma["beacon_mounting"] * a * (of_a[2] - of_b[2])
            elif tolerance == 5:
                out[r] = -sigma["beacon_mounting"] * b * of_c[2]
            else:
                out[r] = sigma["beacon_mounting"] * (b * of_c[1] - a * (of_a[0] - of_b[0]))
        elif TOLERANCES_SHARED <= tolerance < TOLERANCES_SHARED + 9:
            moved = tolerance - TOLERANCES_SHARED
            out[r] = sigma["beacon_placement"] * by_beacon[3 * r + moved // 3, moved % 3]


@kernel
def _pair_gradients(jacobian: Matrix, u: Matrix, distance: Vector, out: Matrix) -> None:
    """Write d|u_i - u_j|^2 / d beacon into rows 0 to 2 of out; i, j: the two that the jacobian's first row sees."""
    for beacon in range(3):
        for k in range(3):
            out[beacon, k] = 0.0
        if jacobian[0, 2 * beacon] != 0.0 or jacobian[0, 2 * beacon + 1] != 0.0:
            other = (beacon + 1) % 3
            if jacobian[0, 2 * other] == 0.0 and jacobian[0, 2 * other + 1] == 0.0:
                other = (beacon + 2) % 3
            along = 0.0
            for k in range(3):
                along += (u[beacon, k] - u[other, k]) * u[beacon, k]
            for k in range(3):
                out[beacon, k] = 2.0 * (u[beacon, k] - u[other, k] - along * u[beacon, k]) / distance[beacon]


@kernel
def _multiply_numbers(m: Matrix, by_beacon: Matrix, product: Vector) -> None:
    """Turn the three numbers of by_beacon (9, 3) into m (3, 3) times them, in place."""
    for beacon in range(3):
        for k in range(3):
            for i in range(3):
                product[i] = 0.0
                for j in range(3):
                    product[i] += m[i, j] * by_beacon[3 * j + beacon, k]
            for i in range(3):
                by_beacon[3 * i + beacon, k] = product[i]


@kernel
def position_by_beacon(sensor: Record, p: Vector, work: Matrix, out: Matrix) -> bool:
    """Write by how much the fix at p, docking frame, is off as beacons A, B, C move: (dg/dp)^-1 dg/db, out (9, 3)."""
    u, distance, gradient, inverse = work[0:3], work[3], work[4:7], work[7:10]
    rays_from_position(p, sensor["half_spacing"], sensor["c_distance"], u, distance)
    beacon_gradients(u, distance, out)
    position_gradient(u, distance, gradient)
    if not invert_three(gradient, inverse):
        return False
    _multiply_numbers(inverse, out, work[10])
    return True


@kernel
def numbers_by_beacon(m: Memory, p: Vector, work: Matrix, out: Matrix) -> bool:
    """Write what the measured numbers do as beacons A, B, C move, seen from p, docking frame; out (9, 3)."""
    sensor = m.sensor
    if sensor["method"] == FIX:
        if not position_by_beacon(sensor, p, work, out) or not range_azimuth_elevation_jacobian(p, work[0:3]):
            return False
        _multiply_numbers(work[0:3], out, work[3])
        return True
    u, distance = work[0:3], work[3]
    rays_from_position(p, sensor["half_spacing"], sensor["c_distance"], u, distance)
    if m.groups[0]["variance"][1] > 0.0:
        beacon_gradients(u, distance, out)
    else:
        _pair_gradients(m.fix["jacobian"], u, distance, out)
    return True
