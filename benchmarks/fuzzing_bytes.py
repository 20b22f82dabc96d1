"""Contents of hostile files: good ones with some of their parts exchanged, as hypothesis draws them."""

import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

SPOTS = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
CONTROL = "accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
BEACONS = [[-1500.0, 0.0, 1500.0, 0.0, 0.0, 0.0], [-1500.0, 3.0, 1500.0, 3.0, 0.0, 4.0]]
MARKERS = [[553.7, 553.7, 469.3, 553.7, 511.5, 511.5], [553.9, 553.5, 469.4, 553.6, 511.6, 511.5]]

NUMBERS = ["0", "-0.0", "nan", "inf", "-inf", "1e308", "-1e308", "5e-324", "1e20", "1e-20", "1e999", "0x10", "1_5", "٣"]
WORDS = ["", " ", '"', '""', '"a', "a,b", "#", "\x00", "\x1b[31m", "\r", "\u2028", "\ufeff", "é", "t_s", "=", "[", "]"]
CELLS = st.sampled_from(NUMBERS + WORDS) | st.floats().map(repr) | st.integers().map(str) | st.text(max_size=5)


@st.composite
def texts(draw: Any, lines: list[str], separator: str) -> bytes:
    """Lines with pieces between separators exchanged, lines repeated, dropped and moved, bytes changed."""
    kept = list(lines)
    for _ in range(draw(st.integers(0, 4))):
        k = draw(st.integers(0, len(kept) - 1)) if kept else 0
        what = draw(st.sampled_from(["cell", "cell", "cell", "repeat", "drop", "insert", "swap"]))
        if what == "cell" and kept:
            pieces = kept[k].split(separator)
            pieces[draw(st.integers(0, len(pieces) - 1))] = draw(CELLS)
            kept[k] = separator.join(pieces)
        elif what == "repeat" and kept:
            kept[k:k] = [kept[k]] * draw(st.sampled_from([1, 2, 300]))
        elif what == "drop" and kept:
            del kept[k]
        elif what == "swap" and kept:
            kept.append(kept.pop(k))
        else:
            kept.insert(k, draw(CELLS))
    content = (
        draw(st.sampled_from(["\n", "\r\n", "\r"]))
        .join(kept)
        .encode(draw(st.sampled_from(["utf-8", "utf-8", "utf-8", "utf-8-sig", "utf-16"])), "surrogatepass")
    )
    return draw(changed_bytes(content)) if draw(st.booleans()) else content


@st.composite
def changed_bytes(draw: Any, content: bytes) -> bytes:
    """Some bytes exchanged, cut off or repeated."""
    data = bytearray(content)
    for _ in range(draw(st.integers(0, 4))):
        k = draw(st.integers(0, max(0, len(data) - 1)))
        what = draw(st.sampled_from(["set", "cut", "repeat"]))
        if what == "set" and data:
            data[k] = draw(st.integers(0, 255))
        elif what == "cut":
            del data[k : k + draw(st.integers(0, 40))]
        else:
            data[k:k] = data[k : k + 40] * draw(st.sampled_from([1, 50]))
    return bytes(data)


def parquets(folder: Path) -> st.SearchStrategy[bytes]:
    """Beacon logs in Parquet with columns of other types and names, some of their bytes changed."""
    import pyarrow
    from pyarrow import parquet

    kinds = [pyarrow.float64(), pyarrow.float32(), pyarrow.int8(), pyarrow.string(), pyarrow.bool_(), pyarrow.null()]
    names = SPOTS.split(",")

    @st.composite
    def build(draw: Any) -> bytes:
        columns, given_names = [], []
        for name in names:
            kind = draw(st.sampled_from([kinds[0]] * 12 + kinds))
            values = [draw(st.sampled_from([0.0, 1.0, None]))] * 3 if name != "t_s" else [0.0, 1.0, 2.0]
            columns.append(
                pyarrow.array(values).cast(pyarrow.float64()).cast(kind) if kind != kinds[-1] else [None] * 3
            )
            given_names.append(name if draw(st.integers(0, 15)) else draw(st.text(max_size=5)))
        table = pyarrow.table(columns, names=given_names)
        path = folder / "made.parquet"
        parquet.write_table(
            table.replace_schema_metadata({draw(st.binary(max_size=5)): draw(st.binary(max_size=9))}), path
        )
        content = path.read_bytes()
        return draw(changed_bytes(content)) if draw(st.booleans()) else content

    return build()


@st.composite
def flights(draw: Any, rows: list[list[float]], unit: str) -> bytes:
    """A log of twenty images in which times, spots and control are exchanged for what a number can be."""
    values = [[0.1 * k, *rows[k % 2], 0.0, 0.0, 0.0] for k in range(20)]
    size = st.sampled_from([0.0, 1e-300, 1e-9, 1.0, 1e3, 9e3, 1e10, 1e99, 1e308, -1.0, -9e3, -1e308, float("inf")])
    for _ in range(draw(st.integers(1, 6))):
        row, column = draw(st.integers(0, 19)), draw(st.integers(0, 9))
        values[row][column] = draw(size) if column else 0.1 * row + draw(st.sampled_from([1e-6, 0.05, -0.05, 1e9]))
    lines = [",".join("" if value == 1e99 else repr(value) for value in row) for row in values]
    return "\n".join([SPOTS.replace("_um", unit) + "," + CONTROL, *lines]).encode()


def _png_parts(content: bytes) -> list[tuple[bytes, bytes]]:
    """Kind and data of each chunk of a PNG."""
    parts, at = [], 8
    while at < len(content):
        length = struct.unpack(">I", content[at : at + 4])[0]
        parts.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    return parts


def _png(parts: list[tuple[bytes, bytes]]) -> bytes:
    """A PNG of these chunks, with their check sums as they should be."""
    packed = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


@st.composite
def pictures(draw: Any, kind: str) -> bytes:
    """A picture of stars: its type and size drawn, chunks or header cards exchanged, bytes changed.

    `kind` is ".png", ".tif" or ".fits".
    """
    height, width = draw(st.sampled_from([1, 8, 24, 24, 24])), draw(st.sampled_from([7, 24, 24, 24, 300]))
    counts = np.random.default_rng(1).normal(100.0, 3.0, (height, width))
    counts[height // 3 : height // 3 + 3, width // 3 : width // 3 + 3] += 90.0
    types = ["u1", "u2"] if kind == ".png" else ["u1", "u2", "f4"] if kind == ".tif" else ["u1", "i2", "f4", "f8"]
    image = counts.astype(draw(st.sampled_from(types)))
    if image.dtype.kind == "f" and draw(st.booleans()):
        image.flat[draw(st.integers(0, image.size - 1))] = draw(st.sampled_from([np.nan, np.inf, -1e30, 1e30]))
    made = BytesIO()
    if kind == ".fits":
        from astropy.io import fits

        fits.PrimaryHDU(image).writeto(made)
        content = draw(_fits_cards(made.getvalue()))
    else:
        from PIL import Image

        Image.fromarray(image).save(made, "PNG" if kind == ".png" else "TIFF")
        content = made.getvalue()
        if kind == ".png" and draw(st.booleans()):
            content = draw(_png_chunks(content))
    return draw(changed_bytes(content)) if draw(st.booleans()) else content


@st.composite
def _png_chunks(draw: Any, content: bytes) -> bytes:
    """Chunks of a PNG repeated, dropped, or with other data under a good check sum."""
    parts = _png_parts(content)
    k = draw(st.integers(0, len(parts) - 1))
    what = draw(st.sampled_from(["data", "data", "repeat", "drop", "insert"]))
    if what == "data":
        parts[k] = parts[k][0], draw(changed_bytes(parts[k][1]))
    elif what == "repeat":
        parts[k:k] = [parts[k]] * draw(st.sampled_from([1, 50]))
    elif what == "drop":
        del parts[k]
    else:
        name = draw(st.sampled_from([b"tEXt", b"zTXt", b"iTXt", b"iCCP", b"acTL", b"PLTE", b"tRNS", b"eXIf", b"XXXX"]))
        data = draw(st.binary(max_size=20) | st.just(b"a\x00\x00" + zlib.compress(bytes(1 << 22))))
        parts.insert(k, (name, data))
    return _png(parts)


@st.composite
def _fits_cards(draw: Any, content: bytes) -> bytes:
    """Cards of a FITS header with another value, or dropped."""
    cards = [content[at : at + 80] for at in range(0, 2880, 80)]
    for _ in range(draw(st.integers(0, 3))):
        k = draw(st.integers(0, 9))
        value = draw(CELLS).encode("ascii", "replace")[:60]
        cards[k] = (cards[k][:10] + value).ljust(80)[:80] if draw(st.booleans()) else draw(st.sampled_from(cards))
    return b"".join(cards) + content[2880:]
