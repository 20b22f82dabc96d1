"""What the filter uses of the last image, as matrices, for other estimators: the reference engine, steady states."""

from collections.abc import Callable

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.geometry.spherical import range_azimuth_elevation_jacobian
from relnav.navigation.beacon_geometry import uses_coordinates
from relnav.navigation.memory import FIELD_ERRORS, FIX, NODES, Memory


def rows_in_use(m: Memory) -> tuple[Matrix, Vector, Matrix, Codes]:
    """What the last image gave, as matrices: H (k, 6), residuals (k,), R (k, k), and the group of each row (k,).

    Residuals and rows are those of the measured values themselves, correlated as R says.
    """
    groups = m.groups
    if not uses_coordinates(m.sensor):
        variance = groups["variance"][0]
        size = int(np.sum(variance > 0.0))
        lower = np.tril(m.fix["factor"][:size, :size], -1) + np.eye(size)
        r = lower @ np.diag(variance[:size]) @ lower.T
        innovation = groups["innovation"][0, :size].copy()
        return lower @ groups["gradient"][0, :size], innovation, r, np.zeros(size, dtype=np.int64)
    beacon, axis = np.nonzero(groups["variance"][:, :2] > 0.0)
    h, residual = groups["gradient"][beacon, axis], groups["residual"][beacon, axis]
    turns = m.sensor["attitude_noise"] * m.turns[2 * beacon + axis]
    together = turns @ turns.T
    np.fill_diagonal(together, groups["variance"][beacon, axis])  # the attitude's noise is in them
    return h, residual, together, beacon


def errors_in_use(m: Memory, x: Vector, spots: Matrix) -> Matrix:
    """What one sigma of each considered error does to the numbers of `rows_in_use`, (rows, m), at the state x (6,).

    Columns as the rows of `considered.py`, found another way: by small displacements.
    """
    sensor, groups, first = m.sensor, m.groups, int(m.fixed["first_error"])
    wanted = slice(first, first + int(m.fixed["considered"]))
    field = field_errors(spots, sensor["field_center"], sensor["field_half_width"], m.beacons["lasting_sigma"])
    if uses_coordinates(sensor):
        used = groups["variance"][:, :2].ravel() > 0.0
        errors_of_all: Matrix = np.hstack([field, *_coordinates_by_tolerance(m, x)])
        used_errors: Matrix = errors_of_all[used, wanted]
        return used_errors
    size = int(np.sum(groups["variance"][0] > 0.0))
    jacobian = m.fix["jacobian"][:size]
    errors: Matrix = np.where(jacobian == 0.0, 0.0, jacobian) @ field[:6]
    if wanted.stop == FIELD_ERRORS:
        return errors
    by_focal_length = m.tolerances["focal_length"] * np.nan_to_num(jacobian) @ np.nan_to_num(spots[:3].ravel())
    dock = m.kept["dock"][:, :3]
    p = dock @ (x[:3] + sensor["offset"])
    beacons = _beacons(m) @ dock.T
    seen = [i for i in range(3) if np.any(jacobian[:, 2 * i : 2 * i + 2])]

    def numbers(shift: Matrix) -> Vector:
        rays = beacons[:3] + shift[:3] - p
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        if size == 1:
            return np.array([np.sum((rays[seen[0]] - rays[seen[1]]) ** 2)])
        apart = rays[0] - rays[1]
        return np.array([apart @ apart, rays[2] @ apart, np.linalg.det(rays)])

    lever, sigma = m.kept["mount"][:, 3], m.sensor["attitude_sigma"]
    arms = sigma * np.cross(np.eye(3), lever) @ m.kept["mount"][:, :3] @ dock.T  # how the camera moves, docking axes
    swung = [-np.broadcast_to(arm, beacons.shape) for arm in arms]
    by_shift: Matrix = np.column_stack([_difference(numbers, shift) for shift in [*swung, *_shifts(m, beacons)]])
    if sensor["method"] == FIX:
        moved = np.column_stack([_difference(numbers, np.tile(-axis, (len(beacons), 1))) for axis in np.eye(3)])
        angles = np.zeros((3, 3))
        range_azimuth_elevation_jacobian(p, angles)
        by_shift = angles @ np.linalg.solve(moved, by_shift)
    mounting = np.zeros((size, 3))
    all_errors: Matrix = np.hstack([errors, by_shift[:, :3], by_focal_length[:, None], mounting, by_shift[:, 3:]])
    return all_errors[:, wanted]


def field_errors(spots_m: Matrix, center_m: Vector, half_width_m: Vector, sigma_m: Vector) -> Matrix:
    """What one sigma of each node of a detector's field does to every coordinate, (2 n, nodes of x and of y) m.

    spots_m (n, 2), NaN = anywhere; box of the field (2,), (2,); sigma_m (n,) of each spot's coordinates.
    """
    u = np.clip((np.nan_to_num(spots_m) - center_m) / half_width_m, -1.0, 1.0)
    distance = np.abs(0.5 * (NODES - 1) * (u[..., None] + 1.0) - np.arange(NODES))  # (n, 2, NODES)
    weights = np.maximum(0.0, 1.0 - distance)
    weights /= np.linalg.norm(weights, axis=-1, keepdims=True)
    of_spot = np.einsum("ni,nj->nij", weights[:, 0], weights[:, 1]).reshape(len(spots_m), -1) * sigma_m[:, None]
    errors = np.zeros((len(spots_m), 2, 2, NODES * NODES))
    errors[:, 0, 0], errors[:, 1, 1] = of_spot, of_spot
    return errors.reshape(2 * len(spots_m), -1)


def _beacons(m: Memory) -> Matrix:
    """Beacons from the port, `lvlh_ccsds`, (n, 3) m."""
    beacons: Matrix = m.beacons["position"] - m.kept["dock"][:, 3]
    return beacons


def _shifts(m: Memory, beacons: Matrix) -> Stack:
    """Displacements (n, 3) m of the beacons (n, 3) for turns about three axes, and for each one along them."""
    turns = [m.tolerances["beacon_mounting"] * np.cross(axis, beacons) for axis in np.eye(3)]
    each = m.tolerances["beacon_placement"] * np.eye(beacons.size).reshape(-1, *beacons.shape)
    return np.concatenate([turns, each])


def _difference(function: Callable[[Matrix], Matrix], shift: Matrix) -> Vector:
    """Derivative of a function along a shift, as a vector."""
    small = 1e-4 / max(1e-9, float(np.abs(shift).max()))
    out: Vector = np.ravel(function(small * shift) - function(-small * shift)) / (2.0 * small)
    return out


def _coordinates_by_tolerance(m: Memory, x: Vector) -> list[Matrix]:
    """Derivatives (2 n, k) of all coordinates by turns of the camera and by the tolerances."""
    f, mount, dock = m.sensor["focal_length"], m.kept["mount"][:, :3], m.kept["dock"][:, :3]
    beacons = _beacons(m) @ dock.T

    def project(shift: Matrix, turn: Matrix) -> Matrix:
        c = ((beacons + shift) @ dock - x[:3] - m.sensor["offset"]) @ mount.T
        c = c - np.cross(turn, c)  # theta: exp(-[theta x]) c
        spots: Matrix = f * c[:, :2] / c[:, 2:]
        return spots

    focal = m.tolerances["focal_length"] * project(np.zeros(3), np.zeros(3)).ravel()
    none = np.zeros(3)
    mounting = m.tolerances["camera_mounting"]
    attitude = [m.sensor["attitude_sigma"] * column for column in turns_in_sight(m, x).T]
    camera = [mounting * _difference(lambda t: project(none, t), axis) for axis in np.eye(3)]
    shifts = [_difference(lambda s: project(s, np.zeros(3)), shift) for shift in _shifts(m, beacons)]
    return [np.column_stack(attitude), focal[:, None], np.column_stack(camera), np.column_stack(shifts)]


def turns_in_sight(m: Memory, x: Vector) -> Matrix:
    """Derivatives (2 n, 3) of all coordinates by turns of the chaser about the camera's axes, at the state x (6,)."""
    f, mount, lever = m.sensor["focal_length"], m.kept["mount"][:, :3], m.kept["mount"][:, 3]
    sight = (m.beacons["position"] - x[:3]) @ mount.T

    def project(turn: Matrix) -> Matrix:
        c = sight - np.cross(turn, sight) - lever
        spots: Matrix = f * c[:, :2] / c[:, 2:]
        return spots

    return np.column_stack([_difference(project, axis) for axis in np.eye(3)])
