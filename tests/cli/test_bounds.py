"""What has no end, or would unpack to no end: refused within two seconds of processor time and 500 MB, by a program.

Processor time is what a refusal of an ordinary bad file takes, and two seconds more; memory is the child's largest.
"""

import os
import struct
import subprocess
import sys
import threading
import zlib
from contextlib import suppress

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "wait4"), reason="what a child used is asked of the system")
MODEL = ("--model", "three_beacon_psd")
SPOTS = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
MOST_CPU_S, MOST_BYTES = 2.0, 500e6


def png_of(side):
    """A picture that says it is so large, and holds nothing."""
    parts = [(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)), (b"IDAT", zlib.compress(bytes(1000)))]
    parts.append((b"IEND", b""))
    chunks = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def endless(piece, most=10**9):
    """Pieces, until the reader leaves."""

    def write(pipe):
        with suppress(BrokenPipeError), pipe:
            for _ in range(most // len(piece)):
                pipe.write(piece)

    return write


@pytest.fixture
def spent(tmp_path):
    """spent(arguments, feed) -> exit code, standard error, processor time and memory of `python -m relnav`."""

    def call(arguments, feed=None):
        with (tmp_path / "said").open("wb+") as said:
            process = subprocess.Popen(
                [sys.executable, "-m", "relnav", *arguments],
                cwd=tmp_path,
                env=os.environ | {"RELNAV_JIT": "0"},
                stdin=subprocess.DEVNULL if feed is None else subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=said,
            )
            if feed is not None:
                threading.Thread(target=feed, args=(process.stdin,), daemon=True).start()
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            said.seek(0)
            words = said.read().decode()
        return process.returncode, words, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024

    return call


FILES = {
    "a million columns": (
        "log.csv",
        lambda: ",".join(f"column_{k}" for k in range(10**6)).encode(),
        "a line of 1000000 characters",
    ),
    "20,000 keys": (
        "model.toml",
        lambda: b'sensor_type = "three_beacon"\n[sensor]\n' + b"".join(b"key_%d = 1\n" % k for k in range(20_000)),
        "model.toml",
    ),
    "deep nesting": ("model.toml", lambda: b"x = " + b"[" * 100_000, "model.toml"),
    "deep nesting of JSON": ("r.json", lambda: b"[" * 1_000_000, "r.json"),
    "a picture of 10^10 pixels": ("a.png", lambda: png_of(60_000), "not a readable picture"),
    "a picture that packs too well": ("a.png", lambda: png_of(9_000), "no exposure packs so well"),
}
COMMANDS = {
    "log.csv": ["filter", "log.csv", *MODEL],
    "model.toml": ["models", "model.toml"],
    "r.json": ["report", "r.json", "--out", "r.html"],
    "a.png": ["stars", "solve", "a.png", "--focal-px", "3000"],
}


def hold(spent, arguments, text, feed=None):
    """Refused with the text, within the bounds."""
    ORDINARY_S.setdefault(arguments[0], spent([*arguments[:1], "--no-such-option"])[2])
    code, words, cpu_s, memory = spent(arguments, feed)
    assert code in (2, 3), words
    assert text in words
    assert len(words) < 30_000
    assert cpu_s < ORDINARY_S[arguments[0]] + MOST_CPU_S + IMPORTS_S
    assert memory < MOST_BYTES


ORDINARY_S: dict[str, float] = {}
IMPORTS_S = 2.0
"""Of numpy, pydantic and others, which a refused option does without."""


@pytest.mark.parametrize("name", FILES)
def test_a_file(spent, tmp_path, name):
    if name.startswith("a picture"):
        pytest.importorskip("PIL", reason="the extra `images` is not installed")
    file, content, text = FILES[name]
    (tmp_path / file).write_bytes(content())
    hold(spent, COMMANDS[file], text)


@pytest.mark.parametrize(
    ("head", "piece", "text"),
    [
        (b"", bytes(1 << 16), "a line of 1000000 characters or more"),
        (SPOTS.encode() + b"\n", b"1" * (1 << 16), "a line of 1000000 characters or more"),
        (b"", b"# comment\n" * 6_000, "no header yet"),
        (SPOTS.encode() + b"\n", b"\n" * (1 << 16), "lines without a row"),
    ],
)
def test_a_pipe_without_end(spent, head, piece, text):
    """Zeros, a line of 10^9 characters, comments and empty lines, as they come through a pipe."""

    def feed(pipe):
        with suppress(BrokenPipeError):
            pipe.write(head)
        endless(piece)(pipe)

    hold(spent, ["filter", "-", *MODEL], text, feed)


def test_parquet_that_unpacks_to_no_end(spent, tmp_path):
    """Columns of one value a hundred million times, written run by run, never whole."""
    pyarrow = pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    from pyarrow import parquet

    names = SPOTS.split(",")
    rows = pyarrow.array([1.0] * 1_000_000)
    table = pyarrow.table([rows] * len(names), names=names)
    with parquet.ParquetWriter(tmp_path / "log.parquet", table.schema, compression="zstd") as writer:
        for _ in range(14):
            writer.write_table(table, row_group_size=1_000_000)
    hold(spent, ["filter", "log.parquet", *MODEL], "log.parquet")
