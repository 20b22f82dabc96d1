"""The approach in space: ellipsoids of the whole covariance, places spread over a run, capture limits."""

import csv
import json
import math
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
import relnav.cli
from relnav.files.approach_view import CaptureLimits, Place, Places, misalignments, verdicts

STATE = ("x_m", "y_m", "z_m")
RBAR = Rotation.from_matrix([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Docking axes of three_beacon_psd_rbar from lvlh_ccsds: x along R-bar, nadir."""
TURNED = Rotation.from_rotvec(np.radians([25.0, -40.0, 33.0]))
SIGMAS = np.array([0.004, 0.01, 0.03])


def made_track(path, count=90, model="three_beacon_psd_rbar"):
    """A track of a straight approach whose ellipsoids lie along TURNED in lvlh_ccsds, growing with the range."""
    names = ["t_s", *STATE, "range_m", "azimuth_deg", "elevation_deg", *(f"sigma_{name}" for name in STATE)]
    names += ["sigma_range_m", "sigma_azimuth_deg", "sigma_elevation_deg", "nis", "dof", "accepted", "alarm"]
    names += [f"cov_{'xyz'[i]}_{'xyz'[j]}" for i in range(3) for j in range(i, 3)]
    with path.open("w", newline="") as file:
        file.write(f"# model = {model}\n")
        writer = csv.writer(file)
        writer.writerow(names)
        for k in range(count):
            r = 8.0 - 0.05 * k
            spread = TURNED.as_matrix() @ np.diag((SIGMAS * r / 8.0) ** 2) @ TURNED.as_matrix().T
            p = RBAR.inv().apply([r, 0.0, 0.0])
            sigma = np.sqrt(np.diag(spread))
            row = [0.1 * k, *p, r, 0.0, 0.0, *sigma, 0.02, 0.2, 0.3, 6.0, 6, 3, 0, *spread[np.triu_indices(3)]]
            writer.writerow([repr(float(value)) for value in row])
    return path


def report(source, *options):
    out = source.with_suffix(".html")
    assert relnav.cli.run(["report", str(source), "--out", str(out), "--quiet", *map(str, options)]) == 0
    page = out.read_text(encoding="utf-8")
    return page, json.loads(re.search(r'id="data">(.*?)</script>', page, re.S).group(1))["path"]


def rows_of(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return np.genfromtxt(lines, delimiter=",", names=True)


def covariances(rows, name="cov_"):
    upper = [rows[f"{name}{'xyz'[i]}_{'xyz'[j]}"] for i in range(3) for j in range(i, 3)]
    xx, xy, xz, yy, yz, zz = upper
    return np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), 2, 0)


def assert_axes(ellipsoid, covariance):
    """Semi-axes are 3 sqrt(eigenvalue) along numpy's eigenvectors, whatever their signs."""
    variance, directions = np.linalg.eigh(covariance)
    for axis, length, direction in zip(ellipsoid["axes"], 3.0 * np.sqrt(variance), directions.T, strict=True):
        np.testing.assert_allclose(abs(np.dot(axis, direction)), length, rtol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(axis), length, rtol=1e-6)


def test_ellipsoids_are_those_of_the_covariance_in_the_track(tmp_path):
    """Made so that none lies along an axis, in lvlh_ccsds or in docking axes."""
    path = made_track(tmp_path / "track.csv")
    page, drawn = report(path)
    rows = rows_of(path)
    assert "along the eigenvectors of its covariance" in page
    assert 12 <= len(drawn["ellipsoids"]) <= 24
    for ellipsoid in drawn["ellipsoids"]:
        k = int(np.argmin(abs(rows["t_s"] - ellipsoid["t"])))
        turn = RBAR.as_matrix()
        assert_axes(ellipsoid, turn @ covariances(rows)[k] @ turn.T)
        longest = np.array(ellipsoid["axes"][2])
        expected = RBAR.apply(TURNED.apply([0.0, 0.0, 1.0])) * 3.0 * SIGMAS[2] * rows["range_m"][k] / 8.0
        np.testing.assert_allclose(longest * np.sign(longest @ expected), expected, rtol=1e-6)
        assert abs(longest).max() < 0.85 * np.linalg.norm(longest)
        np.testing.assert_allclose(ellipsoid["at"], [rows["range_m"][k], 0.0, 0.0], atol=1e-8)
    assert drawn["ellipsoids"][-1]["t"] == rows["t_s"][-1]


def test_without_the_docking_frame_sigmas_alone(tmp_path):
    """Of range, azimuth and elevation, by the derivatives of the place; the page says so."""
    path = made_track(tmp_path / "track.csv", model="nobody's")
    page, drawn = report(path)
    assert "as if they were not correlated" in page
    end = drawn["ellipsoids"][-1]
    angles = np.radians([0.2, 0.3]) * end["at"][0]
    lengths = sorted(np.linalg.norm(axis) for axis in end["axes"])
    np.testing.assert_allclose(lengths, 3.0 * np.sort([0.02, *angles]), rtol=1e-6)
    page, _ = report(path, "--model", "three_beacon_psd_rbar")
    assert "along the eigenvectors" in page


@pytest.fixture(scope="module")
def markers(tmp_path_factory):
    """Log and solution of a short marker flight."""
    log = tmp_path_factory.mktemp("markers") / "log.csv"
    command = ["simulate", "three_marker_vision", "--out", str(log), "--duration", "20", "--rate", "2", "--seed", "5"]
    assert relnav.cli.run([*command, "--quiet"]) == 0
    return log, relnav.filter_log(log, "three_marker_vision")


def test_markers_from_the_log_and_from_the_track(markers, tmp_path):
    """The covariance of port from port, which the track carries, with its correlations."""
    log, solution = markers
    track = tmp_path / "track.csv"
    relnav.write(solution, track)
    rows = rows_of(track)
    known = np.isfinite(solution.port_m[:, 0])
    exact = solution.docking_covariance[:, :3, :3]
    np.testing.assert_allclose(covariances(rows, "cov_port_")[known], exact[known], rtol=1e-12, atol=1e-20)
    _, of_track = report(track)
    _, of_log = report(log, "--model", "three_marker_vision")
    assert of_track["ellipsoids"] == of_log["ellipsoids"]
    for ellipsoid in of_track["ellipsoids"]:
        k = int(np.flatnonzero(solution.t_s == ellipsoid["t"])[0])
        assert_axes(ellipsoid, exact[k])
    off = exact[known][-1] - np.diag(np.diag(exact[known][-1]))
    assert abs(off).max() > 0.01 * exact[known][-1].max()


def test_places_do_not_depend_on_how_a_run_is_cut():
    t = np.arange(1000.0)
    columns = {"t_s": t, "range_m": 10.0 - 0.005 * t, "azimuth_deg": 0.0 * t, "elevation_deg": 0.0 * t}
    columns |= {f"sigma_{name}": 0.01 + 0.0 * t for name in ("range_m", "azimuth_deg", "elevation_deg")}
    columns["range_m"][:7] = math.nan
    found = []
    for step in (1000, 333, 1):
        places = Places(12)
        for begin in range(0, 1000, step):
            places.take({name: column[begin : begin + step] for name, column in columns.items()})
        found.append([place.t_s for place in places.places()])
    assert found[0] == found[1] == found[2]
    assert 12 <= len(found[0]) <= 25
    assert (found[0][0], found[0][-1]) == (7.0, 999.0)
    assert Places(12).places() == []


def test_an_angle_from_the_docked_attitude():
    mission = relnav.load_model("three_marker_vision")
    docked = mission.target.dcm_target_from_lvlh @ mission.dcm_chaser_from_lvlh.T
    off = [Rotation.from_rotvec(np.radians(angle) * np.array([0.6, 0.0, -0.8])) for angle in (0.0, 1e-4, 7.0, 179.0)]
    q = np.array([(turn * Rotation.from_matrix(docked)).as_quat() for turn in off])
    columns = {f"q_target_from_chaser_{axis}": q[:, k] for k, axis in enumerate("xyzw")}
    columns |= {f"sigma_port_turn_{axis}_deg": np.full(4, value) for axis, value in zip("xyz", (2, 3, 6), strict=True)}
    angles = misalignments(columns, mission)
    np.testing.assert_allclose(angles["misalignment_deg"], [0.0, 1e-4, 7.0, 179.0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(angles["misalignment_3_sigma_deg"], [21.0, 21.0001, 28.0, 180.0], rtol=1e-9)
    assert misalignments(columns, None) == {}


@pytest.mark.parametrize(
    ("lateral", "sigmas", "largest"),
    [
        ((0.03, 0.04), (0.01, 0.01), 0.08),  # a circle about a point: outward
        ((0.0, 0.04), (0.01, 0.0), 0.05),  # a stroke across: Pythagoras
        ((0.0, 0.0), (0.01, 0.02), 0.06),  # about the axis: the longer one
    ],
)
def test_what_lies_within_the_limits(lateral, sigmas, largest):
    place = Place(1.0, np.array([0.5, *lateral]), np.diag([0.1**2, sigmas[0] ** 2, sigmas[1] ** 2]), True, 2.0, 5.0)
    found = verdicts(place, CaptureLimits(0.07, 0.75, 1.0))
    assert [row.unit for row in found] == ["m", "m", "deg"]
    assert found[0].estimate == pytest.approx(math.hypot(*lateral))
    assert found[0].largest == pytest.approx(largest, rel=1e-6)
    assert found[0].inside == (largest <= 0.07)
    assert (found[1].estimate, found[1].largest) == (0.5, pytest.approx(0.8))
    assert [row.words for row in found[1:]] == ["inside, but its 3 sigma reach beyond", "outside"]
    assert verdicts(place, CaptureLimits()) == []


def test_the_page_says_where_the_run_ends(tmp_path, markers):
    path = made_track(tmp_path / "track.csv")
    end = 8.0 - 0.05 * 89
    said = "At the end of the run, 8.9 s, the camera lies {} the port&#x27;s capture limits"
    page, drawn = report(path, "--capture-m", 0.2, "--capture-distance-m", end + 0.5)
    assert said.format("inside") + ", and so do its 3 sigma." in page
    assert (drawn["capture"], drawn["distance"]) == (0.2, end + 0.5)
    page, _ = report(path, "--capture-m", 0.2, "--capture-distance-m", end + 0.001)
    assert said.format("inside") + ", but its 3 sigma reach beyond." in page
    page, _ = report(path, "--capture-distance-m", end - 0.5, "--capture-deg", 4)
    assert said.format("outside") + "." in page
    assert "Nothing to hold against --capture-deg" in page
    page, _ = report(markers[0], "--model", "three_marker_vision", "--capture-deg", 4)
    assert "<td>angular misalignment</td>" in page
    assert '"label":"capture limit"' in page
