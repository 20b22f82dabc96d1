"""What the filter uses of the last image, as matrices, for other estimators: the reference engine, steady states."""

from collections.abc import Callable

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.geometry.spherical import range_azimuth_elevation_jacobian
from relnav.navigation.block import (
    ATTITUDE,
    DOCK,
    FIELD,
    FIELD_ERRORS,
    FIX,
    GRADIENT,
    JACOBIAN,
    LAYOUT,
    NODES,
    OBSERVED,
    OFFSET,
    POSITION,
    R_FACTOR,
    RESIDUAL,
    SENSOR,
    SETTINGS,
    TOLERANCES,
    VARIANCE,
    H,
    beacon_count,
    beacon_row,
)
from relnav.navigation.sight import uses_coordinates


def rows_in_use(block: Matrix) -> tuple[Matrix, Vector, Matrix, Codes]:
    """What the last image gave, as matrices: H (m, 6), residuals (m,), R (m, m), and the group of each row (m,).

    Residuals and rows are those of the measured values themselves, correlated as R says.
    """
    if not uses_coordinates(block):
        size = int(np.sum(block[VARIANCE, :3] > 0.0))
        lower = np.tril(block[R_FACTOR : R_FACTOR + size, :size], -1) + np.eye(size)
        r = lower @ np.diag(block[VARIANCE, :size]) @ lower.T
        return lower @ block[H : H + size], block[RESIDUAL, 3 : 3 + size].copy(), r, np.zeros(size, dtype=np.int64)
    h, residual, variance, groups = [], [], [], []
    for i in range(beacon_count(block)):
        row = beacon_row(block, i)
        for k in range(2):
            if block[row + OBSERVED, 2 + k] > 0.0:
                h.append(block[row + GRADIENT + k].copy())
                residual.append(block[row + OBSERVED, k])
                variance.append(block[row + OBSERVED, 2 + k])
                groups.append(i)
    return np.array(h).reshape(-1, 6), np.array(residual), np.diag(variance), np.array(groups, dtype=np.int64)


def errors_in_use(block: Matrix, x: Vector, spots: Matrix) -> Matrix:
    """What one sigma of each considered error does to the numbers of `rows_in_use`, (rows, m), at the state x (6,).

    Columns as the rows of `considered.py`, found another way: by small displacements.
    """
    count = beacon_count(block)
    field = _field_errors(block, spots)
    tolerant = block[LAYOUT, 1] - block[LAYOUT, 4] > FIELD_ERRORS
    if uses_coordinates(block):
        used = [block[beacon_row(block, i) + OBSERVED, 2 + k] > 0.0 for i in range(count) for k in range(2)]
        columns = [field]
        if tolerant:
            columns.extend(_coordinates_by_tolerance(block, x))
        errors_of_all: Matrix = np.hstack(columns)
        return errors_of_all[used]
    size = int(np.sum(block[VARIANCE, :3] > 0.0))
    jacobian = block[JACOBIAN : JACOBIAN + size]
    errors: Matrix = np.where(jacobian == 0.0, 0.0, jacobian) @ field[:6]
    if not tolerant:
        return errors
    by_focal_length = block[TOLERANCES, 0] * np.nan_to_num(jacobian) @ np.nan_to_num(spots[:3].ravel())
    dock = block[DOCK : DOCK + 3, :3]
    p = dock @ (x[:3] + block[OFFSET, :3])
    beacons = _beacons(block) @ dock.T
    seen = [i for i in range(3) if np.any(jacobian[:, 2 * i : 2 * i + 2])]

    def numbers(shift: Matrix) -> Vector:
        rays = beacons[:3] + shift[:3] - p
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        if size == 1:
            return np.array([np.sum((rays[seen[0]] - rays[seen[1]]) ** 2)])
        apart = rays[0] - rays[1]
        return np.array([apart @ apart, rays[2] @ apart, np.linalg.det(rays)])

    by_shift: Matrix = np.column_stack([_difference(numbers, shift) for shift in _shifts(block, beacons)])
    if block[SETTINGS, 1] == FIX:
        moved = np.column_stack([_difference(numbers, np.tile(-axis, (count, 1))) for axis in np.eye(3)])
        angles = np.zeros((3, 3))
        range_azimuth_elevation_jacobian(p, angles)
        by_shift = angles @ np.linalg.solve(moved, by_shift)
    all_errors: Matrix = np.hstack([errors, by_focal_length[:, None], np.zeros((size, 3)), by_shift])
    return all_errors


def _field_errors(block: Matrix, spots: Matrix) -> Matrix:
    """What one sigma of each node's error does to every coordinate, (2 n, nodes of x and of y)."""
    sigma = np.array([block[beacon_row(block, i) + POSITION, 5] for i in range(len(spots))])
    return field_errors(spots, block[FIELD, :2], block[FIELD, 2:4], sigma)


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


def _beacons(block: Matrix) -> Matrix:
    """Beacons from the port, `lvlh_ccsds`, (n, 3) m."""
    rows = [block[beacon_row(block, i) + POSITION, :3] for i in range(beacon_count(block))]
    return np.array(rows) - block[DOCK : DOCK + 3, 3]


def _shifts(block: Matrix, beacons: Matrix) -> Stack:
    """Displacements (n, 3) m of the beacons (n, 3) for turns about three axes, and for each one along them."""
    turns = [block[TOLERANCES, 2] * np.cross(axis, beacons) for axis in np.eye(3)]
    each = block[TOLERANCES, 3] * np.eye(beacons.size).reshape(-1, *beacons.shape)
    return np.concatenate([turns, each])


def _difference(function: Callable[[Matrix], Matrix], shift: Matrix) -> Vector:
    """Derivative of a function along a shift, as a vector."""
    small = 1e-4 / max(1e-9, float(np.abs(shift).max()))
    out: Vector = np.ravel(function(small * shift) - function(-small * shift)) / (2.0 * small)
    return out


def _coordinates_by_tolerance(block: Matrix, x: Vector) -> list[Matrix]:
    """Derivatives (2 n, k) of all coordinates by the tolerances."""
    f, mount = block[SENSOR, 0], block[ATTITUDE : ATTITUDE + 3, :3]
    dock, beacons = block[DOCK : DOCK + 3, :3], _beacons(block) @ block[DOCK : DOCK + 3, :3].T

    def project(shift: Matrix, turn: Matrix) -> Matrix:
        c = ((beacons + shift) @ dock - x[:3] - block[OFFSET, :3]) @ mount.T
        c = c + np.cross(turn, c)
        spots: Matrix = f * c[:, :2] / c[:, 2:]
        return spots

    focal = block[TOLERANCES, 0] * project(np.zeros(3), np.zeros(3)).ravel()
    turns = [block[TOLERANCES, 1] * _difference(lambda t: project(np.zeros(3), t), axis) for axis in np.eye(3)]
    shifts = [_difference(lambda s: project(s, np.zeros(3)), shift) for shift in _shifts(block, beacons)]
    return [focal[:, None], np.column_stack(turns), np.column_stack(shifts)]
