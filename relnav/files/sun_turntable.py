"""Pairs of spots of a birefringent sun sensor whose directions are known: a turntable's table, checked."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.errors import InputError, LogError
from relnav.files.log_columns import Columns
from relnav.files.sun_logs import columns_of
from relnav.files.sun_measurements import (
    GIMBAL,
    PROJECTION,
    check_angles,
    check_on_detector,
    check_repeats,
    check_slopes,
)
from relnav.geometry.projection_angles import direction_from_angles, direction_from_gimbal, tangents_from_direction
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor

MOST_CHI2 = 25.0
"""A residual of five times the stated noise is another matter than noise."""
FEWEST = 6


@dataclass(frozen=True)
class KnownSuns:
    """Pairs of spots (N, 2, 2) px in either order, unit directions (N, 3) in sensor axes, lines (N,) of the file."""

    spots_px: Stack
    directions: Matrix
    lines: Vector
    not_seen: int


def known_suns(
    path: Path,
    columns: Columns,
    values: Matrix,
    lines: Vector,
    sensor: BirefringentSunSensor,
    first_pixel_px: float = 0.0,
    outer_axis: str = "x",
) -> KnownSuns:
    """Rows of alpha, beta (projection angles) or outer, inner (gimbals), roll if it is there, and two spots.

    roll is the third angle: the sensor turned in its mount about its boresight, x toward y; left out it is 0. The
    file's rows were read with `turntable_columns`.

    Raises
    ------
    InputError
        For angles that are empty or twice there, spots off the detector, exchanged or mirrored axes, wrong units.
    """
    if len(values) == 0:
        raise LogError(f"{path}: no rows after the header; at least one point is expected")
    place = {base: k for k, base in enumerate(columns.index)}
    gimbal = GIMBAL[0] in place
    bases = (*(GIMBAL if gimbal else PROJECTION), *(base for base in ("roll",) if base in place))
    given = values[:, [place[base] for base in bases]]
    names = [columns.names[columns.index[base]] for base in bases]
    spots = values[:, [place[name] for name in columns_of(2)]].reshape(-1, 2, 2) - first_pixel_px
    check_angles(given[:, :2], lines, path, names[:2])
    if not np.isfinite(given).all():
        row = int(np.argmin(np.isfinite(given[:, 2])))
        raise InputError(f"{path}:{int(lines[row])}: column '{names[2]}' is empty or no finite number")
    check_repeats(given, lines, path, names)
    seen = np.isfinite(spots).all(axis=(1, 2))
    if seen.sum() < FEWEST:
        raise InputError(f"{path}: {int(seen.sum())} points with both spots; a calibration needs six or more")
    for k in range(2):
        check_on_detector(spots[seen, k], lines[seen], path, sensor.detector_size_px)
    if gimbal:
        directions = direction_from_gimbal(given[:, 0], given[:, 1], outer_axis)
    else:
        directions = direction_from_angles(given[:, 0], given[:, 1])
    if given.shape[1] == 3:
        directions = _rolled(directions, given[:, 2])
    expected = (sensor.air_path_m + sensor.crystal_thickness_m / sensor.ordinary_index) / sensor.pixel_pitch_m
    tangents, middle = tangents_from_direction(directions[seen]), spots[seen].mean(axis=1)
    check_slopes(middle, tangents, path, names, expected, columns_of(2))
    return KnownSuns(spots[seen], directions[seen], lines[seen], int(np.sum(~seen)))


def _rolled(s: Matrix, roll_rad: Vector) -> Matrix:
    """Directions (N, 3) in the axes of a sensor that was turned by roll (N,) about z."""
    c, sine = np.cos(roll_rad), np.sin(roll_rad)
    return np.column_stack([c * s[:, 0] + sine * s[:, 1], c * s[:, 1] - sine * s[:, 0], s[:, 2]])
