"""Small models and logs written for one test; MAT and MCAP files read by other libraries than wrote them."""

import ctypes
import ctypes.util
import functools
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
    """mat_variables(path) -> name: value of each variable, a struct as a dictionary, as libmatio reads them."""
    name = ctypes.util.find_library("matio")
    if name is None:  # a C library of Debian, which no index of Python packages has: .ci/run installs it
        pytest.skip("libmatio is not installed (Debian: libmatio11 or later)")
    return functools.partial(read_mat, library_of_mat(ctypes.CDLL(name)))


class MatVariable(ctypes.Structure):
    """`matvar_t` of matio.h."""

    _fields_ = [
        ("nbytes", ctypes.c_size_t),
        ("rank", ctypes.c_int),
        ("data_type", ctypes.c_int),
        ("data_size", ctypes.c_int),
        ("class_type", ctypes.c_int),
        *((flag, ctypes.c_int) for flag in ("is_complex", "is_global", "is_logical")),
        ("dims", ctypes.POINTER(ctypes.c_size_t)),
        ("name", ctypes.c_char_p),
        ("data", ctypes.c_void_p),
    ]


STRUCT, CHAR, DOUBLE = 2, 4, 6
"""`matio_classes` of matio.h."""
TEXT_TYPES = {1, 2, 16}
"""`matio_types` of a byte a character: int8, uint8, UTF-8."""


def library_of_mat(library):
    """It, told what its functions take and return."""
    variable, file = ctypes.POINTER(MatVariable), ctypes.c_void_p
    for name, returns, *takes in (
        ("Mat_Open", file, ctypes.c_char_p, ctypes.c_int),
        ("Mat_Close", ctypes.c_int, file),
        ("Mat_VarReadNext", variable, file),
        ("Mat_VarFree", None, variable),
        ("Mat_VarGetNumberOfFields", ctypes.c_uint, variable),
        ("Mat_VarGetStructFieldByIndex", variable, variable, ctypes.c_size_t, ctypes.c_size_t),
    ):
        function = getattr(library, name)
        function.restype, function.argtypes = returns, takes
    return library


def read_mat(library, path):
    file, found = library.Mat_Open(str(path).encode(), 0), {}
    assert file, "libmatio opens it"
    while variable := library.Mat_VarReadNext(file):
        found[variable.contents.name.decode()] = _value(library, variable)
        library.Mat_VarFree(variable)
    library.Mat_Close(file)
    return found


def _value(library, variable):
    it = variable.contents
    shape = it.dims[: it.rank]
    if it.class_type == STRUCT:
        assert set(shape) == {1}
        fields = (
            library.Mat_VarGetStructFieldByIndex(variable, k, 0)
            for k in range(library.Mat_VarGetNumberOfFields(variable))
        )
        return {field.contents.name.decode(): _value(library, field) for field in fields}
    raw = ctypes.string_at(it.data, it.nbytes)
    if it.class_type == CHAR:
        assert it.data_type in TEXT_TYPES
        return raw.decode()
    assert (it.class_type, it.is_complex, it.data_size) == (DOUBLE, 0, 8)
    return np.frombuffer(raw, dtype=np.float64).reshape(shape, order="F")


@pytest.fixture(scope="session")
def mcap_messages():
    """mcap_messages(path) -> (topic, name of the schema, schema, time in ns, message) of each, as small-mcap reads."""
    small_mcap = pytest.importorskip("small_mcap", reason="small-mcap is not installed")

    def read(path):
        with path.open("rb") as file:
            for schema, channel, message in small_mcap.read_message(file, validate_crc=True):
                assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
                assert message.publish_time == message.log_time
                yield channel.topic, schema.name, bytes(schema.data), message.log_time, bytes(message.data)

    return read


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
