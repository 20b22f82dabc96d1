"""Pictures of every kind read the same counts; damaged and hostile ones get one sentence, in bounded memory."""

import struct
import subprocess
import sys
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from relnav.errors import InputError
from relnav.files.images import is_picture, read_picture

Image = pytest.importorskip("PIL.Image", reason="pillow, of the extra `images`, is not installed")
COUNTS = (np.indices((12, 20)).sum(axis=0) * 7 % 251).astype(np.uint8)


@pytest.fixture
def fits():
    return pytest.importorskip("astropy.io.fits", reason="astropy, of the extra `images`, is not installed")


@pytest.mark.parametrize("ending", [".png", ".tif", ".TIFF", ".bmp"])
def test_eight_bits(tmp_path, ending):
    Image.fromarray(COUNTS).save(tmp_path / f"a{ending}")
    picture = read_picture(tmp_path / f"a{ending}")
    np.testing.assert_array_equal(picture.counts, COUNTS)
    assert (picture.saturation, picture.size_px) == (255.0, (20, 12))


def test_jpeg_colours_and_palettes_are_mixed_to_grey(tmp_path):
    Image.fromarray(COUNTS).save(tmp_path / "a.jpg", quality=95)
    assert np.abs(read_picture(tmp_path / "a.jpg").counts.astype(int) - COUNTS).max() < 40
    for mode in ("RGB", "RGBA", "P", "LA"):
        Image.fromarray(COUNTS).convert(mode).save(tmp_path / "a.png")
        np.testing.assert_array_equal(read_picture(tmp_path / "a.png").counts, COUNTS)


@pytest.mark.parametrize("ending", [".png", ".tif"])
def test_sixteen_bits(tmp_path, ending):
    counts = COUNTS.astype(np.uint16) * 250
    Image.fromarray(counts).save(tmp_path / f"a{ending}")
    picture = read_picture(tmp_path / f"a{ending}")
    np.testing.assert_array_equal(picture.counts, counts)
    assert picture.saturation == 65535.0


def test_floats(tmp_path):
    Image.fromarray(COUNTS.astype(np.float32) / 3).save(tmp_path / "a.tif")
    picture = read_picture(tmp_path / "a.tif")
    np.testing.assert_array_equal(picture.counts, COUNTS.astype(np.float32) / 3)
    assert picture.saturation is None


@pytest.mark.parametrize(
    ("dtype", "saturation"), [(np.uint8, 255.0), (np.uint16, 65535.0), (np.int16, 32767.0), (np.float32, None)]
)
def test_fits(tmp_path, fits, dtype, saturation):
    fits.PrimaryHDU(COUNTS.astype(dtype)).writeto(tmp_path / "a.fits")
    picture = read_picture(tmp_path / "a.fits")
    np.testing.assert_array_equal(picture.counts, COUNTS.astype(dtype))
    assert picture.saturation == saturation
    assert picture.counts.dtype.isnative


def test_fits_in_an_extension_compressed_with_an_axis_of_one(tmp_path, fits):
    first = fits.PrimaryHDU()
    fits.HDUList([first, fits.CompImageHDU(COUNTS.astype(np.int16))]).writeto(tmp_path / "a.fits")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.fits").counts, COUNTS)
    hdu = fits.PrimaryHDU(COUNTS[None])
    hdu.header["SATURATE"] = 240.0
    hdu.writeto(tmp_path / "b.fits")
    picture = read_picture(tmp_path / "b.fits")
    np.testing.assert_array_equal(picture.counts, COUNTS)
    assert picture.saturation == 240.0


def test_endings(tmp_path):
    assert is_picture(tmp_path / "a.JPG")
    assert is_picture(tmp_path / "a.fit")
    assert not is_picture(tmp_path / "a.csv")


def png(width, height, data):
    """A PNG of eight bits written by hand."""

    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def fits_head(**cards):
    lines = [f"{key:<8}= {value:>20}".ljust(80) for key, value in cards.items()]
    return "".join([*lines, "END".ljust(80)]).encode().ljust(2880, b" ")


WHOLE = png(200, 150, zlib.compress(bytes(151 * 200)))
HOSTILE = {
    "empty.png": (b"", "not a readable picture"),
    "text.png": (b"x_px,y_px,flux\n1,2,3\n", "not a readable picture"),
    "cut.png": (
        png(200, 150, zlib.compress(np.random.default_rng(1).bytes(201 * 150))[:900]),
        "not a readable picture",
    ),
    "cut head.png": (WHOLE[:20], "not a readable picture"),
    "bomb.png": (png(30_000, 30_000, zlib.compress(bytes(1_000_000), 9)), "exceeds limit|million pixels"),
    "smaller bomb.png": (png(8_000, 8_000, zlib.compress(bytes(1_000_000), 9)), "no exposure packs so well"),
    "line.png": (png(60_000, 1, zlib.compress(bytes(60_001))), "from 8 px a side"),
    "cut.jpg": (b"\xff\xd8\xff\xe0\x00\x10JFIF", "not a readable picture"),
    "cut.tif": (b"II*\x00\xff\xff\xff\x7f", "not a readable picture"),
    "text.fits": (b"t_s,x_px\n", "does not begin with SIMPLE"),
    "cut.fits": (fits_head(SIMPLE="T", BITPIX=16, NAXIS=2, NAXIS1=500, NAXIS2=400), "not a readable FITS file"),
    "bomb.fits": (fits_head(SIMPLE="T", BITPIX=8, NAXIS=2, NAXIS1=9000, NAXIS2=9000), "no exposure packs so well"),
    "huge.fits": (fits_head(SIMPLE="T", BITPIX=8, NAXIS=2, NAXIS1=10**9, NAXIS2=10**9), "not a readable FITS file"),
    "axes.fits": (fits_head(SIMPLE="T", BITPIX=8, NAXIS=10**6), "an array of more than 999 axes"),
    "spectrum.fits": (fits_head(SIMPLE="T", BITPIX=8, NAXIS=1, NAXIS1=2880) + bytes(2880), "holds no picture"),
    "no picture.fits": (fits_head(SIMPLE="T", BITPIX=8, NAXIS=0), "holds no picture"),
    "cube.fits": (
        fits_head(SIMPLE="T", BITPIX=8, NAXIS=3, NAXIS1=20, NAXIS2=20, NAXIS3=3) + bytes(2880),
        "20 x 20 x 3",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_pictures_get_one_sentence(tmp_path, name):
    if name.endswith(".fits"):
        pytest.importorskip("astropy", reason="astropy, of the extra `images`, is not installed")
    content, text = HOSTILE[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=text) as caught:
        read_picture(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_all_nan(tmp_path):
    Image.fromarray(np.full((20, 20), np.nan, dtype=np.float32)).save(tmp_path / "a.tif")
    with pytest.raises(InputError, match="no pixel is a finite number"):
        read_picture(tmp_path / "a.tif")


def test_every_cut_of_a_picture_is_read_or_refused(tmp_path):
    for ending in (".png", ".tif", ".jpg"):
        Image.fromarray(COUNTS).save(tmp_path / f"whole{ending}")
        content = (tmp_path / f"whole{ending}").read_bytes()
        for length in range(0, len(content), max(1, len(content) // 40)):
            (tmp_path / f"cut{ending}").write_bytes(content[:length])
            with suppress(InputError):
                assert read_picture(tmp_path / f"cut{ending}").size_px == (20, 12)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux for the most memory ever held")
def test_the_largest_that_unpacks_stays_within_bounds(tmp_path):
    """Sixteen million pixels in 16 kB are unpacked and looked through: within 500 MB of memory."""
    (tmp_path / "a.png").write_bytes(png(4000, 3999, zlib.compress(bytes(4001 * 3999), 9)))
    code = (
        "import pathlib, sys, relnav.cli\n"
        "code = relnav.cli.run(['stars', 'solve', sys.argv[1], '--focal-px', '9000'])\n"
        "(most,) = [x for x in pathlib.Path('/proc/self/status').read_text().splitlines() if x.startswith('VmHWM')]\n"
        "print(code, int(most.split()[1]) // 1024)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "a.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    status, most = map(int, done.stdout.split())
    assert status == 3
    assert "no star" in done.stderr
    assert most < 500
