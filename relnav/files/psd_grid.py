"""Grids of known spots for a detector's calibration: a table with true and measured positions, a row a point."""

from pathlib import Path

import numpy as np

from relnav.arrays import Matrix
from relnav.errors import LogError
from relnav.files.log_columns import Columns
from relnav.files.logs import read_csv
from relnav.files.units import UNITS, split_unit
from relnav.files.wording import listed

SAME_M = 1e-8
"""Coordinates closer than this are of one row or column: a stage repeats to tens of nanometres at best."""
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
    _, columns, values, lines = read_csv(path, _parse)
    wrong = ~np.isfinite(values)
    wrong[:, 2:] = np.isinf(values[:, 2:])
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        name = columns.names[columns.index[COLUMNS[column]]]
        raise LogError(
            f"{path}:{int(lines[row])}: column '{name}' is empty or no finite number; only a spot may be missing"
        )
    true, measured = values[:, :2], values[:, 2:]
    if _on_lattice(measured) and not _on_lattice(true):
        raise LogError(
            f"{path}: the spots lie on a lattice of rows and columns and the known positions do not: columns 'true' "
            "and 'spot' are exchanged; true_x, true_y are where the spots were put"
        )
    return true, measured, [int(line) for line in lines]


def _on_lattice(points: Matrix) -> bool:
    """Whether the points (n, 2) with finite coordinates fill the crossings of few rows and columns.

    At least two of three crossings hold a point: measured spots are all in rows and columns of their own.
    """
    seen = points[np.isfinite(points).all(axis=1)]
    rows, columns = (len(np.unique(np.round(seen[:, axis] / SAME_M))) for axis in range(2))
    return 2 * rows * columns <= 3 * len(seen)


def _parse(names: list[str], where: str) -> Columns:
    """Where each of COLUMNS stands, and its factor to metres."""
    index: dict[str, int] = {}
    factor: dict[str, float] = {}
    for base in COLUMNS:
        found = [(k, split_unit(name)[1]) for k, name in enumerate(names) if split_unit(name)[0] == base]
        if len(found) != 1 or not found[0][1]:
            raise LogError(f"{where}: one column '{base}_um' (or another length unit) is expected; got {listed(names)}")
        index[base], unit = found[0]
        si, factor[base] = UNITS[unit]
        if si != "m":
            raise LogError(f"{where}: column '{names[index[base]]}': unit '{unit}' does not fit; a length is expected")
    ignored = tuple(name for k, name in enumerate(names) if k not in index.values())
    return Columns(tuple(names), index, factor, ignored)
