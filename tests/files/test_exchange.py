"""Other programs' formats, each read back by a library that is not ours."""

import json
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
import relnav.cli
from relnav.errors import UsageError
from relnav.files import optional
from relnav.files.tracks import EXCHANGE, joined

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


@pytest.mark.parametrize("frame", ["lvlh_ccsds", "rsw"])
@pytest.mark.parametrize("of", ["solution", "poses"])
def test_mat_by_libmatio(mat_variables, of, frame, request, tmp_path, outside):
    solution = request.getfixturevalue(of)
    relnav.write(solution, tmp_path / "track.mat", frame=frame)
    (track,) = mat_variables(tmp_path / "track.mat").values()
    turned = solution.in_frame(frame)
    np.testing.assert_array_equal(track["x_m"], turned.state[:, [0]])
    np.testing.assert_array_equal(np.moveaxis(track["covariance"], 2, 0), turned.covariance)
    known = np.isfinite(turned.state[:, 0])
    outside("libmatio", "MATLAB file read back, x m", np.abs(track["x_m"][:, 0] - turned.state[:, 0])[known].max(), 0.0)
    assert track["units"]["vx_m_s"] == "m s-1"
    assert f"model = {solution.model}" in track["about"]
    assert f"frame = {frame}" in track["about"]
    if of == "poses":
        axes = {"lvlh_ccsds": "lvlh"}.get(frame, frame)
        quaternions = np.hstack([track[f"q_{axes}_from_target_{axis}"] for axis in "xyzw"])
        np.testing.assert_array_equal(quaternions, turned.q_frame_from_target)
        np.testing.assert_array_equal(track["port_x_m"][:, 0], solution.port_m[:, 0])


@pytest.mark.parametrize(
    ("of", "frame", "center", "axes"),
    [
        ("solution", "rsw", "TARGET", "RTN"),
        ("solution", "eci", "EARTH", "EME2000"),
        ("solution", "lvlh_ccsds", "TARGET", "RTN"),
        ("poses", "eci_relative", "TARGET", "EME2000"),
    ],
)
def test_oem_by_ccsds_ndm(of, request, tmp_path, frame, center, axes, outside):
    ccsds_ndm = pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")
    path, solution = tmp_path / "track.oem", request.getfixturevalue(of)
    relnav.write(solution, path, frame=frame, orientation_deg=ORIENTATION_DEG, epoch=EPOCH)
    (segment,) = ccsds_ndm.from_file(str(path)).segments
    assert (segment.metadata.center_name, segment.metadata.ref_frame) == (center, axes)
    track = solution.in_frame("rsw" if frame == "lvlh_ccsds" else frame, orientation_deg=ORIENTATION_DEG)
    known = np.isfinite(track.state[:, 0])
    np.testing.assert_allclose(1e3 * segment.data.state_vector_numpy, track.state[known], rtol=1e-15)
    covariance = track.covariance[known, :6, :6]
    np.testing.assert_allclose(1e6 * segment.data.covariance_matrix_numpy, covariance, rtol=1e-14)
    off = np.abs(1e3 * segment.data.state_vector_numpy - track.state[known]) / np.abs(track.state[known])
    outside("ccsds-ndm-py", "OEM read back, states, relative", off.max(), 1e-15)
    sizes = np.sqrt(np.einsum("nii,njj->nij", covariance, covariance))
    off = np.abs(1e6 * segment.data.covariance_matrix_numpy - covariance) / sizes
    outside("ccsds-ndm-py", "OEM read back, covariances, of the two sigmas", off.max(), 1e-14)
    first = solution.t_s[known][0]
    assert segment.data.state_vector_epochs[0] == f"2026-07-02T12:00:{first:09.6f}"
    assert len(segment.data.covariance_matrix_epochs) == known.sum()


@pytest.mark.parametrize(("of", "frame"), [("solution", "lvlh_ccsds"), ("solution", "eci"), ("poses", "rsw")])
def test_netcdf_by_h5py(of, frame, request, tmp_path):
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    pytest.importorskip("xarray", reason="xarray is not installed")
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    solution = request.getfixturevalue(of)
    turned = solution.in_frame(frame, orientation_deg=ORIENTATION_DEG)
    for ending in ("nc", "h5"):
        relnav.write(solution, tmp_path / f"track.{ending}", frame=frame, orientation_deg=ORIENTATION_DEG)
        with h5py.File(tmp_path / f"track.{ending}") as file:
            np.testing.assert_array_equal(file["x"][:], turned.state[:, 0])
            np.testing.assert_array_equal(file["covariance"][:], turned.covariance)
            assert file["vx"].attrs["units"] in ("m s-1", b"m s-1")
            assert file["sigma_x"].attrs["units"] in ("m", b"m")
            assert file.attrs["Conventions"] in ("CF-1.11", b"CF-1.11")
            assert f"{frame}: " in str(file.attrs["frame"])
            if of == "poses":
                quaternions = np.stack([file[f"q_rsw_from_target_{axis}"][:] for axis in "xyzw"], axis=1)
                np.testing.assert_array_equal(quaternions, turned.q_frame_from_target)
                assert file["sigma_turn_x"].attrs["units"] in ("degree", b"degree")
                assert file["rate_x"].attrs["units"] in ("degree s-1", b"degree s-1")


@pytest.mark.parametrize("ending", [".nc", ".h5"])
@pytest.mark.parametrize(("of", "frame"), [("solution", "eci"), ("poses", "rsw")])
def test_netcdf_by_netcdf_c(of, frame, ending, request, tmp_path, outside):
    """Unidata's library, which shares no line with what writes: values, and NaN where the file has none."""
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    pytest.importorskip("xarray", reason="xarray is not installed")
    netcdf = pytest.importorskip("netCDF4", reason="netCDF4 is not installed")
    solution = request.getfixturevalue(of)
    turned = solution.in_frame(frame, orientation_deg=ORIENTATION_DEG)
    relnav.write(solution, tmp_path / f"track{ending}", frame=frame, orientation_deg=ORIENTATION_DEG)
    with netcdf.Dataset(tmp_path / f"track{ending}") as file:
        x, covariance = file["x"][:].filled(np.nan), file["covariance"][:].filled(np.nan)
        np.testing.assert_array_equal(x, turned.state[:, 0])
        np.testing.assert_array_equal(covariance, turned.covariance)
        assert (file["vx"].units, file.Conventions) == ("m s-1", "CF-1.11")
    known = np.isfinite(turned.state[:, 0])
    outside("netCDF-C", "track read back, x m", float(np.abs(x - turned.state[:, 0])[known].max()), 0.0)


def test_markers_in_pandas_and_xarray(poses):
    pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip("pandas", reason="pandas is not installed")
    table, data = poses.to_dataframe(), poses.to_xarray()
    np.testing.assert_array_equal(table["port_vx_m_s"], poses.port_velocity_m_s[:, 0])
    assert table.attrs["units"]["relative_rate_x_deg_s"] == "degree s-1"
    together = data["covariance"].sel(component="turn_x", component_2="vx")
    np.testing.assert_array_equal(together, poses.covariance[:, 6, 3])
    assert data["sigma_port_turn_y"].attrs["units"] == "degree"
    assert data["port_x"].attrs["units"] == "m"


@pytest.mark.parametrize(("of", "frame"), [("solution", "lvlh_ccsds"), ("solution", "rsw"), ("poses", "eci_relative")])
def test_mcap_by_small_mcap(mcap_messages, of, frame, request, tmp_path, outside):
    """Poses with covariance in the axes that they name, states in the frame asked for; all as their schemas say."""
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    pytest.importorskip("mcap", reason="mcap is not installed")
    solution = request.getfixturevalue(of)
    relnav.write(solution, tmp_path / "track.mcap", frame=frame, orientation_deg=ORIENTATION_DEG)
    known = np.flatnonzero(np.isfinite(solution.state[:, 0]))
    turned = solution.in_frame(frame, orientation_deg=ORIENTATION_DEG)
    topics, names, schemas = {}, {}, {}
    for topic, name, schema, time, data in mcap_messages(tmp_path / "track.mcap"):
        message, names[topic] = json.loads(data), name
        if topic not in schemas:
            schemas[topic] = jsonschema.Draft202012Validator(json.loads(schema))
        schemas[topic].validate(message)
        topics.setdefault(topic, []).append((time, message))
    assert names == {
        "/relnav/pose": "foxglove.PoseInFrame",
        "/relnav/pose_with_covariance": "geometry_msgs/PoseWithCovarianceStamped",
        "/relnav/state": "relnav.RelativeState",
    }
    assert {len(messages) for messages in topics.values()} == {len(known)}
    for e, (time, pose), (_, stamped), (_, state) in zip(known, *topics.values(), strict=True):
        assert time * 1e-9 == pytest.approx(solution.t_s[e], abs=1e-9)
        assert stamped["header"]["stamp"] == state["timestamp"] == {"sec": time // 10**9, "nsec": time % 10**9}
        assert stamped["pose"]["pose"] == pose["pose"]
        assert stamped["header"]["frame_id"] == pose["frame_id"] == (frame if of == "solution" else "target_port")
        assert state["frame_id"] == frame
        np.testing.assert_array_equal(state["state"], turned.state[e])
        np.testing.assert_array_equal(state["covariance"], turned.covariance[e].ravel())
        place, covariance = list(pose["pose"]["position"].values()), np.reshape(stamped["pose"]["covariance"], (6, 6))
        if of == "solution":
            np.testing.assert_array_equal(place, turned.state[e, :3])
            np.testing.assert_array_equal(covariance[:3, :3], turned.covariance[e, :3, :3])
            assert (covariance.diagonal()[3:] == 1e6).all()
            continue
        np.testing.assert_array_equal(place, solution.port_m[e])
        chaser = Rotation.from_quat(list(pose["pose"]["orientation"].values()))
        np.testing.assert_allclose(chaser.as_matrix(), solution.dcm_target_from_chaser[e], atol=1e-12)
        target = Rotation.from_quat(list(state["q_from_target"].values()))
        np.testing.assert_allclose(target.as_matrix(), turned.dcm_frame_from_target[e], atol=1e-12)
    places = [list(pose["pose"]["position"].values()) for _, pose in topics["/relnav/pose"]]
    off = np.abs(np.array(places) - (turned.state[known, :3] if of == "solution" else solution.port_m[known])).max()
    outside("small-mcap", "MCAP read back, positions, m", off, 0.0)
    if of == "poses":
        assert_turns_about_fixed_axes(solution, known[-1], chaser, covariance)


def assert_turns_about_fixed_axes(solution, e, chaser, covariance):
    """Draws of the docking errors, as turns about fixed axes that take the pose to the truth, are spread like that."""
    draws = np.random.default_rng(9).multivariate_normal(np.zeros(12), solution.docking_covariance[e], size=20_000)
    true = (chaser.inv() * Rotation.from_rotvec(draws[:, 6:9])).inv()  # true dcm^T = dcm^T exp([theta x])
    turns = (true * chaser.inv()).as_rotvec()
    found = np.cov(np.hstack([draws[:, :3], turns]).T)
    scale = np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))
    np.testing.assert_allclose(found / scale, covariance / scale, atol=0.04)  # 1 / sqrt(20,000) is 0.007


def ccsds_matrix(q1, q2, q3, qc):
    """M of x_B = M x_A as CCSDS 504.0-B writes it in its annex on conversions."""
    return np.array(
        [
            [q1**2 - q2**2 - q3**2 + qc**2, 2 * (q1 * q2 + q3 * qc), 2 * (q1 * q3 - q2 * qc)],
            [2 * (q1 * q2 - q3 * qc), -(q1**2) + q2**2 - q3**2 + qc**2, 2 * (q2 * q3 + q1 * qc)],
            [2 * (q1 * q3 + q2 * qc), 2 * (q2 * q3 - q1 * qc), -(q1**2) - q2**2 + q3**2 + qc**2],
        ]
    )


def test_aem_by_brahe(poses, tmp_path, outside):
    """A reader that turns the quaternion into a matrix itself."""
    ccsds = pytest.importorskip("brahe.ccsds", reason="brahe is not installed")
    relnav.write(poses, tmp_path / "target.aem", orientation_deg=ORIENTATION_DEG, epoch=EPOCH)
    (segment,) = ccsds.AEM.from_file(str(tmp_path / "target.aem")).segments
    known, off = np.flatnonzero(np.isfinite(poses.state[:, 0])), 0.0
    states = poses.in_frame("eci_relative", orientation_deg=ORIENTATION_DEG).state
    for entry, e in zip(segment.states, known, strict=True):
        target_from_eci = np.array(entry.quaternion.to_rotation_matrix().to_matrix())
        in_target = target_from_eci @ states[e, :3]
        off = max(off, np.abs(in_target - poses.dcm_lvlh_from_target[e].T @ poses.state[e, :3]).max())
    outside("brahe", "AEM read back, the chaser's place turned by it, m", off, 1e-9)


def test_aem_by_ccsds_ndm(poses, tmp_path, outside):
    ccsds_ndm = pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")
    relnav.write(poses, tmp_path / "target.aem", orientation_deg=ORIENTATION_DEG, epoch=EPOCH)
    (segment,) = ccsds_ndm.from_file(str(tmp_path / "target.aem")).segments
    assert (segment.metadata.ref_frame_a, segment.metadata.ref_frame_b) == ("EME2000", "SC_BODY_1")
    known = np.flatnonzero(np.isfinite(poses.state[:, 0]))
    states = poses.in_frame("eci_relative", orientation_deg=ORIENTATION_DEG).state
    assert len(segment.data.attitude_states) == len(known) > 3
    off = 0.0
    for entry, e in zip(segment.data.attitude_states, known, strict=True):
        target_from_eci = ccsds_matrix(*map(float, entry.values))
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


def filtered_in_eci(log, out, *more):
    arguments = ["filter", log, "--model", "three_marker_vision", "--out", out, "--frame", "eci_relative", "--quiet"]
    assert relnav.cli.run([str(a) for a in [*arguments, "--orbit-deg", *ORIENTATION_DEG, *more]]) == 0
    return out.read_text()


def test_a_table_of_markers_in_another_frame(marker_log, poses, tmp_path):
    text = filtered_in_eci(marker_log, tmp_path / "track.csv")
    assert "# frame = eci_relative: chaser minus target in inertial axes" in text
    assert "; ports and turns in target axes\n" in text
    assert "# target orbit = two-body, mean motion" in text
    rows = np.genfromtxt([line for line in text.splitlines() if line[0] != "#"], delimiter=",", names=True)
    track = poses.in_frame("eci_relative", orientation_deg=ORIENTATION_DEG)
    np.testing.assert_array_equal(rows["vy_m_s"], track.state[:, 4])
    np.testing.assert_array_equal([rows[f"q_eci_from_target_{axis}"] for axis in "xyzw"], track.q_frame_from_target.T)
    np.testing.assert_array_equal(rows["sigma_vz_m_s"], track.sigma[:, 5])
    np.testing.assert_array_equal(rows["cov_x_turn_y"], track.covariance[:, 0, 7])
    np.testing.assert_array_equal(rows["cov_turn_x_turn_y"], poses.covariance[:, 6, 7])
    np.testing.assert_array_equal(rows["rate_z_deg_s"], np.degrees(poses.rate_rad_s[:, 2]))
    np.testing.assert_array_equal(rows["port_x_m"], poses.port_m[:, 0])
    relnav.write(poses, tmp_path / "same.csv", frame="eci_relative", orientation_deg=ORIENTATION_DEG)
    lines = [line for line in (tmp_path / "same.csv").read_text().splitlines() if line[0] != "#"]
    assert lines == [line for line in text.splitlines() if line[0] != "#"]


@pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")
def test_a_followed_log_of_markers_in_another_frame(marker_log, tmp_path):
    os.mkfifo(tmp_path / "log.csv")
    writer = threading.Thread(target=(tmp_path / "log.csv").write_text, args=(marker_log.read_text(),))
    writer.start()
    followed = filtered_in_eci(tmp_path / "log.csv", tmp_path / "live.csv", "--follow")
    writer.join()
    assert followed == filtered_in_eci(marker_log, tmp_path / "track.csv")


NEEDS_DATE, NEEDS_ORBIT = "needs the date of the log's t = 0", "needs the orientation of the target's orbit"
NO_ATTITUDE = "attitudes, which a three-beacon track does not estimate; write its states, "
DATED, SPACE = ["--epoch", EPOCH], ["--orbit-deg", "51.6", "130", "40"]


@pytest.mark.parametrize(
    ("model", "name", "options", "said"),
    [
        ("three_beacon_psd", "a.oem", [], "an OEM " + NEEDS_DATE),
        ("three_beacon_psd", "a.oem", ["--epoch", "today"], "epoch is an ISO date and time"),
        ("three_beacon_psd", "a.oem", [*DATED, "--frame", "eci"], NEEDS_ORBIT),
        ("three_beacon_psd", "a.oem", [*DATED, "--frame", "dock"], "an OEM holds frames rsw, eci_relative, eci"),
        ("three_beacon_psd", "a.aem", [*DATED, *SPACE], NO_ATTITUDE + ".oem"),
        ("three_beacon_psd", "a.bsp", [*SPACE], "an SPK " + NEEDS_DATE),
        ("three_beacon_psd", "a.bsp", [*DATED], NEEDS_ORBIT),
        ("three_beacon_psd", "a.bc", [*DATED, *SPACE], NO_ATTITUDE + ".bsp"),
        ("three_beacon_psd", "a.csv", ["--frame", "eci"], NEEDS_ORBIT),
        ("three_beacon_psd", "a.nc", ["--frame", "eci"], NEEDS_ORBIT),
        ("three_marker_vision", "a.oem", [], "an OEM " + NEEDS_DATE),
        ("three_marker_vision", "a.aem", [*SPACE], "an AEM " + NEEDS_DATE),
        ("three_marker_vision", "a.aem", [*DATED], NEEDS_ORBIT),
        ("three_marker_vision", "a.aem", [*DATED, *SPACE, "--frame", "rsw"], "against inertial axes alone"),
        ("three_marker_vision", "a.bc", [*DATED], NEEDS_ORBIT),
        ("three_marker_vision", "a.bc", [*SPACE], "a CK " + NEEDS_DATE),
        ("three_marker_vision", "a.csv", ["--frame", "eci"], NEEDS_ORBIT),
        ("three_marker_vision", "a.csv", ["--frame", "eci", "--follow"], NEEDS_ORBIT),
    ],
)
def test_what_a_format_needs_is_told_before_the_log_is_read(tmp_path, capsys, model, name, options, said):
    """The log is none: read, it would end in another sentence and exit code."""
    if name.endswith((".bsp", ".bc")):
        pytest.importorskip("spiceypy", reason="spiceypy is not installed")
    log = tmp_path / "log.csv"
    log.write_text("no log\n")
    assert relnav.cli.run(["filter", str(log), "--model", model, "--out", str(tmp_path / name), *options]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == [log]


@pytest.mark.parametrize("ending", [".nc", ".h5", ".mcap", ".rosbag2", ".bsp"])
def test_a_missing_package_is_told_before_the_log_is_read(tmp_path, capsys, monkeypatch, ending):
    def missing(name):
        raise ImportError(name)

    log = tmp_path / "log.csv"
    log.write_text("no log\n")
    monkeypatch.setattr(optional, "import_module", missing)
    arguments = ["filter", log, "--model", "three_beacon_psd", "--out", tmp_path / f"a{ending}", *DATED, *SPACE]
    assert relnav.cli.run([str(a) for a in arguments]) == 2
    assert "pip install 'relnav[" in capsys.readouterr().err


def test_what_is_no_solution_is_told(solution, tmp_path):
    with pytest.raises(UsageError, match=r"a solution as relnav\.filter_log returns it is expected; got a FramedTrack"):
        relnav.write(solution.in_frame("rsw"), tmp_path / "a.csv")


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
        ("a.oem", {"epoch": EPOCH, "frame": "eci"}, r"an OEM in eci is in inertial axes and needs .*\(--orbit-deg"),
        ("a.mat", {"frame": "eci"}, "frame 'eci' needs the orientation of the target's orbit"),
        ("a.mcap", {"frame": "rtn"}, "frame is one of lvlh_ccsds, rsw, dock, eci_relative, eci; got 'rtn'"),
        ("a.aem", {"epoch": EPOCH}, "which a three-beacon track does not estimate"),
        (
            "a.xyz",
            {},
            r"a table ends in \.csv, \.jsonl or \.parquet, other formats in \.oem, .*, \.bsp or \.bc; got '.xyz'",
        ),
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
