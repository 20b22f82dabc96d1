"""Frames of star spots as CSV: one row a spot, `x_px, y_px` from the image's centre, and `flux` or `magnitude`.

The noise of each spot may be there too: `sigma_x_px, sigma_y_px, correlation`, as relnav writes the spots of a picture.
"""

import difflib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import LARGEST, Matrix, Stack, Vector
from relnav.errors import InputError
from relnav.files.log_columns import Columns
from relnav.files.logs import read_csv
from relnav.files.text_table import MOST_ROWS, READ_WHOLE
from relnav.files.wording import columns_are

PLACES = ("x_px", "y_px")
BRIGHTNESS = ("flux", "magnitude")
NOISE = ("sigma_x_px", "sigma_y_px", "correlation")
TIME = "t_s"
ENOUGH_TO_TELL = 8
LEAST_SIGMA_PX = 1e-6
"""A centroid that is known a thousand times better than the best centroids are has its sigma in another unit."""
MOST_SPOTS = 20_000
"""In one frame: a picture has no more stars than that."""
MOST_IN_FRAME = MOST_SPOTS, "one frame is expected; of a log of frames keep the rows of one time"
MOST_IN_LOG = MOST_ROWS, READ_WHOLE


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
    covariance_px2 : (n, 2, 2) or None
        Of each spot, if it is not the model's.
    """

    path: Path
    spots_px: Matrix
    flux: Vector | None
    magnitude: Vector | None
    covariance_px2: Stack | None = None


def read_star_frame(
    path: Path, centre_px: tuple[float, float] = (0.0, 0.0), *, residual_px: float | None = None
) -> StarFrame:
    """Read a frame.

    Parameters
    ----------
    path : Path
        CSV with a header; columns beside the known ones are left alone, lines that begin with # as well.
    centre_px : (2,)
        Where the image's centre stands in the file's coordinates.
    residual_px : float, optional
        The columns of each spot's noise are read as well, and so much, 1-sigma of a coordinate, is added.

    Raises
    ------
    InputError
        Naming file, line and column of what cannot be read; if the coordinates evidently count from a corner.
    """
    columns = PLACES if residual_px is None else (*PLACES, *NOISE)
    values, given, lines = read_star_table(path, columns, BRIGHTNESS, one_frame=True)
    own = None if residual_px is None else covariances(values[:, 2:5], lines, path)
    frame = star_frame(path, values[:, :2], centre_px, given, values[:, len(columns) :], own_noise(own, residual_px))
    if centre_px == (0.0, 0.0):
        _refuse_corner_coordinates(frame.spots_px, path)
    return frame


def star_frame(
    path: Path, spots_px: Matrix, centre_px: ArrayLike, given: str, brightness: Matrix, own: Stack | None
) -> StarFrame:
    """Spots (n, 2) in the coordinates of a file as a frame; given: what the brightness (n, 1 or 0) is, or ""."""
    spots = spots_px - np.asarray(centre_px)
    flux, magnitude = (brightness[:, 0] if given == name else None for name in BRIGHTNESS)
    return StarFrame(path, spots, flux, magnitude, own)


def own_noise(covariance_px2: Stack | None, residual_px: float | None) -> Stack | None:
    """Covariances (n, 2, 2) of spots and of what the lens model leaves; None where noise is the model's."""
    if covariance_px2 is None or residual_px is None:
        return None
    own: Stack = covariance_px2 + residual_px**2 * np.eye(2)
    return own


def covariances(noise: Matrix, lines: Vector, path: Path) -> Stack:
    """Covariances (n, 2, 2) px^2 of the columns `NOISE` (n, 3).

    Raises
    ------
    InputError
        Naming the line of a sigma or a correlation that is none.
    """
    sigma, correlation = noise[:, :2], noise[:, 2]
    wrong = np.flatnonzero(((sigma < LEAST_SIGMA_PX) | (sigma > LARGEST)).any(axis=1) | (np.abs(correlation) >= 1.0))
    if len(wrong):
        told = ", ".join(f"{name} {value:g}" for name, value in zip(NOISE, noise[wrong[0]], strict=True))
        raise InputError(
            f"{path}:{int(lines[wrong[0]])}: {told}: sigmas are {LEAST_SIGMA_PX:g} px or more, a correlation is "
            "between -1 and 1"
        )
    xy = correlation * sigma[:, 0] * sigma[:, 1]
    return np.stack([sigma[:, 0] ** 2, xy, xy, sigma[:, 1] ** 2], axis=-1).reshape(-1, 2, 2)


def read_star_table(
    path: Path, columns: tuple[str, ...], choices: tuple[str, ...], *, one_frame: bool = False
) -> tuple[Matrix, str, Vector]:
    """Columns of a CSV as numbers (n, m), and one of the `choices`, if it is there; its name or ""; lines.

    Raises
    ------
    InputError
        Naming file, line and column of what cannot be read.
    """
    parse, most = partial(_parse, columns=columns, choices=choices), MOST_IN_FRAME if one_frame else MOST_IN_LOG
    if one_frame:
        parse = partial(parse, also=(TIME,))
    _, found, values, lines = read_csv(path, parse, most=most)
    if TIME in found.index and one_frame:
        _refuse_a_log(values[:, -1], path)
        values = values[:, :-1]
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        name = found.names[list(found.index.values())[bad[0][1]]]
        came = "empty or NaN" if np.isnan(values[tuple(bad[0])]) else "infinite"
        raise InputError(
            f"{path}:{int(lines[bad[0][0]])}: column '{name}' is {came}; leave a spot that was not measured out"
        )
    return values, next((name for name in choices if name in found.index), ""), lines


def _refuse_a_log(t_s: Vector, path: Path) -> None:
    """Spots of several times are no frame: together they would be a sky that nobody saw."""
    times = len(np.unique(t_s[np.isfinite(t_s)]))
    if times > 1:
        raise InputError(
            f"{path}: t_s has {times} times: a log of frames, of which `relnav stars attitude` makes attitudes; one "
            "frame is expected: keep the rows of one time"
        )


def _parse(
    names: list[str], where: str, columns: tuple[str, ...], choices: tuple[str, ...], also: tuple[str, ...] = ()
) -> Columns:
    """Where the wanted columns stand: those needed, and the one of the choices that is there."""
    for name in columns:
        if name not in names:
            others = [other for other in names if other not in columns and other[:1].lower() == name[0]]
            near = difflib.get_close_matches(name, others[:100], n=1, cutoff=0.3)
            hint = f"; is it '{near[0]}'? rename it" if near else ""
            raise InputError(f"{where}: column '{name}' is missing; {columns_are(names)}{hint}")
    for name in (*columns, *choices):
        if names.count(name) > 1:
            raise InputError(f"{where}: column '{name}' stands twice; keep one")
    if choices and all(name in names for name in choices):
        raise InputError(f"{where}: columns 'flux' and 'magnitude' say the same; keep one")
    wanted = [name for name in (*columns, *choices, *also) if name in names]
    index = {name: names.index(name) for name in wanted}
    return Columns(tuple(names), index, dict.fromkeys(wanted, 1.0), tuple(name for name in names if name not in wanted))


def _refuse_corner_coordinates(spots: Matrix, path: Path) -> None:
    """Eight or more spots all in one quarter of the image do not happen: they count from its corner."""
    if len(spots) >= ENOUGH_TO_TELL and bool(np.all(spots >= 0.0)):
        right, low = spots.max(axis=0)
        raise InputError(
            f"{path}: every spot has x_px and y_px of 0 or more: they count from a corner (up to {right:g}, {low:g}), "
            "but are expected from the image's centre; give --image-size-px WIDTH HEIGHT, with --first-pixel-px 0 if "
            "the first pixel's centre is (0, 0), as of relnav's own spots, or 0.5; or the centre: --centre-px X Y"
        )
