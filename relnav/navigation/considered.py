"""Errors that last are considered: not estimated, but carried in what is reported (Schmidt 1966).

A calibration leaves an error in every spot coordinate that stays while the spot hardly moves; focal length, mountings
and beacons are known to a tolerance. A filter that takes such an error for noise averages it, one that ignores it does
not know of it, and both become overconfident. Here the filter's own factors L D L^T remain those of what is new in
every image; beside them runs S (6, m), what one sigma of each error does to the estimate. It is linear in the
measurements, so S is carried as the estimate itself is:

    S = dx/dz E                         at a start from one image z, E what the errors do to it
    S <- Phi S                          from epoch to epoch
    S <- S + P+ H^T R^-1 (E - H S)      at an update, P+ after it
    S <- S + C (S later - Phi S)        smoothed (`smoothing.py`)

and P = L D L^T + S S^T is reported. For gate and gain R holds them too, as if they were new in every image: what is a
coordinate's own (its spot's, its beacon's place) whole, so that a bad one counts for less; what all share as far as
the state cannot take it up, (E - H S)^2. R of a fix, which the state takes up whole, holds what lasts in the spots.

Rows of `sensitivities` (m, 6), columns of S: what lasts in the coordinates A'x, A'y, B'x, ... of the n beacons; then,
if tolerances are considered: the focal length; turns of the camera about its axes; turns of the beacons about the
docking axes, at the port; every beacon along the docking axes. A tolerance acts as if it moved the beacons, by delta:
on a coordinate it does -h delta, h its row of H.
"""

import numpy as np

from relnav._kernel import kernel, straight_line
from relnav.arrays import Matrix, Vector
from relnav.estimation.factored import add_rank_one
from relnav.geometry.spherical import position_from_angles_jacobian, range_azimuth_elevation_jacobian
from relnav.navigation.block import (
    ATTITUDE,
    DOCK,
    FIX,
    GRADIENT,
    JACOBIAN,
    LAYOUT,
    OBSERVED,
    OFFSET,
    POSITION,
    R_FACTOR,
    SENSOR,
    SETTINGS,
    TOLERANCES,
    TOLERANCES_SHARED,
    VARIANCE,
    WORK,
    H,
    beacon_count,
    beacon_row,
)
from relnav.navigation.sight import camera_position_dock, uses_coordinates
from relnav.sensors.three_beacon.invariants import beacon_gradients, invert_three, position_gradient, rays_from_position


@straight_line(ld=(6, 6), columns=(3, 6))
def _position_columns(ld: Matrix, columns: Matrix) -> None:
    """Write the first three columns of P = L D L^T, of the position, as rows (3, 6)."""
    for k in range(3):
        for i in range(k, 6):
            total = ld[k, k] * (1.0 if i == k else ld[i, k])
            for m in range(k):
                total += ld[i, m] * ld[m, m] * ld[k, m]
            columns[k, i] = total
            if i < 3:
                columns[i, k] = total


@straight_line(row=(6,), columns=(3, 6), information=(3, 3), news=(3,))
def _update(row: Vector, columns: Matrix, information: Matrix, news: Vector) -> None:
    """Replace a row s by s + P+ (news - H^T R^-1 H s); rows H see the position only."""
    change = np.zeros(3)
    for i in range(3):
        change[i] = news[i]
        for j in range(3):
            change[i] -= information[i, j] * row[j]
    for i in range(6):
        row[i] += columns[0, i] * change[0] + columns[1, i] * change[1] + columns[2, i] * change[2]


@straight_line(information=(3, 3), h="***000")
def _inform(information: Matrix, h: Vector, variance: float) -> None:
    """Add h h^T / variance to the information (3, 3)."""
    for i in range(3):
        for j in range(3):
            information[i, j] += h[i] * h[j] / variance


@kernel
def _cross(sigma: float, a: Vector, b: Vector, out: Vector) -> None:
    """Write sigma a x b into out (3,)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = sigma * (a[j] * b[k] - a[k] * b[j])


@kernel
def _displacement(block: Matrix, beacon: int, tolerance: int, sight: Vector, arm: Vector, out: Vector) -> bool:
    """Write by how much one sigma of a tolerance seems to move a beacon, `lvlh_ccsds` m; False if not at all.

    sight: from the camera to the beacon; arm: from the port to the beacon.
    """
    sigma = block[TOLERANCES]
    if tolerance == 0:  # a longer focal length moves what is off the axis outward
        boresight, along = block[ATTITUDE + 2], 0.0
        for i in range(3):
            along += boresight[i] * sight[i]
        for i in range(3):
            out[i] = sigma[0] * (sight[i] - along * boresight[i])
    elif tolerance < 4:
        _cross(sigma[1], block[ATTITUDE + tolerance - 1], sight, out)
    elif tolerance < TOLERANCES_SHARED:
        _cross(sigma[2], block[DOCK + tolerance - 4], arm, out)
    else:
        axis = tolerance - TOLERANCES_SHARED - 3 * beacon
        if axis < 0 or axis > 2:
            return False
        for i in range(3):
            out[i] = sigma[3] * block[DOCK + axis, i]
    return True


@kernel
def _sight_and_arm(block: Matrix, x: Vector, beacon: int, sight: Vector, arm: Vector) -> None:
    position = block[beacon_row(block, beacon) + POSITION]
    for i in range(3):
        arm[i] = position[i] - block[DOCK + i, 3]
        sight[i] = arm[i] - x[i] - block[OFFSET, i]


@kernel
def add_considered_noise(block: Matrix, x: Vector, sensitivities: Matrix) -> None:
    """Add considered errors to the variance of every coordinate in use.

    sensitivities (m, 6) as predicted; rows linearised at x.
    """
    count, lasting = sensitivities.shape[0], 2 * beacon_count(block)
    if count == 0:
        return
    sight, arm, moved = block[WORK], block[WORK + 1], block[WORK + 2]
    place2 = block[TOLERANCES, 3] * block[TOLERANCES, 3]
    for beacon in range(beacon_count(block)):
        row = beacon_row(block, beacon)
        observed = block[row + OBSERVED]
        _sight_and_arm(block, x, beacon, sight, arm)
        for k in range(2):
            if observed[2 + k] > 0.0:
                h = block[row + GRADIENT + k]
                own = block[row + POSITION, 5] * block[row + POSITION, 5]
                observed[2 + k] += own + place2 * (h[0] * h[0] + h[1] * h[1] + h[2] * h[2])
                for j in range(lasting, min(count, lasting + TOLERANCES_SHARED)):
                    left, s = 0.0, sensitivities[j]
                    _displacement(block, beacon, j - lasting, sight, arm, moved)
                    for i in range(3):
                        left += h[i] * (moved[i] + s[i])
                    observed[2 + k] += left * left


@kernel
def news_of_coordinates(block: Matrix, x: Vector, information: Matrix, news: Matrix) -> None:
    """Write H^T R^-1 H (3, 3) of the coordinates in use, linearised at x, and a row of H^T R^-1 E for each error."""
    own, sight, arm, moved = block[WORK + 14 : WORK + 17], block[WORK + 17], block[WORK + 18], block[WORK + 19]
    lasting = 2 * beacon_count(block)
    for i in range(3):
        for j in range(3):
            information[i, j] = 0.0
        for j in range(news.shape[0]):
            news[j, i] = 0.0
    for beacon in range(beacon_count(block)):
        row = beacon_row(block, beacon)
        for i in range(3):
            for j in range(3):
                own[i, j] = 0.0
        for k in range(2):
            variance = block[row + OBSERVED, 2 + k]
            if variance > 0.0:
                h = block[row + GRADIENT + k]
                _inform(own, h, variance)
                for i in range(3):
                    news[2 * beacon + k, i] = h[i] * block[row + POSITION, 5] / variance
        _sight_and_arm(block, x, beacon, sight, arm)
        for j in range(lasting, news.shape[0]):
            if _displacement(block, beacon, j - lasting, sight, arm, moved):
                for i in range(3):
                    news[j, i] -= own[i, 0] * moved[0] + own[i, 1] * moved[1] + own[i, 2] * moved[2]
        for i in range(3):
            for j in range(3):
                information[i, j] += own[i, j]


@kernel
def _error_of_numbers(block: Matrix, spots: Matrix, jacobian: Matrix, by_beacon: Matrix, j: int, out: Vector) -> None:
    """Write what one sigma of error j does to three numbers that come of the spots of A, B and C, (n, 2) m.

    jacobian (3, 6): the numbers by the spots; by_beacon (9, 3): number m by beacon i in row 3 m + i, docking axes.
    """
    lasting, sigma = 2 * beacon_count(block), block[TOLERANCES]
    a, b = block[SENSOR, 4], block[SENSOR, 5]
    tolerance = j - lasting
    for m in range(3):
        out[m] = 0.0
        if j < 6 and j < lasting:
            out[m] = jacobian[m, j] * block[beacon_row(block, j // 2) + POSITION, 5]
        elif tolerance == 0:
            for k in range(6):
                if jacobian[m, k] != 0.0:
                    out[m] += sigma[0] * jacobian[m, k] * spots[k // 2, k % 2]
        elif 4 <= tolerance < TOLERANCES_SHARED:  # e_axis x (A = a e_y, B = -a e_y, C = b e_x), docking axes
            of_a, of_b, of_c = by_beacon[3 * m], by_beacon[3 * m + 1], by_beacon[3 * m + 2]
            if tolerance == 4:
                out[m] = sigma[2] * a * (of_a[2] - of_b[2])
            elif tolerance == 5:
                out[m] = -sigma[2] * b * of_c[2]
            else:
                out[m] = sigma[2] * (b * of_c[1] - a * (of_a[0] - of_b[0]))
        elif TOLERANCES_SHARED <= tolerance < TOLERANCES_SHARED + 9:
            moved = tolerance - TOLERANCES_SHARED
            out[m] = sigma[3] * by_beacon[3 * m + moved // 3, moved % 3]


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
def _position_by_beacon(block: Matrix, p: Vector, work: Matrix, out: Matrix) -> bool:
    """Write by how much the fix at p, docking frame, is off as beacons A, B, C move: (dg/dp)^-1 dg/db, out (9, 3)."""
    u, distance, gradient, inverse = work[0:3], work[3], work[4:7], work[7:10]
    rays_from_position(p, block[SENSOR, 4], block[SENSOR, 5], u, distance)
    beacon_gradients(u, distance, out)
    position_gradient(u, distance, gradient)
    if not invert_three(gradient, inverse):
        return False
    _multiply_numbers(inverse, out, work[10])
    return True


@kernel
def _numbers_by_beacon(block: Matrix, p: Vector, work: Matrix, out: Matrix) -> bool:
    """Write what the measured numbers do as beacons A, B, C move, seen from p, docking frame; out (9, 3)."""
    if block[SETTINGS, 1] == FIX:
        if not _position_by_beacon(block, p, work, out) or not range_azimuth_elevation_jacobian(p, work[0:3]):
            return False
        _multiply_numbers(work[0:3], out, work[3])
        return True
    u, distance = work[0:3], work[3]
    rays_from_position(p, block[SENSOR, 4], block[SENSOR, 5], u, distance)
    if block[VARIANCE, 1] > 0.0:
        beacon_gradients(u, distance, out)
    else:
        _pair_gradients(block[JACOBIAN : JACOBIAN + 3], u, distance, out)
    return True


@kernel
def _news_of_position(block: Matrix, x: Vector, spots: Matrix, information: Matrix, news: Matrix) -> None:
    """As `news_of_coordinates`, of a fix or of invariants; errors become those of the independent rows by L^-1."""
    by_beacon, e, p = block[WORK + 14 : WORK + 23], block[WORK + 23], block[WORK + 11]
    camera_position_dock(x, block[OFFSET], block[DOCK : DOCK + 3], p)
    regular = _numbers_by_beacon(block, p, block[WORK : WORK + 11], by_beacon)
    for i in range(3):
        for j in range(3):
            information[i, j] = 0.0
    for m in range(3):
        if block[VARIANCE, m] > 0.0:
            _inform(information, block[H + m], block[VARIANCE, m])
    for j in range(news.shape[0]):
        for i in range(3):
            news[j, i] = 0.0
        if regular:
            _error_of_numbers(block, spots, block[JACOBIAN : JACOBIAN + 3], by_beacon, j, e)
            for m in range(3):
                if block[VARIANCE, m] > 0.0:
                    for k in range(m):
                        e[m] -= block[R_FACTOR + m, k] * e[k]
                    for i in range(3):
                        news[j, i] += block[H + m, i] * e[m] / block[VARIANCE, m]


@kernel
def update_sensitivities(block: Matrix, track: Matrix, sensitivities: Matrix, spots: Matrix) -> None:
    """Update sensitivities (m, 6) by the rows in use as they were linearised last; track (7, 6) after the update."""
    count = sensitivities.shape[0]
    if count == 0:
        return
    columns, information = block[WORK : WORK + 3], block[WORK + 3 : WORK + 6]
    end = int(block[LAYOUT, 5])
    news = block[end - count : end]
    if uses_coordinates(block):
        news_of_coordinates(block, track[0], information, news)
    else:
        _news_of_position(block, track[0], spots, information, news)
    _position_columns(track[1:7], columns)
    for j in range(count):
        _update(sensitivities[j], columns, information, news[j])


@kernel
def start_sensitivities_of_fix(block: Matrix, p: Vector, spots: Matrix, sensitivities: Matrix) -> bool:
    """Set sensitivities (m, 6) of a track that starts at the fix p (3,), docking frame, with JACOBIAN at it."""
    if sensitivities.shape[0] == 0:
        return True
    dock, jacobian, e = block[DOCK : DOCK + 3], block[WORK + 11 : WORK + 14], block[WORK + 23]
    by_beacon, from_angles = block[WORK + 14 : WORK + 23], block[WORK : WORK + 3]
    if not position_from_angles_jacobian(p, from_angles):
        return False
    for i in range(3):
        for k in range(6):
            jacobian[i, k] = 0.0
            for m in range(3):
                jacobian[i, k] += from_angles[i, m] * block[JACOBIAN + m, k]
    if not _position_by_beacon(block, p, block[WORK : WORK + 11], by_beacon):
        return False
    for j in range(sensitivities.shape[0]):
        _error_of_numbers(block, spots, jacobian, by_beacon, j, e)
        for i in range(3):
            sensitivities[j, i] = dock[0, i] * e[0] + dock[1, i] * e[1] + dock[2, i] * e[2]
            sensitivities[j, 3 + i] = 0.0
    return True


@kernel
def start_sensitivities_of_planes(block: Matrix, x: Vector, covariance: Matrix, sensitivities: Matrix) -> None:
    """Set sensitivities (m, 6) of a track that starts at x by least squares over coordinates; covariance (6, 6)."""
    count = sensitivities.shape[0]
    if count == 0:
        return
    end = int(block[LAYOUT, 5])
    news = block[end - count : end]
    news_of_coordinates(block, x, block[WORK : WORK + 3], news)
    for j in range(count):
        for i in range(3):
            sensitivities[j, i] = 0.0
            sensitivities[j, 3 + i] = 0.0
            for k in range(3):
                sensitivities[j, i] += covariance[i, k] * news[j, k]


@kernel
def add_considered(ld: Matrix, sensitivities: Matrix) -> None:
    """Replace a filter's own factors (6, 6) by those of what is reported, P + S S^T."""
    for j in range(sensitivities.shape[0]):
        add_rank_one(ld, sensitivities[j])
