"""Grids of known spots for a detector's calibration: CSV with true and measured positions, a row a point."""

import csv
import math
from pathlib import Path

import numpy as np

from relnav.arrays import Matrix
from relnav.errors import LogError
from relnav.files.units import UNITS, split_unit, to_si

COLUMNS = ("true_x", "true_y", "spot_x", "spot_y")


def read_grid(path: Path) -> tuple[Matrix, Matrix, list[int]]:
    """Read a grid: columns true_x_um, true_y_um, spot_x_um, spot_y_um (any length unit; an empty spot is not seen).

    Returns
    -------
    True and measured positions, (n, 2) m each, and the line of each point in the file.

    Raises
    ------
    LogError
        Naming file, line and column.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [(number, line) for number, line in enumerate(file, start=1) if line.strip()[:1] not in ("", "#")]
    except UnicodeDecodeError as error:
        raise LogError(f"{path}: not a text file in UTF-8; a CSV grid is expected") from error
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    if not lines:
        raise LogError(f"{path}: the file is empty; a header line and one row a point are expected")
    number, header = lines[0]
    names = [name.strip() for name in next(csv.reader([header]))]
    places = _places(names, f"{path}:{number}")
    values = np.empty((len(lines) - 1, 4))
    for row, (number, line) in enumerate(lines[1:]):
        cells = next(csv.reader([line]))
        if len(cells) != len(names):
            raise LogError(f"{path}:{number}: {len(names)} cells are expected as in the header; got {len(cells)}")
        for column, (place, factor) in enumerate(places):
            cell = cells[place].strip()
            try:
                if "_" in cell:  # float() would take 1_5 for 15
                    raise ValueError
                value = float(cell) if cell else math.nan
            except ValueError:
                raise LogError(f"{path}:{number}: column '{names[place]}': {cell!r} is not a number") from None
            if column < 2 and not math.isfinite(value):
                raise LogError(f"{path}:{number}: column '{names[place]}' is {cell!r}; only a spot may be missing")
            values[row, column] = to_si(value, factor)
    return values[:, :2], values[:, 2:], [number for number, _ in lines[1:]]


def _places(names: list[str], where: str) -> list[tuple[int, float]]:
    """Position in a row and factor to metres of each of COLUMNS."""
    out = []
    for base in COLUMNS:
        found = [(k, split_unit(name)) for k, name in enumerate(names) if split_unit(name)[0] == base]
        if len(found) != 1 or not found[0][1][1]:
            raise LogError(
                f"{where}: one column '{base}_um' (or another length unit) is expected; got {', '.join(names)}"
            )
        place, (_, unit) = found[0]
        si, factor = UNITS[unit]
        if si != "m":
            raise LogError(f"{where}: column '{names[place]}': unit '{unit}' does not fit; a length is expected")
        out.append((place, factor))
    return out
