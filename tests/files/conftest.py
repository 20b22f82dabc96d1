"""Small models and logs written for one test; MAT and MCAP files read by their descriptions, not by their writers."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest

import relnav.cli
from relnav.files.filter_log import filter_marker_log
from relnav.files.marker_logs import write_marker_log
from relnav.files.model_folders import models_root
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

HEADER = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
ROW = "{t},-1500,0,1500,0,0,0"


@pytest.fixture
def write_log(tmp_path):
    """write_log(text) -> path of a log with that text; bytes are written as they are."""

    def write(text):
        path = tmp_path / "log.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.fixture
def lines():
    """A good log as a list of lines: header and three rows; join with newlines."""
    return [HEADER, *(ROW.format(t=0.5 * k) for k in range(3))]


@pytest.fixture(scope="session")
def shipped_text() -> str:
    return (Path(models_root()) / "three_beacon_psd" / "model.toml").read_text(encoding="utf-8")


@pytest.fixture
def write_model(tmp_path, shipped_text):
    """write_model((old, new), ...) -> path of the shipped V-bar model with pieces of its text replaced."""

    def write(*changes):
        text = shipped_text
        for old, new in changes:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        folder = tmp_path / "mine"
        folder.mkdir(exist_ok=True)
        path = folder / "model.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def line_of(shipped_text):
    """Line number at which the shipped model's text says something, once."""

    def find(piece):
        numbers = [k for k, line in enumerate(shipped_text.splitlines(), start=1) if piece in line]
        assert len(numbers) == 1, piece
        return numbers[0]

    return find


@pytest.fixture(scope="session")
def vbar_log():
    return Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"


@pytest.fixture(scope="session")
def mat_variables():
    """mat_variables(bytes) -> name: value of each variable, a struct as a dictionary."""
    return read_mat


@pytest.fixture(scope="session")
def mcap_messages():
    """mcap_messages(bytes) -> (topic, name of the schema, schema, time in ns, message) of each message."""
    return read_mcap


def read_mat(data):
    """Variables of a level 5 MAT-file without compression ("MAT-File Format", The MathWorks, chapter 1)."""
    version, order = struct.unpack_from("<H2s", data, 124)
    assert (version, order) == (0x0100, b"IM")
    found, at = {}, 128
    while at < len(data):
        name, value, at = _matrix(data, at)
        found[name] = value
    return found


_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8", 16: "u1"}
STRUCT, CHAR, DOUBLE, MATRIX = 2, 4, 6, 14


def _element(data, at):
    """Type and bytes of a data element, and where the next begins: small ones have both in eight bytes."""
    kind, size = struct.unpack_from("<HH", data, at)
    if size:
        return kind, data[at + 4 : at + 4 + size], at + 8
    kind, size = struct.unpack_from("<II", data, at)
    return kind, data[at + 8 : at + 8 + size], at + 8 + -(-size // 8) * 8


def _matrix(data, at):
    kind, body, after = _element(data, at)
    assert kind == MATRIX
    _, flags, at = _element(body, 0)
    _, shape, at = _element(body, at)
    _, name, at = _element(body, at)
    shape = np.frombuffer(shape, "<i4")
    if flags[0] == STRUCT:
        assert (shape == 1).all()
        _, length, at = _element(body, at)
        _, names, at = _element(body, at)
        step, value = struct.unpack("<i", length)[0], {}
        for k in range(0, len(names), step):
            _, value[names[k : k + step].split(b"\0")[0].decode()], at = _matrix(body, at)
        return name.decode(), value, after
    kind, raw, at = _element(body, at)
    assert flags[0] in (CHAR, DOUBLE)
    assert at == len(body)
    numbers = np.frombuffer(raw, "<" + _NUMBERS[kind])
    if flags[0] == CHAR:
        return name.decode(), bytes(numbers.astype("u1")).decode(), after
    return name.decode(), numbers.astype(float).reshape(shape, order="F"), after


MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 3, 4, 5, 6, 15


def read_mcap(data):
    """(topic, name of schema, schema, time ns, message) of an MCAP file (mcap.dev/spec), in the order of the file."""
    assert data.startswith(MAGIC)
    assert data.endswith(MAGIC)
    schemas, channels, found = {}, {}, []
    for kind, body in _records(data[8:-8]):
        if kind == DATA_END:  # behind it stands the summary, which says it all again
            break
        inside = _records(_unpacked(body)) if kind == CHUNK else [(kind, body)]
        for kind, body in inside:
            if kind == SCHEMA:
                number, rest = struct.unpack_from("<H", body)[0], io.BytesIO(body[2:])
                schemas[number] = _text(rest), _text(rest), _text(rest)
            elif kind == CHANNEL:
                number, schema = struct.unpack_from("<HH", body)
                rest = io.BytesIO(body[4:])
                channels[number] = schema, _text(rest), _text(rest)
            elif kind == MESSAGE:
                number, _, log_time, publish_time = struct.unpack_from("<HIQQ", body)
                schema, topic, encoding = channels[number]
                name, schema_encoding, text = schemas[schema]
                assert (encoding, schema_encoding, publish_time) == (b"json", b"jsonschema", log_time)
                found.append((topic.decode(), name.decode(), text, log_time, body[22:]))
    return found


def _records(data):
    at = 0
    while at < len(data):
        kind, size = struct.unpack_from("<BQ", data, at)
        yield kind, data[at + 9 : at + 9 + size]
        at += 9 + size


def _unpacked(chunk):
    _, _, size, _ = struct.unpack_from("<QQQI", chunk)
    rest = io.BytesIO(chunk[28:])
    method, packed = _text(rest), rest.read()[8:]
    assert method == b"zstd"
    zstandard = pytest.importorskip("zstandard", reason="zstandard is not installed")
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def _text(stream):
    return stream.read(struct.unpack("<I", stream.read(4))[0])


SCENARIO = """[approach]
duration_s = 8.0
rate_hz = 2.0
assumed_noise = true
[results]
range_edges_m = [9.0, 9.8, 10.5]
settling_s = 2.0
"""


@pytest.fixture(scope="session")
def marker_log(tmp_path_factory):
    """A marker log of four seconds."""
    path = tmp_path_factory.mktemp("poses") / "log.csv"
    flight = simulate_flight(relnav.load_model("three_marker_vision"), Approach(duration_s=4.0, rate_hz=2.0), seed=1)
    write_marker_log(flight, path)
    return path


@pytest.fixture(scope="session")
def poses(marker_log):
    """Its solution."""
    return filter_marker_log(marker_log, relnav.load_model("three_marker_vision"))


@pytest.fixture(scope="session")
def campaign(tmp_path_factory):
    """Folder of a finished campaign of eight short runs, in batches of four."""
    pytest.importorskip("pyarrow", reason="campaigns are Parquet files (extra parquet)")
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "s.toml").write_text(SCENARIO)
    command = ["campaign", "three_beacon_psd", "--runs", "8", "--seed", "3", "--scenario", str(folder / "s.toml"),
               "--out", str(folder / "c"), "--no-pictures", "--quiet", "--workers", "1"]  # fmt: skip
    assert relnav.cli.run(command) == 0
    return folder / "c"
