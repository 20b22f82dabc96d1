"""Frames of star spots as CSV: one row a spot, `x_px, y_px` from the image's centre, and `flux` or `magnitude`."""

import csv
import difflib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.errors import InputError

PLACES = ("x_px", "y_px")
BRIGHTNESS = ("flux", "magnitude")
ENOUGH_TO_TELL = 8


@dataclass(frozen=True)
class StarFrame:
    """The spots of one image.

    Attributes
    ----------
    path : Path
        The file.
    spots_px : (n, 2)
        From the image's centre, x right, y down.
    flux, magnitude : (n,) or None
        At most one of them.
    """

    path: Path
    spots_px: Matrix
    flux: Vector | None
    magnitude: Vector | None


def image_centre(size_px: tuple[float, float], first_pixel_px: float) -> tuple[float, float]:
    """Centre of an image of so many columns and rows whose first pixel has its centre at this coordinate, 0 or 0.5."""
    return 0.5 * size_px[0] - 0.5 + first_pixel_px, 0.5 * size_px[1] - 0.5 + first_pixel_px


def read_star_frame(path: Path, centre_px: tuple[float, float] = (0.0, 0.0)) -> StarFrame:
    """Read a frame.

    Parameters
    ----------
    path : Path
        CSV with a header; columns beside the known ones are left alone, lines that begin with # as well.
    centre_px : (2,)
        Where the image's centre stands in the file's coordinates.

    Raises
    ------
    InputError
        Naming file, line and column of what cannot be read; if the coordinates evidently count from a corner.
    """
    values, given = read_star_table(path, PLACES, BRIGHTNESS)
    spots = values[:, :2] - np.asarray(centre_px)
    if centre_px == (0.0, 0.0):
        _refuse_corner_coordinates(spots, path)
    brightness = values[:, 2] if given else None
    return StarFrame(path, spots, brightness if given == "flux" else None, brightness if given == "magnitude" else None)


def read_star_table(path: Path, columns: tuple[str, ...], choices: tuple[str, ...]) -> tuple[Matrix, str]:
    """Columns of a CSV as numbers (n, m), with one of the `choices` as last column if it is there; its name or "".

    Raises
    ------
    InputError
        Naming file, line and column of what cannot be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [(number, text) for number, text in enumerate(file, start=1)]
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8") from error
    lines = [(number, text.strip()) for number, text in lines if text.strip() and not text.lstrip().startswith("#")]
    if not lines:
        header = ",".join([*columns, *choices[:1]])
        raise InputError(f"{path}: the file is empty; a header {header} and rows of numbers are expected")
    names = _header(lines[0][1], f"{path}:{lines[0][0]}", columns, choices)
    wanted = [name for name in (*columns, *choices) if name in names]
    values = np.empty((len(lines) - 1, len(wanted)))
    for row, (number, text) in enumerate(lines[1:]):
        values[row] = _numbers(text, names, wanted, f"{path}:{number}")
    return values, wanted[-1] if len(wanted) > len(columns) else ""


def _header(text: str, where: str, columns: tuple[str, ...], choices: tuple[str, ...]) -> list[str]:
    if "," not in text:
        seen = "';'" if ";" in text else "tabs" if "\t" in text else "no comma"
        raise InputError(f"{where}: cells separated by commas are expected in the header; got {seen}")
    names = [name.strip() for name in next(csv.reader([text]))]
    for name in columns:
        if name not in names:
            others = [other for other in names if other not in columns and other[:1].lower() == name[0]]
            near = difflib.get_close_matches(name, others, n=1, cutoff=0.3)
            hint = f"; is it '{near[0]}'? rename it" if near else ""
            raise InputError(f"{where}: column '{name}' is missing; the columns are {', '.join(names)}{hint}")
    for name in (*columns, *choices):
        if names.count(name) > 1:
            raise InputError(f"{where}: column '{name}' stands twice; keep one")
    if choices and all(name in names for name in choices):
        raise InputError(f"{where}: columns 'flux' and 'magnitude' say the same; keep one")
    return names


def _numbers(text: str, names: list[str], wanted: list[str], where: str) -> list[float]:
    try:
        cells = next(csv.reader([text]))
    except csv.Error as error:
        raise InputError(f"{where}: not a row of cells: {error}") from None
    if len(cells) != len(names):
        raise InputError(f"{where}: {len(names)} cells are expected as in the header; got {len(cells)}")
    out = []
    for name in wanted:
        cell = cells[names.index(name)].strip()
        try:
            if not cell.isascii() or "_" in cell:
                raise ValueError
            number = float(cell)
        except ValueError:
            raise InputError(f"{where}: column '{name}': {cell!r} is not a number") from None
        if not math.isfinite(number):
            raise InputError(f"{where}: column '{name}' is {cell}; leave a spot that was not measured out")
        out.append(number)
    return out


def _refuse_corner_coordinates(spots: Matrix, path: Path) -> None:
    """Eight or more spots all in one quarter of the image do not happen: they count from its corner."""
    if len(spots) >= ENOUGH_TO_TELL and bool(np.all(spots >= 0.0)):
        right, low = spots.max(axis=0)
        raise InputError(
            f"{path}: every spot has x_px and y_px of 0 or more: they count from a corner (up to {right:g}, {low:g}), "
            "but are expected from the image's centre; give --image-size-px WIDTH HEIGHT, with --first-pixel-px 0 if "
            "the first pixel's centre is (0, 0), as of relnav's own spots, or 0.5; or the centre: --centre-px X Y"
        )
