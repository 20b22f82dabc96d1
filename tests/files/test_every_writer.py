"""Flights of absurd, accepted numbers in every format: a state is whole or absent, no variance below zero, no warning.

Files are read back by other hands than wrote them: numpy, json, pyarrow, scipy, h5py, mcap, jplephem, rosbags
(what scipy and mcap write is read by others in `test_exchange.py`). Line by line (`--follow`) a row that is refused is
left out instead, and the others hold.
"""

import json
import os
import warnings

import numpy as np
import pytest

import relnav
import relnav.cli
from relnav.errors import UsageError

pandas = pytest.importorskip("pandas", reason="pandas is not installed")

N = 24
BEACONS = [-1500.0, 0.0, 1500.0, 0.0, 0.0, 0.0]
MARKERS = [469.3, 553.7, 553.7, 553.7, 511.5, 511.5]
NAMES = [f"spot_{beacon}_{axis}" for beacon in "abc" for axis in "xy"]
CONTROL = {f"accel_{axis}_m_s2": 0.0 for axis in "xyz"}
HOSTILE = {
    "an acceleration at the limit": {"accel_x_m_s2": (8, 9.9e3)},
    "one after the other": {"accel_x_m_s2": (8, 9.9e3), "accel_y_m_s2": (9, -9.9e3), "accel_z_m_s2": (10, 1e-300)},
    "an impulse at the limit": {"delta_v_x_m_s": (8, 9.9e4), "delta_v_y_m_s": (0, 0.0), "delta_v_z_m_s": (9, -9.9e4)},
    "a gap of 3000 years": {"t_s": (12, 9.9e10)},
    "a gap of a microsecond": {"t_s": (12, 1e-6)},
    "spots beyond all detectors": {"spot_a": (8, 1e308), "spot_b": (9, -1e308), "spot_c": (10, 5e-324)},
    "a huge sigma": {"sigma": (8, 1e6)},
    "a tiny sigma": {"sigma": (8, 1e-12)},
}
TABLES = (".csv", ".jsonl", ".parquet", ".mat", ".nc")
EXCHANGE = (".oem", ".aem", ".mcap")


def log_of(kind, changes):
    """A log of spots that do not move, with a number exchanged from a row on."""
    unit, spots = ("_um", BEACONS) if kind == "beacons" else ("_px", MARKERS)
    columns = {"t_s": 0.1 * np.arange(N)}
    columns |= {name + unit: np.full(N, value) for name, value in zip(NAMES, spots, strict=True)}
    columns |= {name: np.zeros(N) for name in CONTROL}
    for name, (row, value) in changes.items():
        if name == "t_s":
            columns[name][row:] += value - 0.1 if value < 1.0 else value
        elif name == "sigma":
            columns |= {f"sigma_{spot}{unit}": np.full(N, 10.0) for spot in NAMES}
            for spot in NAMES:
                columns[f"sigma_{spot}{unit}"][row] = value
        else:
            place = f"{name}_x{unit}" if name.startswith("spot") else name
            columns.setdefault(place, np.zeros(N))[row] = value
    return pandas.DataFrame(columns)


@pytest.fixture(scope="module")
def tracks():
    """tracks(kind, name) -> the track of a hostile flight, filtered once, with warnings as errors."""
    made = {}

    def track(kind, name):
        if (kind, name) not in made:
            model = "three_beacon_psd" if kind == "beacons" else "three_marker_vision"
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                made[kind, name] = relnav.filter_log(log_of(kind, HOSTILE[name]), relnav.load_model(model))
        return made[kind, name]

    return track


def read(path):
    """Columns of a file, by name; empty and null are NaN."""
    ending = path.suffix
    if ending == ".csv":
        lines = [line for line in path.read_text().splitlines() if line[0] != "#"]
        table = np.genfromtxt(lines, delimiter=",", names=True)
        return {name: table[name] for name in table.dtype.names}
    if ending == ".jsonl":
        rows = [json.loads(line, parse_constant=pytest.fail) for line in path.read_text().splitlines()]
        rows = [row for row in rows if "t_s" in row]
        return {name: np.array([row.get(name) for row in rows], dtype=float) for name in rows[0]}
    if ending == ".parquet":
        table = pytest.importorskip("pyarrow.parquet", reason="the extra `parquet` is not installed").read_table(path)
        return {name: np.array(table[name].to_pylist(), dtype=float) for name in table.column_names}
    if ending == ".mat":
        from scipy.io import loadmat

        content = loadmat(path, squeeze_me=True)["track"]
        columns = {name: content[name][()] for name in content.dtype.names}
        return {name: value for name, value in columns.items() if getattr(value, "dtype", np.dtype("O")).kind in "fi"}
    h5py = pytest.importorskip("h5py", reason="h5py, of the extra `netcdf`, is not installed")
    with h5py.File(path) as file:
        return {name: file[name][()] for name in file if file[name].dtype.kind in "fi"}


def hold(columns, known):
    """What has a state has all of it; variances and sigmas are not below zero; what has none, has none."""
    seen = 0
    for name, values in columns.items():
        values = np.asarray(values, dtype=float)
        assert not np.isinf(values).any(), name
        parts = name.split("_")
        variance = name.startswith("sigma_") or (name.startswith("cov_") and len(set(parts[-2:])) == 1)
        if variance:
            assert not (values < 0.0).any(), name
        if variance or name in ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"):
            seen += 1
            assert np.isfinite(values[known]).all(), name
            assert np.isnan(values[~known]).all(), name
        if "covariance" in name and values.ndim == 3:
            seen += 1
            values = values if len(values) == len(known) else np.moveaxis(values, -1, 0)
            assert (np.diagonal(values, axis1=-2, axis2=-1)[known] >= 0.0).all(), name
            assert np.isfinite(values[known]).all(), name
    assert seen, f"nothing that was held: {list(columns)}"


def refusal(track, path, **told):
    """The sentence with which a track is not written; None if it is."""
    try:
        relnav.write(track, path, **told)
    except UsageError as error:
        return str(error)
    return None


def flights(names):
    """Of both kinds; a log of markers has no sigmas."""
    return [
        (kind, name) for kind in ("beacons", "markers") for name in names if kind == "beacons" or "sigma" not in name
    ]


FLIGHTS = flights(HOSTILE)


@pytest.mark.parametrize(("kind", "name"), FLIGHTS)
def test_a_track_of_spots(tracks, tmp_path, kind, name, recwarn):
    track = tracks(kind, name)
    known = np.isfinite(track.state[:, 0])
    assert known.any(), "the flight is accepted"
    for state, covariance in zip(track.state[known], track.covariance[known], strict=True):
        assert np.isfinite(state).all()
        assert np.isfinite(covariance).all()
        assert (np.diagonal(covariance) > 0.0).all()
    for ending in TABLES:
        path = tmp_path / f"track{ending}"
        if (missing := refusal(track, path)) is None:
            hold(read(path), known)
        else:
            assert "install" in missing
    for ending in EXCHANGE:
        if ending == ".aem" and kind == "beacons":
            continue
        path = tmp_path / f"track{ending}"
        told = {} if ending == ".mcap" else {"epoch": "2026-01-01T00:00:00"}
        more = {"orientation_deg": (51.6, 0.0, 0.0)} if ending == ".aem" else {}
        refused = refusal(track, path, **told, **more)
        if refused is not None:  # a time that the format cannot hold, or a package that is missing
            assert "\n" not in refused
            assert not path.exists()
            continue
        if ending == ".mcap":
            from mcap.reader import make_reader

            with path.open("rb") as file:
                for _, _, message in make_reader(file).iter_messages():
                    json.loads(message.data, parse_constant=pytest.fail)
        else:
            words = path.read_text().lower().split()
            assert not {"nan", "inf", "-inf", "infinity"} & set(words)
    assert [str(one.message) for one in recwarn] == []


KERNELS = {"beacons": (".bsp",), "markers": (".bsp", ".bc")}
REFUSED_KERNELS = {"a gap of a microsecond": "less than a microsecond apart"}
INERTIAL = {"epoch": "2026-01-01T00:00:00", "orientation_deg": (51.6, 0.0, 0.0)}


@pytest.mark.parametrize(("kind", "name"), FLIGHTS)
def test_kernels_of_spice(tracks, tmp_path, kind, name, recwarn):
    """Every number of every segment, as it lies in the file."""
    pytest.importorskip("spiceypy", reason="spiceypy is not installed")
    daf = pytest.importorskip("jplephem.daf", reason="jplephem is not installed")
    track, written = tracks(kind, name), 0
    for ending in KERNELS[kind]:
        for frame in ("eci_relative", "eci") if ending == ".bsp" else (None,):
            path = tmp_path / f"{frame}{ending}"
            told = INERTIAL if frame is None else {"frame": frame, **INERTIAL}
            if (refused := refusal(track, path, **told)) is not None:
                assert "\n" not in refused
                assert list(tmp_path.glob(f"{frame}.*")) == []
                continue
            written += 1
            with path.open("rb") as file:
                kernel = daf.DAF(file)
                segments = [(values[0], values[1], values[-2:]) for _, values in kernel.summaries()]
                assert segments
                for first, last, place in segments:
                    assert first < last
                    assert np.isfinite(kernel.read_array(*place)).all()
    assert written or name in REFUSED_KERNELS
    assert [str(one.message) for one in recwarn] == []


@pytest.mark.parametrize(("kind", "name"), FLIGHTS)
def test_a_bag_of_ros(tracks, tmp_path, kind, name, recwarn):
    highlevel = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
    track, path = tracks(kind, name), tmp_path / "track.rosbag2"
    if (refused := refusal(track, path)) is not None:
        assert name == "a gap of 3000 years"
        assert "times from 0 to" in refused
        assert list(tmp_path.iterdir()) == []
        return
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with highlevel.AnyReader([path], default_typestore=store) as reader:
        messages = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()]
    assert len(messages) == np.isfinite(track.state[:, 0]).sum() > 0
    for message in messages:
        at, turn = message.pose.pose.position, message.pose.pose.orientation
        assert np.isfinite([at.x, at.y, at.z]).all()
        assert np.hypot(np.hypot(turn.x, turn.y), np.hypot(turn.z, turn.w)) == pytest.approx(1.0, abs=1e-12)
        covariance = message.pose.covariance.reshape(6, 6)
        assert np.isfinite(covariance).all()
        assert (np.diagonal(covariance) > 0.0).all()
    assert [str(one.message) for one in recwarn] == []


def follow(text, model, out):
    """The exit code of `relnav filter --follow` on a pipe that holds this text."""
    read_end, write_end = os.pipe()
    os.write(write_end, text.encode())
    os.close(write_end)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return relnav.cli.run(
                ["filter", "--follow", f"/dev/fd/{read_end}", "--model", model, "--out", str(out), "--quiet"]
            )
    finally:
        os.close(read_end)


REFUSED_ROWS = {
    "an acceleration of 1e308": {"accel_x_m_s2": (8, 1e308)},
    "an acceleration that is not a number": {"accel_x_m_s2": (8, float("nan"))},
    "a time of 1e300": {"t_s": (23, 1e300)},
    "a negative sigma": {"sigma": (8, -1.0)},
}


@pytest.mark.skipif(os.name == "nt", reason="/dev/fd")
@pytest.mark.parametrize(("kind", "name"), [*FLIGHTS, *flights(REFUSED_ROWS)])
def test_line_by_line(tmp_path, capsys, kind, name):
    log = log_of(kind, (HOSTILE | REFUSED_ROWS)[name])
    model = "three_beacon_psd" if kind == "beacons" else "three_marker_vision"
    for ending in (".csv", ".jsonl"):
        out = tmp_path / f"track{ending}"
        assert follow(log.to_csv(index=False), model, out) == 0
        said = capsys.readouterr().err.splitlines()
        assert len(said) == (name in REFUSED_ROWS), said
        columns = read(out)
        assert len(columns["t_s"]) == N - len(said)
        known = np.isfinite(columns["x_m"])
        assert known.any()
        hold(columns, known)


VEHICLE = {
    "a thrust at the limit": "1.0,thrust,999.0,-999.0,999.0",
    "a gyro at the limit": "1.0,gyro,99.0,-99.0,99.0",
    "a gap of a day": "86400.0,gyro,0,0,0",
    "a sun of no use": "1.0,sun_aps,0,0,1,1e300,0,0,1e300,0,0",
    "lights beyond all detectors": "1.0,camera,1e300,1e300,-1e300,1e300,0,0",
    "a star that looks away": "1.0,star,0,0,0,1",
}


@pytest.mark.parametrize("name", VEHICLE)
def test_a_vehicles_track(tmp_path, capsys, recwarn, name):
    """By the command: accepted with a track that holds, or refused in a sentence that leaves nothing."""
    rows = ["t_s,sensor," + ",".join(f"v{k}" for k in range(12))]
    every = [f"{0.01 * k:.2f},gyro,0,0.00113,0" for k in range(100)]
    every += [VEHICLE[name], "1.2,gyro,0,0,0", "2.5,gyro,0,0,0"]
    rows += [line + "," * (13 - line.count(",")) for line in every]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(rows))
    for ending in (".csv", ".jsonl", ".parquet"):
        out = tmp_path / f"track{ending}"
        code = relnav.cli.run(["filter", str(log), "--model", "rendezvous_demo", "--out", str(out), "--quiet"])
        said = capsys.readouterr().err
        if code:
            assert code == 3
            assert said.count("\n") == 1
            assert not out.exists()
            continue
        assert said == ""
        columns = read(out)
        hold(columns, np.ones(len(columns["t_s"]), dtype=bool))
    assert [str(one.message) for one in recwarn] == []
