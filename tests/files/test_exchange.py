"""Other programs' formats, each read back by a library that is not ours."""

import json
from pathlib import Path

import numpy as np
import pytest

import relnav
import relnav.cli
from relnav.errors import UsageError
from relnav.files import optional
from relnav.files.marker_logs import filter_marker_log, write_marker_log
from relnav.files.tracks import EXCHANGE, joined
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

EPOCH = "2026-07-02T12:00:00"
ORIENTATION_DEG = (51.6, 130.0, 40.0)
EXAMPLE = Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("exchange") / "log.csv"
    path.write_text("".join(EXAMPLE.read_text().splitlines(keepends=True)[:61]))
    return path


@pytest.fixture(scope="module")
def solution(log):
    return relnav.filter_log(log, "three_beacon_psd")


def test_mat_by_scipy(solution, tmp_path):
    from scipy.io import loadmat

    relnav.write(solution, tmp_path / "track.mat")
    track = loadmat(tmp_path / "track.mat", simplify_cells=True)["track"]
    np.testing.assert_array_equal(track["x_m"], solution.state[:, 0])
    np.testing.assert_array_equal(np.moveaxis(track["covariance"], 2, 0), solution.covariance)
    assert track["units"]["vx_m_s"] == "m s-1"
    assert "model = three_beacon_psd" in track["about"]


@pytest.mark.parametrize(
    ("frame", "center", "axes"),
    [("rsw", "TARGET", "RTN"), ("eci", "EARTH", "EME2000"), ("lvlh_ccsds", "TARGET", "RTN")],
)
def test_oem_by_ccsds_ndm(solution, tmp_path, frame, center, axes, outside):
    ccsds_ndm = pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")
    path = tmp_path / "track.oem"
    relnav.write(solution, path, frame=frame, orientation_deg=ORIENTATION_DEG, epoch=EPOCH)
    (segment,) = ccsds_ndm.from_file(str(path)).segments
    assert (segment.metadata.center_name, segment.metadata.ref_frame) == (center, axes)
    track = solution.in_frame("rsw" if frame == "lvlh_ccsds" else frame, orientation_deg=ORIENTATION_DEG)
    known = np.isfinite(track.state[:, 0])
    np.testing.assert_allclose(1e3 * segment.data.state_vector_numpy, track.state[known], rtol=1e-15)
    covariance = track.covariance[known]
    np.testing.assert_allclose(1e6 * segment.data.covariance_matrix_numpy, covariance, rtol=1e-14)
    off = np.abs(1e3 * segment.data.state_vector_numpy - track.state[known]) / np.abs(track.state[known])
    outside("ccsds-ndm-py", "OEM read back, states, relative", off.max(), 1e-15)
    sizes = np.sqrt(np.einsum("nii,njj->nij", covariance, covariance))
    off = np.abs(1e6 * segment.data.covariance_matrix_numpy - covariance) / sizes
    outside("ccsds-ndm-py", "OEM read back, covariances, of the two sigmas", off.max(), 1e-14)
    assert segment.data.state_vector_epochs[0] == "2026-07-02T12:00:00.100000"
    assert len(segment.data.covariance_matrix_epochs) == known.sum()


def test_netcdf_by_h5py(solution, tmp_path):
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    pytest.importorskip("xarray", reason="xarray is not installed")
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    for ending in ("nc", "h5"):
        relnav.write(solution, tmp_path / f"track.{ending}")
        with h5py.File(tmp_path / f"track.{ending}") as file:
            np.testing.assert_array_equal(file["x"][:], solution.state[:, 0])
            np.testing.assert_array_equal(file["covariance"][:], solution.covariance)
            assert file["vx"].attrs["units"] in ("m s-1", b"m s-1")
            assert file.attrs["Conventions"] in ("CF-1.11", b"CF-1.11")


def test_mcap_by_its_own_reader(solution, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    relnav.write(solution, tmp_path / "track.mcap")
    with (tmp_path / "track.mcap").open("rb") as file:
        messages = [
            (schema.name, channel.topic, message.log_time, json.loads(message.data))
            for schema, channel, message in reader.make_reader(file).iter_messages()
        ]
    poses = [m for m in messages if m[1] == "/relnav/pose"]
    states = [m for m in messages if m[1] == "/relnav/state"]
    known = np.flatnonzero(np.isfinite(solution.state[:, 0]))
    assert len(poses) == len(states) == len(known)
    assert poses[0][0] == "foxglove.PoseInFrame"
    assert poses[0][3]["pose"]["position"] == dict(zip("xyz", solution.state[known[0], :3].tolist(), strict=True))
    np.testing.assert_allclose([m[2] * 1e-9 for m in states], solution.t_s[known], atol=1e-9)
    np.testing.assert_array_equal(states[-1][3]["covariance"], solution.covariance[-1].ravel())


@pytest.fixture(scope="module")
def poses(tmp_path_factory):
    mission = relnav.load_model("three_marker_vision")
    path = tmp_path_factory.mktemp("poses") / "log.csv"
    write_marker_log(simulate_flight(mission, Approach(duration_s=4.0, rate_hz=2.0), seed=1), path)
    return filter_marker_log(path, mission)


def test_aem_by_ccsds_ndm(poses, tmp_path, outside):
    from scipy.spatial.transform import Rotation

    ccsds_ndm = pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")
    relnav.write(poses, tmp_path / "target.aem", orientation_deg=ORIENTATION_DEG, epoch=EPOCH)
    (segment,) = ccsds_ndm.from_file(str(tmp_path / "target.aem")).segments
    assert (segment.metadata.ref_frame_a, segment.metadata.ref_frame_b) == ("EME2000", "SC_BODY_1")
    known = np.flatnonzero(np.isfinite(poses.state[:, 0]))
    states = poses.in_frame("eci_relative", orientation_deg=ORIENTATION_DEG).state
    assert len(segment.data.attitude_states) == len(known) > 3
    off = 0.0
    for entry, e in zip(segment.data.attitude_states, known, strict=True):
        target_from_eci = Rotation.from_quat(entry.values).as_matrix()
        in_target = target_from_eci @ states[e, :3]
        off = max(off, np.abs(in_target - poses.dcm_lvlh_from_target[e].T @ poses.state[e, :3]).max())
    outside("ccsds-ndm-py", "AEM read back, the chaser's place turned by it, m", off, 1e-9)


def test_every_format_by_the_command(log, solution, tmp_path):
    for ending in (".oem", ".mat"):
        out = tmp_path / f"track{ending}"
        arguments = ["filter", log, "--model", "three_beacon_psd", "--out", out, "--epoch", EPOCH, "--quiet"]
        assert relnav.cli.run([str(a) for a in arguments]) == 0
        relnav.write(solution, tmp_path / f"same{ending}", epoch=EPOCH)
        dated = out.read_bytes().split(b"\n")[3:] if ending == ".oem" else out.read_bytes()[128:]
        same = (tmp_path / f"same{ending}").read_bytes()
        assert dated == (same.split(b"\n")[3:] if ending == ".oem" else same[128:])


def test_a_table_in_another_frame(log, solution, tmp_path):
    out = tmp_path / "track.csv"
    arguments = ["filter", log, "--model", "three_beacon_psd", "--out", out, "--frame", "rsw", "--quiet"]
    assert relnav.cli.run([str(a) for a in arguments]) == 0
    text = out.read_text()
    assert "# frame = rsw: (= RTN" in text
    rows = np.genfromtxt([line for line in text.splitlines() if line[0] != "#"], delimiter=",", names=True)
    track = solution.in_frame("rsw")
    np.testing.assert_array_equal(rows["y_m"], track.state[:, 1])
    np.testing.assert_array_equal(rows["sigma_vz_m_s"], track.sigma[:, 5])
    np.testing.assert_array_equal(rows["cov_x_vy"], track.covariance[:, 0, 4])
    np.testing.assert_array_equal(rows["range_m"], solution.range_m)


def test_parts_joined_are_the_whole(solution):
    again = joined([solution.part(0, 20), solution.part(20, 60)])
    np.testing.assert_array_equal(again.covariance, solution.covariance)
    assert len(again) == len(solution)


@pytest.mark.parametrize(
    ("name", "keywords", "said"),
    [
        ("a.oem", {}, "an OEM needs the date of the log's t = 0"),
        ("a.oem", {"epoch": "yesterday"}, "epoch is an ISO date and time"),
        ("a.oem", {"epoch": "9999-12-31T23:59:59"}, "lies beyond the year 9999"),
        ("a.oem", {"epoch": EPOCH, "frame": "dock"}, "an OEM holds frames rsw, eci_relative, eci; got 'dock'"),
        *(
            (
                f"a{ending}",
                {"frame": "rsw"},
                rf"a\{ending}: \{ending} holds what the filter has, in lvlh_ccsds; frame rsw",
            )
            for ending in (".mat", ".nc", ".h5", ".mcap", ".rosbag2", ".bc")
        ),
        ("a.aem", {"epoch": EPOCH}, "which a three-beacon track does not estimate"),
        ("a.xyz", {}, r"a table ends in \.csv, \.jsonl or \.parquet"),
    ],
)
def test_what_cannot_be_written_is_said(solution, tmp_path, name, keywords, said):
    with pytest.raises(UsageError, match=said):
        relnav.write(solution, tmp_path / name, **keywords)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("ending", "package"), [(".nc", "xarray"), (".h5", "h5py"), (".mcap", "mcap")])
def test_a_missing_package_is_named_with_its_line(solution, tmp_path, monkeypatch, ending, package):
    def missing(name):
        if name.startswith(package):
            raise ImportError(name)

    monkeypatch.setattr(optional, "import_module", missing)
    extra = "mcap" if ending == ".mcap" else "netcdf"
    with pytest.raises(UsageError, match=rf"needs {package}: pip install 'relnav\[{extra}\]'"):
        relnav.write(solution, tmp_path / f"a{ending}")
    assert ending in EXCHANGE
