"""Logs of sun spots, one row an image, for both sun sensors; their directions as a table.

Spots are in detector pixels, x along a row, the first pixel's centre at (0, 0) unless the caller says otherwise.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.errors import LogError
from relnav.files.log_columns import Columns
from relnav.files.logs import read_csv
from relnav.files.tables import relnav_version, write_table
from relnav.files.units import UNITS, split_unit
from relnav.files.wording import listed
from relnav.sensors.measurement import Status
from relnav.sensors.sun_direction import SunDirection

SPOTS = {1: ("spot",), 2: ("spot_a", "spot_b")}
"""Names of the spots of an image, by their number."""
FIELDS = ("alpha_deg", "beta_deg", "x", "y", "z", "sigma_deg")
COVARIANCE = ("cov_x_x", "cov_x_y", "cov_x_z", "cov_y_y", "cov_y_z", "cov_z_z")
UPPER = np.triu_indices(3)


@dataclass(frozen=True)
class SunLog:
    """Images of the sun.

    Attributes
    ----------
    path : Path
        The file.
    t_s : (n,) or None
        Times, if the log has them.
    spots_px : (n, spots, 2)
        NaN where none was seen.
    lines : (n,)
        Of the file.
    """

    path: Path
    t_s: Vector | None
    spots_px: Stack
    lines: Vector


def columns_of(spots: int) -> tuple[str, ...]:
    """Names of the columns of an image's spots."""
    return tuple(f"{name}_{axis}_px" for name in SPOTS[spots] for axis in "xy")


def read_sun_log(path: Path, spots: int, first_pixel_px: float = 0.0) -> SunLog:
    """Read a CSV of images: spot_x_px, spot_y_px, or of two spots spot_a_x_px, ..., spot_b_y_px; t_s for times.

    Parameters
    ----------
    path : Path
        An empty spot is one that was not seen; columns of other matters are left alone.
    spots : {1, 2}
        Of each image.
    first_pixel_px : float
        Coordinate of the first pixel's centre in the file.

    Raises
    ------
    LogError
        Naming file, line and column.
    """
    _, columns, values, lines = read_csv(path, lambda names, where: log_columns(names, where, columns_of(spots)))
    return sun_log_of(path, columns, values, lines, spots, first_pixel_px)


def sun_log_of(
    path: Path, columns: Columns, values: Matrix, lines: Vector, spots: int, first_pixel_px: float = 0.0
) -> SunLog:
    """The log of rows that were read already, by `log_columns`; LogError as `read_sun_log`."""
    wanted = columns_of(spots)
    if len(values) == 0:
        raise LogError(f"{path}: no rows after the header; at least one image is expected")
    place = {base: k for k, base in enumerate(columns.index)}
    t_s = values[:, place["t"]] if "t" in place else None
    if t_s is not None and not np.isfinite(t_s).all():
        row = int(np.argmin(np.isfinite(t_s)))
        raise LogError(f"{path}:{int(lines[row])}: column '{columns.names[columns.index['t']]}' is empty or infinite")
    seen = values[:, [place[name] for name in wanted]].reshape(len(values), spots, 2)
    return SunLog(path, t_s, seen - first_pixel_px, lines)


def log_columns(names: list[str], where: str, wanted: tuple[str, ...]) -> Columns:
    """Where the spots stand, and the time; LogError if they do not."""
    index: dict[str, int] = {}
    factor: dict[str, float] = {}
    for name in wanted:
        if names.count(name) != 1:
            came = "is missing" if name not in names else "stands there twice"
            raise LogError(f"{where}: column '{name}' {came}; the columns are {listed(names)}")
        index[name], factor[name] = names.index(name), 1.0
    times = [(k, unit) for k, (base, unit) in enumerate(map(split_unit, names)) if base == "t" and unit]
    if len(times) > 1 or (times and UNITS[times[0][1]][0] != "s"):
        raise LogError(
            f"{where}: one column of times is expected, t_s (or t_ms, t_us); the columns are {listed(names)}"
        )
    for k, unit in times:
        index["t"], factor["t"] = k, UNITS[unit][1]
    ignored = tuple(name for k, name in enumerate(names) if k not in index.values())
    return Columns(tuple(names), index, factor, ignored)


def direction_values(sun: SunDirection) -> dict[str, Any]:
    """One direction as plain values, sensor axes; null where there is none."""
    angles = {"alpha_deg": float(np.degrees(sun.alpha_rad)), "beta_deg": float(np.degrees(sun.beta_rad))}
    return {
        "status": sun.status.name,
        **angles,
        "direction": sun.direction.tolist(),
        "sigma_deg": float(np.degrees(sun.sigma_rad)),
        "covariance": sun.covariance.tolist(),
    }


def write_directions(found: list[SunDirection], t_s: Vector | None, model: str, path: Path) -> None:
    """Write a row an image (.csv or .parquet): angles, unit vector, 1-sigma, covariance of the vector, status."""
    s = np.array([sun.direction for sun in found])
    covariance = np.array([sun.covariance for sun in found])[:, UPPER[0], UPPER[1]]
    angles = np.degrees(np.arctan2(s[:, :2], s[:, 2:]))
    sigma = np.degrees([sun.sigma_rad for sun in found])
    status = np.array([float(sun.status) for sun in found])
    table = [*angles.T, *s.T, sigma, *covariance.T, status]
    names: tuple[str, ...] = (*FIELDS, *COVARIANCE, "status")
    if t_s is not None:
        table, names = [t_s, *table], ("t_s", *names)
    meaning = ", ".join(f"{int(status)} {status.name}" for status in sorted({sun.status for sun in found}))
    stated = {"relnav": relnav_version(), "model": model, "axes": "sensor, z boresight", "status": meaning}
    write_table(path, names, iter([table]), stated, (len(names) - 1,))


def outcome_lines(found: list[SunDirection]) -> list[str]:
    """What came of the images, for a reader."""
    if len(found) == 1:
        sun = found[0]
        if not sun.ok:
            return [f"{sun.status.name}: no direction"]
        return [
            f"OK: alpha {np.degrees(sun.alpha_rad):.4f} deg, beta {np.degrees(sun.beta_rad):.4f} deg, "
            f"1-sigma {np.degrees(sun.sigma_rad):.4f} deg across the direction",
            "direction in sensor axes: " + ", ".join(f"{value:.7f}" for value in sun.direction),
        ]
    counts = Counter(sun.status for sun in found)
    others = [f"{count} {status.name}" for status, count in sorted(counts.items()) if status is not Status.OK]
    sigma = np.median([sun.sigma_rad for sun in found if sun.ok]) if counts[Status.OK] else np.nan
    said = f"{counts[Status.OK]} of {len(found)} images have a direction" + (f"; {', '.join(others)}" if others else "")
    return [f"{said}; 1-sigma {np.degrees(sigma):.4f} deg in the median" if counts[Status.OK] else said]
