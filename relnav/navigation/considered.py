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

What lasts in the spots is a smooth field over the detector: neighbouring spots share it, and a spot that travels
leaves its error behind. It is carried as independent errors on 4 x 4 nodes over the calibrated box, for x and for y;
between nodes a spot's error is their mean, weighted bilinearly and scaled to the spot's own sigma. So spots share much
of it at half a spacing, a third of the half width, and little at a whole one, as they do of what calibrations from 225
points leave: correlations of 0.5 to 0.75 and of 0.05 to 0.45 by how fine the detector's figure is (a test).

Rows of `sensitivities` (m, 6), columns of S: the nodes of x, of y; then, if tolerances are considered: the focal
length; turns of the camera about its axes; turns of the beacons about the docking axes, at the port; every beacon
along the docking axes. A tolerance acts as if it moved the beacons, by delta: on a coordinate it does -h delta, h its
row of H.
"""

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import entry, kernel, straight_line
from relnav.estimation.factored import add_rank_one
from relnav.geometry.spherical import position_from_angles_jacobian
from relnav.navigation.beacon_geometry import camera_position_dock, uses_coordinates
from relnav.navigation.lasting_errors import (
    displacement,
    error_of_numbers,
    numbers_by_beacon,
    place_in_field,
    position_by_beacon,
    sight_and_arm,
)
from relnav.navigation.memory import FIELD_ERRORS, NODES, TOLERANCES_SHARED, Memory
from relnav.navigation.propagation import moves


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
def add_considered_noise(m: Memory, x: Vector, sensitivities: Matrix) -> None:
    """Add considered errors to the variance of every coordinate in use.

    sensitivities (m, 6) as predicted; rows linearised at x.
    """
    count = sensitivities.shape[0]
    if count == 0:
        return
    sight, arm, moved = m.scratch["vectors"][0], m.scratch["vectors"][1], m.scratch["vectors"][2]
    place2 = m.tolerances["beacon_placement"] * m.tolerances["beacon_placement"]
    for beacon in range(m.beacons.shape[0]):
        variance, lasting = m.groups[beacon]["variance"], m.beacons[beacon]["lasting_sigma"]
        sight_and_arm(m, x, beacon, sight, arm)
        for k in range(2):
            if variance[k] > 0.0:
                h = m.groups[beacon]["gradient"][k]
                variance[k] += lasting * lasting + place2 * (h[0] * h[0] + h[1] * h[1] + h[2] * h[2])
                for j in range(FIELD_ERRORS, min(count, FIELD_ERRORS + TOLERANCES_SHARED)):
                    left, s = 0.0, sensitivities[j]
                    displacement(m, beacon, j - FIELD_ERRORS, sight, arm, moved)
                    for i in range(3):
                        left += h[i] * (moved[i] + s[i])
                    variance[k] += left * left


@kernel
def news_of_coordinates(m: Memory, x: Vector, spots: Matrix, information: Matrix, news: Matrix) -> None:
    """Write H^T R^-1 H (3, 3) of the coordinates in use, linearised at x, and a row of H^T R^-1 E for each error."""
    vectors, own, place = m.scratch["vectors"], m.scratch["three"], m.scratch["places"][0]
    sight, arm, moved = vectors[0], vectors[1], vectors[2]
    for i in range(3):
        for j in range(3):
            information[i, j] = 0.0
        for j in range(news.shape[0]):
            news[j, i] = 0.0
    for beacon in range(m.beacons.shape[0]):
        lasting = m.beacons[beacon]["lasting_sigma"]
        for i in range(3):
            for j in range(3):
                own[i, j] = 0.0
        for k in range(2):
            variance = m.groups[beacon]["variance"][k]
            if variance > 0.0:
                h = m.groups[beacon]["gradient"][k]
                _inform(own, h, variance)
                place_in_field(m.sensor, spots[beacon], place)
                for corner in range(4):
                    node = (int(place[0]) + corner // 2) * NODES + int(place[1]) + corner % 2
                    weight = lasting * place[2 + corner // 2] * place[4 + corner % 2] / variance
                    for i in range(3):
                        news[k * NODES * NODES + node, i] += h[i] * weight
        sight_and_arm(m, x, beacon, sight, arm)
        for j in range(FIELD_ERRORS, news.shape[0]):
            if displacement(m, beacon, j - FIELD_ERRORS, sight, arm, moved):
                for i in range(3):
                    news[j, i] -= own[i, 0] * moved[0] + own[i, 1] * moved[1] + own[i, 2] * moved[2]
        for i in range(3):
            for j in range(3):
                information[i, j] += own[i, j]


@kernel
def _news_of_position(m: Memory, x: Vector, spots: Matrix, information: Matrix, news: Matrix) -> None:
    """As `news_of_coordinates`, of a fix or of invariants; errors become those of the independent rows by L^-1."""
    group, factor, by_beacon, places = m.groups[0], m.fix["factor"], m.scratch["by_beacon"], m.scratch["places"]
    variance, h = group["variance"], group["gradient"]
    e, p = m.scratch["vectors"][0], m.scratch["vectors"][1]
    camera_position_dock(x, m.sensor["offset"], m.kept["dock"], p)
    regular = numbers_by_beacon(m, p, m.scratch["gradients"], by_beacon)
    for i in range(3):
        place_in_field(m.sensor, spots[i], places[i])
    for i in range(3):
        for j in range(3):
            information[i, j] = 0.0
    for r in range(3):
        if variance[r] > 0.0:
            _inform(information, h[r], variance[r])
    for j in range(news.shape[0]):
        for i in range(3):
            news[j, i] = 0.0
        if regular:
            error_of_numbers(m, spots, places, m.fix["jacobian"], by_beacon, j, e)
            for r in range(3):
                if variance[r] > 0.0:
                    for k in range(r):
                        e[r] -= factor[r, k] * e[k]
                    for i in range(3):
                        news[j, i] += h[r, i] * e[r] / variance[r]


@kernel
def update_sensitivities(m: Memory, track: Record, sensitivities: Matrix, spots: Matrix) -> None:
    """Update sensitivities (m, 6) by the rows in use as they were linearised last; the track after the update."""
    count = sensitivities.shape[0]
    if count == 0:
        return
    columns, information, news = m.scratch["columns"], m.scratch["information"], m.news
    if uses_coordinates(m.sensor):
        news_of_coordinates(m, track["state"], spots, information, news)
    else:
        _news_of_position(m, track["state"], spots, information, news)
    _position_columns(track["ld"], columns)
    for j in range(count):
        if moves(sensitivities[j]) or moves(news[j]):
            _update(sensitivities[j], columns, information, news[j])


@kernel
def start_sensitivities_of_fix(m: Memory, p: Vector, spots: Matrix, by_spots: Matrix, sensitivities: Matrix) -> bool:
    """Set sensitivities (m, 6) of a track that starts at the fix p (3,), docking frame; by_spots (3, 6): at it."""
    if sensitivities.shape[0] == 0:
        return True
    dock, jacobian, e = m.kept["dock"], m.scratch["numbers"], m.scratch["vectors"][0]
    by_beacon, from_angles, places = m.scratch["by_beacon"], m.scratch["three"], m.scratch["places"]
    if not position_from_angles_jacobian(p, from_angles):
        return False
    for i in range(3):
        for k in range(6):
            jacobian[i, k] = 0.0
            for r in range(3):
                jacobian[i, k] += from_angles[i, r] * by_spots[r, k]
    if not position_by_beacon(m.sensor, p, m.scratch["gradients"], by_beacon):
        return False
    for i in range(3):
        place_in_field(m.sensor, spots[i], places[i])
    for j in range(sensitivities.shape[0]):
        error_of_numbers(m, spots, places, jacobian, by_beacon, j, e)
        for i in range(3):
            sensitivities[j, i] = dock[0, i] * e[0] + dock[1, i] * e[1] + dock[2, i] * e[2]
            sensitivities[j, 3 + i] = 0.0
    return True


@kernel
def start_sensitivities_of_planes(
    m: Memory, x: Vector, spots: Matrix, covariance: Matrix, sensitivities: Matrix
) -> None:
    """Set sensitivities (m, 6) of a track that starts at x by least squares over coordinates; covariance (6, 6)."""
    count = sensitivities.shape[0]
    if count == 0:
        return
    news = m.news
    news_of_coordinates(m, x, spots, m.scratch["information"], news)
    for j in range(count):
        for i in range(3):
            sensitivities[j, i] = 0.0
            sensitivities[j, 3 + i] = 0.0
            for k in range(3):
                sensitivities[j, i] += covariance[i, k] * news[j, k]


@entry
def add_considered(ld: Matrix, sensitivities: Matrix) -> None:
    """Replace a filter's own factors (6, 6) by those of what is reported, P + S S^T."""
    for j in range(sensitivities.shape[0]):
        if moves(sensitivities[j]):
            add_rank_one(ld, sensitivities[j])
