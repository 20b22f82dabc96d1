"""What one sigma of each considered error does to an image of beacons, and to a start on one: `engine="filterpy"`."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.mission import Model
from relnav.navigation.blocks import ATTITUDE_ERRORS, FIELD_ERRORS
from relnav.navigation.observation.measurement_matrices import field_errors
from relnav.navigation.reference.beacon_rows import (
    BEACONS,
    CAMERA,
    ERRORS,
    FOCAL,
    PLACE,
    POSITION,
    TURN,
    BeaconImage,
    BeaconOptics,
)
from relnav.navigation.reference.motion import cross
from relnav.navigation.reference.numbers import ALL, to_angles
from relnav.sensors.measurement import DEGENERATE, NOT_SEEN, OK
from relnav.sensors.three_beacon.parallel import solve_parallel_jacobian


@dataclass(frozen=True)
class Begun:
    """A start on one image: Status code; state (6,), covariance (6, 6), considered (m, 6)."""

    status: int
    state: Vector
    covariance: Matrix
    considered: Matrix


def errors_of(optics: BeaconOptics, image: BeaconImage, x: Vector, spots: Matrix) -> Matrix:
    """What one sigma of each considered error does to the rows of an image at a state, (k, m)."""
    if optics.coordinates:
        whole = errors_of_all_coordinates(optics, x, spots)[image.places]
        return whole[:, optics.wanted]
    p = optics.place(x)
    seen = [i for i in ALL if np.any(image.by_spots[:, 2 * i : 2 * i + 2])]
    g, slopes = optics.number_slopes(p, seen)
    shifts = slopes.reshape(len(g), 3, ERRORS)
    if optics.method == "fix":
        turn = to_angles(p) @ np.linalg.inv(shifts[:, :, POSITION].sum(axis=1))
        shifts = np.einsum("ij,jkl->ikl", turn, shifts)
    return _of_numbers(optics, image.by_spots, shifts, spots)


def errors_of_all_coordinates(optics: BeaconOptics, x: Vector, spots: Matrix) -> Matrix:
    """Of every coordinate by every error that there may be, (2 n, all)."""
    n, built = len(optics.beacons), optics.built
    slopes = optics.coordinate_slopes(x)[2]
    each = slopes.reshape(2 * n, ERRORS)
    out = [field_errors(spots, optics.field[0], optics.field[1], optics.lasting), optics.attitude_sigma * each[:, TURN]]
    if built is not None:
        placed = np.zeros((n, 2, n, 3))
        placed[np.arange(n), :, np.arange(n)] = built.beacon_placement_sigma_m * slopes[:, :, PLACE]
        out.append(built.focal_length_relative_sigma * each[:, FOCAL, None])
        out.append(built.camera_mounting_sigma_rad * each[:, CAMERA])
        out.append(built.beacon_mounting_sigma_rad * each[:, BEACONS])
        out.append(placed.reshape(2 * n, 3 * n))
    return np.hstack(out)


def turns_follow(optics: BeaconOptics, change: Vector) -> Matrix:
    """What each considered error does to a state by coordinates more, where that moves by `change` (6,); (6, m).

    A turn of chaser or camera turns all that is found: -sigma a x change, a along the camera's axes.
    """
    out = np.zeros((6, FIELD_ERRORS + ERRORS + 3 * len(optics.beacons)))
    turns = [(FIELD_ERRORS, optics.attitude_sigma)]
    if optics.built is not None:
        turns.append((FIELD_ERRORS + ATTITUDE_ERRORS + 1, optics.built.camera_mounting_sigma_rad))
    for first, sigma in turns if optics.coordinates else []:
        for part in (slice(0, 3), slice(3, 6)):
            out[part, first : first + 3] = -sigma * cross(optics.dcm, change[part]).T
    return out[:, optics.wanted]


def _of_numbers(optics: BeaconOptics, by_spots: Matrix, shifts: Matrix, spots: Matrix) -> Matrix:
    """Of k numbers of A, B and C: by_spots (k, 6), shifts (k, 3, 16) by the errors of each beacon; (k, m)."""
    k, n, built = len(by_spots), len(optics.beacons), optics.built
    field = field_errors(spots, optics.field[0], optics.field[1], optics.lasting)
    out = [by_spots @ field[:6], optics.attitude_sigma * shifts[:, :, TURN].sum(axis=1)]
    if built is not None:
        of_focal = built.focal_length_relative_sigma * by_spots @ np.nan_to_num(spots[:3]).ravel()
        out += [of_focal[:, None], np.zeros((k, 3))]  # a turn of the camera is nothing to them
        out.append(built.beacon_mounting_sigma_rad * shifts[:, :, BEACONS].sum(axis=1))
        out.append(built.beacon_placement_sigma_m * shifts[:, :, PLACE].reshape(k, 9))
        out.append(np.zeros((k, 3 * (n - 3))))
    return np.hstack(out)[:, optics.wanted]


def begin(optics: BeaconOptics, model: Model, spots: Matrix, limits: Vector) -> Begun:
    """A track from one image (n, 2) m alone, with zero velocity."""
    on_fix = _begin_on_fix(optics, model, spots)
    if on_fix.status != OK and len(optics.beacons) > 3 and optics.coordinates:
        on_planes = _begin_on_planes(optics, model, spots, limits)
        return on_planes if on_planes.status == OK else on_fix
    return on_fix


def _failed(status: int) -> Begun:
    return Begun(status, np.zeros(6), np.zeros((6, 6)), np.zeros((0, 6)))


def _at_rest(optics: BeaconOptics, model: Model, position: Vector, covariance: Matrix, effects: Matrix) -> Begun:
    """A start at a position, (3,) `lvlh_ccsds`; effects (3, m) of what is considered on it."""
    whole, considered = model.filter.initial_velocity_sigma_m_s**2 * np.eye(6), np.zeros((optics.considered, 6))
    whole[:3, :3], considered[:, :3] = 0.5 * (covariance + covariance.T), effects.T
    return Begun(OK, np.concatenate([position, np.zeros(3)]), whole, considered)


def _begin_on_fix(optics: BeaconOptics, model: Model, spots: Matrix) -> Begun:
    """By the closed form of A, B and C."""
    status, p = optics.fix(spots)
    if status != OK:
        return _failed(status)
    _g, slopes = optics.number_slopes(p, ALL)
    shifts = slopes.reshape(3, 3, ERRORS)
    by_place = shifts[:, :, POSITION].sum(axis=1)
    if not abs(np.linalg.det(by_place)) > 0.0:
        return _failed(DEGENERATE)
    if optics.exact:
        by_spots = np.linalg.solve(by_place, optics.by_spots(spots[:3], ALL))
    else:
        of_angles, three = np.zeros((3, 6)), np.ascontiguousarray(spots[:3])
        a, b = optics.half_spacing, optics.c_distance
        if not solve_parallel_jacobian(three, optics.focal_length, a, b, of_angles):
            return _failed(DEGENERATE)
        by_spots = np.linalg.solve(to_angles(p), of_angles)
    back = optics.dock.T
    covariance = back @ (by_spots * optics.spot_sigma[:3].ravel() ** 2) @ by_spots.T @ back.T + optics.arm_covariance
    moved = np.einsum("ij,jkl->ikl", np.linalg.inv(by_place), shifts)
    effects = back @ _of_numbers(optics, by_spots, moved, spots)
    return _at_rest(optics, model, back @ p - optics.offset, covariance, effects)


def _begin_on_planes(optics: BeaconOptics, model: Model, spots: Matrix, limits: Vector) -> Begun:
    """By least squares over all usable coordinates, six or more, that must agree: every one is a plane."""
    usable, _, _ = optics.usable(spots)
    beacon, axis = np.nonzero(usable)
    if len(beacon) < 6:
        return _failed(NOT_SEEN)
    f, s, dcm, lever = optics.focal_length, spots[beacon, axis, None], optics.dcm, optics.lever
    normal = f * dcm[axis] - s * dcm[2]
    value = (normal * optics.beacons[beacon]).sum(axis=1) - (f * lever[axis] - s[:, 0] * lever[2])
    x = np.zeros(6)
    x[:3], _, rank, _ = np.linalg.lstsq(normal, value)
    image = optics.see_coordinates(x, spots)
    if rank < 3 or len(image.groups) < len(beacon):
        return _failed(DEGENERATE)
    turned = optics.attitude_noise * image.turns
    variance = np.diag(image.noise) + (errors_of(optics, image, x, spots) ** 2).sum(axis=1) + (turned**2).sum(axis=1)
    for last in (False, True):
        h = image.rows[:, :3]
        covariance = np.linalg.inv(h.T / variance @ h)
        if last:
            break
        x[:3] += covariance @ (h.T / variance @ image.residual)
        image = optics.see_coordinates(x, spots)
        if len(image.groups) < len(beacon):
            return _failed(DEGENERATE)
    if image.residual**2 @ (1.0 / variance) > limits[len(beacon) - 4]:
        return _failed(DEGENERATE)
    gain = covariance @ h.T / variance
    by_turn = optics.attitude_noise * gain @ image.turns
    whole = covariance + by_turn @ by_turn.T
    return _at_rest(optics, model, x[:3].copy(), whole, gain @ errors_of(optics, image, x, spots))
