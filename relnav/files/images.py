"""Pictures as arrays of counts: PNG, TIFF, JPEG by pillow, FITS by astropy (extra `images`), 8 or 16 bit or floats.

A picture is read as it is stored: its first row first, no turn by metadata. What would unpack to very much more than
the file holds is refused before it is unpacked.
"""

import mmap
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from relnav.errors import InputError, UsageError
from relnav.files.atomic import replacing
from relnav.files.optional import require
from relnav.files.wording import printable, shown

PILLOW_ENDINGS = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm")
FITS_ENDINGS = (".fits", ".fit", ".fts")
WRITTEN_ENDINGS = (".png", ".tif", ".tiff", ".fits", ".fit")
TOO_MANY_AXES = re.compile(rb"NAXIS   = *[0-9]{4}")
"""The FITS standard (4.0, 4.4.1.1) has 999 at most."""
LEAST_SIDE, MOST_SIDE, MOST_PIXELS = 8, 65_535, 100_000_000
BOMB_PIXELS, BOMB_RATIO = 16_000_000, 100
"""A picture of more pixels than the first has a byte in the file for every so many of them, or more."""
SIXTEEN_BIT = 65_535.0


@dataclass(frozen=True)
class Picture:
    """One picture.

    Attributes
    ----------
    path : Path
        The file.
    counts : (rows, columns)
        As stored, any real type; colours are mixed to grey.
    saturation : float or None
        Counts of a full pixel, where file or type say; None for floats without a word of it.
    """

    path: Path
    counts: NDArray[Any]
    saturation: float | None

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.counts.shape[1], self.counts.shape[0]


def is_picture(path: Path) -> bool:
    """Whether a file's ending is that of a picture."""
    return path.suffix.lower() in PILLOW_ENDINGS + FITS_ENDINGS


def read_picture(path: Path) -> Picture:
    """Read a picture.

    Raises
    ------
    UsageError
        If pillow or astropy is needed and not installed, with the line that installs it.
    InputError
        For what is damaged, no single picture of grey or colour, too small, too large, or without a finite number.
    """
    picture = _read_fits(path) if path.suffix.lower() in FITS_ENDINGS else _read_pillow(path)
    counts = picture.counts
    if counts.dtype.kind == "f" and not np.isfinite(counts).any():
        raise InputError(f"{path}: no pixel is a finite number")
    return picture


def check_picture_to_write(path: Path) -> None:
    """Refuse a picture of a kind that is not written.

    Raises
    ------
    UsageError
        Naming the endings that are, or the package that is missing.
    """
    if path.suffix.lower() not in WRITTEN_ENDINGS:
        raise UsageError(f"{path}: a picture is written as {', '.join(WRITTEN_ENDINGS)}; got '{path.suffix}'")
    if path.suffix.lower() in FITS_ENDINGS:
        require_astropy()
    else:
        require_pillow()


def write_picture(counts: NDArray[np.uint16], stated: dict[str, str], path: Path) -> None:
    """Write counts (rows, columns) of 16 bits; what is stated stands in the file's text, comment or header.

    Raises
    ------
    UsageError
        See `check_picture_to_write`.
    """
    check_picture_to_write(path)
    words = "; ".join(f"{printable(key)} = {printable(value)}" for key, value in stated.items())
    with replacing(path, ".png") as temporary:
        if path.suffix.lower() in FITS_ENDINGS:
            from astropy.io import fits

            hdu = fits.PrimaryHDU(counts)
            hdu.header["COMMENT"] = words.encode("ascii", "replace").decode()
            hdu.writeto(temporary)
            return
        from PIL import Image
        from PIL.PngImagePlugin import PngInfo

        text = PngInfo()
        text.add_text("Comment", words)
        more = {"pnginfo": text} if path.suffix.lower() == ".png" else {"description": words}
        Image.fromarray(counts).save(temporary, **more)


def require_pillow() -> Any:
    """The package pillow; UsageError with the line that installs it."""
    return require("PIL", "images", "pictures need pillow")


def require_astropy() -> Any:
    """The package astropy; UsageError with the line that installs it."""
    return require("astropy", "images", "FITS files need astropy")


def _read_pillow(path: Path) -> Picture:
    require_pillow()
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of metadata that nobody asked for; sizes are checked here
            with Image.open(path) as image:
                _check_size(path, image.size)
                counts, saturation = _grey(image)
    except InputError:
        raise
    except MemoryError:
        raise
    except Exception as error:  # a decoder meets every kind of damage with another exception
        raise InputError(f"{path}: not a readable picture: {shown(error)}") from error
    return Picture(path, counts, saturation)


def _grey(image: Any) -> tuple[NDArray[Any], float | None]:
    """Counts of an opened picture, and those of a full pixel."""
    if image.mode.startswith("I;16"):
        return np.asarray(image).astype(np.uint16), SIXTEEN_BIT
    if image.mode == "I":  # 16 bits and more
        counts = np.asarray(image)
        return counts, SIXTEEN_BIT if counts.max() <= SIXTEEN_BIT else None
    if image.mode == "F":
        return np.asarray(image), None
    return np.asarray(image.convert("L")), 255.0


def _read_fits(path: Path) -> Picture:
    require_astropy()
    from astropy.io import fits

    try:
        with warnings.catch_warnings(), path.open("rb") as file:  # by name, astropy leaves a damaged one open
            warnings.simplefilter("ignore")  # of headers that break the standard; what matters here is checked
            if file.read(6) != b"SIMPLE":
                raise InputError(f"{path}: not a FITS file: it does not begin with SIMPLE")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                if TOO_MANY_AXES.search(content):  # astropy would count them, one by one
                    raise InputError(f"{path}: not a readable FITS file: an array of more than 999 axes")
            file.seek(0)
            with fits.open(file, memmap=False, lazy_load_hdus=True) as hdus:
                image = next((hdu for hdu in hdus if hdu.is_image and len(hdu.shape) >= 2), None)
                if image is None:
                    raise InputError(f"{path}: holds no picture: no HDU with two axes")
                shape = tuple(side for side in image.shape[:-2] if side != 1) + tuple(image.shape[-2:])
                if len(shape) != 2:
                    raise InputError(f"{path}: one picture is expected; got an array of {_by(image.shape)}")
                _check_size(path, (shape[1], shape[0]))
                counts, stated = np.asarray(image.data).reshape(shape), image.header.get("SATURATE")
    except InputError:
        raise
    except MemoryError:
        raise
    except Exception as error:  # a decoder meets every kind of damage with another exception
        raise InputError(f"{path}: not a readable FITS file: {shown(error)}") from error
    native = counts.astype(counts.dtype.newbyteorder("="), copy=False)
    if isinstance(stated, int | float) and not isinstance(stated, bool) and 0.0 < stated < np.inf:
        return Picture(path, native, float(stated))
    return Picture(path, native, None if native.dtype.kind == "f" else float(np.iinfo(native.dtype).max))


def _check_size(path: Path, size: tuple[int, int]) -> None:
    """Refuse what is no picture of stars, and what the file cannot hold."""
    width, height = size
    if min(size) < LEAST_SIDE or max(size) > MOST_SIDE or width * height > MOST_PIXELS:
        raise InputError(
            f"{path}: a picture of {width} x {height} px; from {LEAST_SIDE} px a side to {MOST_PIXELS // 1_000_000} "
            "million pixels are read: cut or bin it"
        )
    if width * height > max(BOMB_PIXELS, BOMB_RATIO * path.stat().st_size):
        raise InputError(
            f"{path}: {width} x {height} px in {path.stat().st_size} bytes: no exposure packs so well, it is not read"
        )


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, reversed(shape)))
