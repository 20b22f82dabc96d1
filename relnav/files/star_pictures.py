"""What is to be solved: a picture of the sky with the spots found in it, or a table of spots."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from relnav.arrays import Vector
from relnav.errors import InputError
from relnav.files.images import Picture, read_picture
from relnav.files.star_frames import MOST_SPOTS, StarFrame, own_noise, read_star_frame

if TYPE_CHECKING:
    from relnav.sensors.dual_field.star_spots import FoundStars

COLUMNS = (
    "x_px", "y_px", "flux", "sigma_x_px", "sigma_y_px", "correlation", "signal_to_noise", "saturated", "blended",
)  # fmt: skip
CONVENTION = "x_px, y_px from the picture's centre, x right, y down; column = x_px + (width - 1)/2, row likewise"


@dataclass(frozen=True)
class Seen:
    """One frame, and where it came from.

    Attributes
    ----------
    frame : StarFrame
        Its spots, from the centre.
    origin_px : (2,)
        Where the centre stands in the coordinates of the file; of a picture with (0, 0) as its first pixel's centre.
    size_px : (2,) or None
        Width and height, if they are known.
    picture, found
        The picture and its spots, if it is one.
    """

    frame: StarFrame
    origin_px: Vector
    size_px: tuple[float, float] | None
    picture: Picture | None = None
    found: "FoundStars | None" = None


def see_spots(
    path: Path, origin_px: Vector, size_px: tuple[float, float] | None, *, residual_px: float | None = None
) -> Seen:
    """A CSV of spots; errors as of `read_star_frame`."""
    centre = float(origin_px[0]), float(origin_px[1])
    return Seen(read_star_frame(path, centre, residual_px=residual_px), origin_px, size_px)


def see_picture(
    path: Path,
    saturation: float | None,
    threshold_sigma: float,
    spots_path: Path | None,
    *,
    electrons_per_count: float | None = None,
    residual_px: float | None = None,
) -> Seen:
    """A picture and its spots; `saturation` where it is not what file or type say, `spots_path` what will be written.

    `residual_px` as for `read_star_frame`; the noise of the spots' own light is in their covariance where
    `electrons_per_count` is given.

    Raises
    ------
    InputError
        If the picture cannot be read, or shows no star.
    UsageError
        If spots cannot be written under that name.
    """
    if spots_path is not None:
        from relnav.files.tables import check_format

        check_format(spots_path)
    picture = read_picture(path)
    # a picture that cannot be read is refused before the sensor is loaded
    from relnav.sensors.dual_field.star_spots import find_stars, picture_centre

    full = picture.saturation if saturation is None else saturation
    found = find_stars(
        picture.counts,
        saturation=full,
        threshold_sigma=threshold_sigma,
        electrons_per_count=electrons_per_count,
        most=MOST_SPOTS,
    )
    if len(found.spots_px) == 0:
        width, height = picture.size_px
        raise InputError(
            f"{path}: {width} x {height} px and no star: nothing as small as a star stands {threshold_sigma:g} sigma "
            "out of the background; see --threshold"
        )
    frame = StarFrame(path, found.spots_px, found.flux, None, own_noise(found.covariance_px2, residual_px))
    return Seen(frame, picture_centre(picture.size_px), picture.size_px, picture, found)


def write_spots(found: "FoundStars", path: Path) -> None:
    """Write the spots (.csv or .parquet), brightest first, in columns that `relnav stars solve` reads again."""
    from relnav.files.tables import relnav_version, write_table

    width, height = found.size_px
    variance = np.diagonal(found.covariance_px2, axis1=1, axis2=2)
    sigma = np.sqrt(variance)
    correlation = found.covariance_px2[:, 0, 1] / (sigma[:, 0] * sigma[:, 1])
    flags = [found.saturated.astype(np.float64), found.blended.astype(np.float64)]
    table = [*found.spots_px.T, found.flux, *sigma.T, correlation, found.signal_to_noise, *flags]
    stated = {"relnav": relnav_version(), "picture": f"{width} x {height} px", "coordinates": CONVENTION}
    write_table(path, COLUMNS, iter([table]), stated, (COLUMNS.index("saturated"), COLUMNS.index("blended")))
