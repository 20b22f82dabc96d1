"""Contents of hostile files: good ones with some of their parts exchanged, as `Choices` has it."""

import struct
import zlib
from functools import cache
from io import BytesIO
from typing import Any

import numpy as np
from fuzzing_choices import Choices

SPOTS = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
CONTROL = "accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
BEACONS = [[-1500.0, 0.0, 1500.0, 0.0, 0.0, 0.0], [-1500.0, 3.0, 1500.0, 3.0, 0.0, 4.0]]
MARKERS = [[553.7, 553.7, 469.3, 553.7, 511.5, 511.5], [553.9, 553.5, 469.4, 553.6, 511.6, 511.5]]
BOMB = b"a\x00\x00" + zlib.compress(bytes(1 << 22))
"""A comment of a PNG that unpacks to 4 MiB."""


def texts(choose: Choices, lines: list[str], separator: str) -> bytes:
    """Lines with pieces between separators exchanged, lines repeated, dropped and moved, bytes changed."""
    kept = list(lines)
    for _ in range(choose.whole(0, 4)):
        k = choose.whole(0, len(kept) - 1) if kept else 0
        what = choose.one(["cell", "cell", "cell", "repeat", "drop", "insert", "swap"])
        if what == "cell" and kept:
            pieces = kept[k].split(separator)
            pieces[choose.whole(0, len(pieces) - 1)] = choose.cell()
            kept[k] = separator.join(pieces)
        elif what == "repeat" and kept:
            kept[k:k] = [kept[k]] * choose.one([1, 2, 300])
        elif what == "drop" and kept:
            del kept[k]
        elif what == "swap" and kept:
            kept.append(kept.pop(k))
        else:
            kept.insert(k, choose.cell())
    content = (
        choose.one(["\n", "\r\n", "\r"])
        .join(kept)
        .encode(choose.one(["utf-8", "utf-8", "utf-8", "utf-8-sig", "utf-16"]), "surrogatepass")
    )
    return changed_bytes(choose, content) if choose.whole(0, 1) else content


def changed_bytes(choose: Choices, content: bytes) -> bytes:
    """Some bytes exchanged, cut off or repeated."""
    data = bytearray(content)
    for _ in range(choose.whole(0, 4)):
        k = choose.whole(0, max(0, len(data) - 1))
        what = choose.one(["set", "cut", "repeat"])
        if what == "set" and data:
            data[k] = choose.whole(0, 255)
        elif what == "cut":
            del data[k : k + choose.whole(0, 40)]
        else:
            data[k:k] = data[k : k + 40] * choose.one([1, 50])
    return bytes(data)


def parquets(choose: Choices) -> bytes:
    """A beacon log in Parquet with columns of other types and names, some of its bytes changed."""
    import pyarrow
    from pyarrow import parquet

    kinds = [pyarrow.float64(), pyarrow.float32(), pyarrow.int8(), pyarrow.string(), pyarrow.bool_(), pyarrow.null()]
    columns, names = [], []
    for name in SPOTS.split(","):
        kind = choose.one([kinds[0]] * 12 + kinds)
        values = [choose.one([0.0, 1.0, None])] * 3 if name != "t_s" else [0.0, 1.0, 2.0]
        columns.append(pyarrow.array(values).cast(pyarrow.float64()).cast(kind) if kind != kinds[-1] else [None] * 3)
        names.append(name if choose.whole(0, 15) else choose.text(5))
    table = pyarrow.table(columns, names=names).replace_schema_metadata({choose.some(5): choose.some(9)})
    made = BytesIO()
    parquet.write_table(table, made)
    return changed_bytes(choose, made.getvalue()) if choose.whole(0, 1) else made.getvalue()


def flights(choose: Choices, rows: list[list[float]], unit: str) -> bytes:
    """A log of twenty images in which times, spots and control are exchanged for what a number can be."""
    values = [[0.1 * k, *rows[k % 2], 0.0, 0.0, 0.0] for k in range(20)]
    sizes = [0.0, 1e-300, 1e-9, 1.0, 1e3, 9e3, 1e10, 1e99, 1e308, -1.0, -9e3, -1e308, float("inf")]
    for _ in range(choose.whole(1, 6)):
        row, column = choose.whole(0, 19), choose.whole(0, 9)
        values[row][column] = choose.one(sizes) if column else 0.1 * row + choose.one([1e-6, 0.05, -0.05, 1e9])
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


@cache
def _stars(height: int, width: int) -> Any:
    """Counts of a picture with one star."""
    counts = np.random.default_rng(1).normal(100.0, 3.0, (height, width))
    counts[height // 3 : height // 3 + 3, width // 3 : width // 3 + 3] += 90.0
    return counts


def pictures(choose: Choices, kind: str) -> bytes:
    """A picture of stars: its type and size drawn, chunks or header cards exchanged, bytes changed.

    `kind` is ".png", ".tif" or ".fits".
    """
    height, width = choose.one([1, 8, 24, 24, 24]), choose.one([7, 24, 24, 24, 300])
    types = ["u1", "u2"] if kind == ".png" else ["u1", "u2", "f4"] if kind == ".tif" else ["u1", "i2", "f4", "f8"]
    image = _stars(height, width).astype(choose.one(types))
    if image.dtype.kind == "f" and choose.whole(0, 1):
        image.flat[choose.whole(0, image.size - 1)] = choose.one([np.nan, np.inf, -1e30, 1e30])
    made = BytesIO()
    if kind == ".fits":
        from astropy.io import fits

        fits.PrimaryHDU(image).writeto(made)
        content = _fits_cards(choose, made.getvalue())
    else:
        from PIL import Image

        Image.fromarray(image).save(made, "PNG" if kind == ".png" else "TIFF")
        content = made.getvalue()
        if kind == ".png" and choose.whole(0, 1):
            content = _png_chunks(choose, content)
    return changed_bytes(choose, content) if choose.whole(0, 1) else content


def _png_chunks(choose: Choices, content: bytes) -> bytes:
    """Chunks of a PNG repeated, dropped, or with other data under a good check sum."""
    parts = _png_parts(content)
    k = choose.whole(0, len(parts) - 1)
    what = choose.one(["data", "data", "repeat", "drop", "insert"])
    if what == "data":
        parts[k] = parts[k][0], changed_bytes(choose, parts[k][1])
    elif what == "repeat":
        parts[k:k] = [parts[k]] * choose.one([1, 50])
    elif what == "drop":
        del parts[k]
    else:
        name = choose.one([b"tEXt", b"zTXt", b"iTXt", b"iCCP", b"acTL", b"PLTE", b"tRNS", b"eXIf", b"XXXX"])
        data = choose.some(20) if choose.whole(0, 1) else BOMB
        parts.insert(k, (name, data))
    return _png(parts)


def _fits_cards(choose: Choices, content: bytes) -> bytes:
    """Cards of a FITS header with another value, or dropped."""
    cards = [content[at : at + 80] for at in range(0, 2880, 80)]
    for _ in range(choose.whole(0, 3)):
        k = choose.whole(0, 9)
        value = choose.cell().encode("ascii", "replace")[:60]
        cards[k] = (cards[k][:10] + value).ljust(80)[:80] if choose.whole(0, 1) else choose.one(cards)
    return b"".join(cards) + content[2880:]
