"""The track: columns of the log contract in their order, numbers exact, metadata that says what they are."""

import csv
import json
import math

import numpy as np
import pytest

import relnav
from relnav.files.filter_log import filter_log
from relnav.files.tables import write_json

STATE = ["x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"]
VIEW = ["range_m", "azimuth_deg", "elevation_deg"]
NAMES = ["x", "y", "z", "vx", "vy", "vz"]
CONTRACT = [
    "t_s",
    *STATE,
    *VIEW,
    *(f"sigma_{name}" for name in [*STATE, *VIEW]),
    "nis",
    "dof",
    "accepted",
    "alarm",
    *(f"cov_{NAMES[i]}_{NAMES[j]}" for i in range(6) for j in range(i, 6)),
]


@pytest.fixture
def solution(write_log, vbar_log):
    """Two hundred rows of the example with a bad start, a rejected, a partial and an empty row."""
    lines = vbar_log.read_text().splitlines()[:201]
    lines[1] = lines[1].split(",")[0] + ",,,,,,," + ",".join(lines[1].split(",")[7:])
    cells = lines[100].split(",")
    lines[100] = ",".join([cells[0], "1000", "1000", *cells[3:]])
    cells = lines[110].split(",")
    lines[110] = ",".join([cells[0], "3000", "3000", "-3000", "3000", "1000", "1000", *cells[7:]])
    cells = lines[120].split(",")
    lines[120] = ",".join([cells[0], "", "", "", "", "", "", *cells[7:]])
    solution = filter_log(write_log("# pass = 7\n" + "\n".join(lines)), "three_beacon_psd", method="spots")
    assert {0, 1, 2, 3, 4, 5} <= set(solution.status.tolist())
    return solution


def read(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    head = [line for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(lines[len(head) :]))
    return head, rows


def column(rows, name):
    return np.array([float(row[name]) if row[name] else math.nan for row in rows])


def test_columns_stand_in_the_order_of_the_contract(solution, tmp_path):
    relnav.write(solution, tmp_path / "track.csv")
    _, rows = read(tmp_path / "track.csv")
    assert list(rows[0]) == CONTRACT
    assert len(CONTRACT) == 44


def test_one_row_an_epoch_and_every_number_exact(solution, tmp_path):
    relnav.write(solution, tmp_path / "track.csv")
    _, rows = read(tmp_path / "track.csv")
    assert len(rows) == len(solution) == 200
    np.testing.assert_array_equal(column(rows, "t_s"), solution.t_s)
    for j, name in enumerate(STATE):
        np.testing.assert_array_equal(column(rows, name), solution.state[:, j])
        np.testing.assert_array_equal(column(rows, f"sigma_{name}"), solution.sigma[:, j])
    np.testing.assert_array_equal(column(rows, "range_m"), solution.range_m)
    for j in (1, 2):
        np.testing.assert_allclose(column(rows, VIEW[j]), np.degrees(solution.docking[:, j]), rtol=4e-16)
        sigma = np.degrees(solution.docking_sigma[:, j])
        np.testing.assert_allclose(column(rows, f"sigma_{VIEW[j]}"), sigma, rtol=4e-16)
    np.testing.assert_array_equal(column(rows, "nis"), solution.nis)
    np.testing.assert_array_equal(column(rows, "dof"), solution.dof)
    np.testing.assert_array_equal(column(rows, "accepted"), solution.accepted)
    for i in range(6):
        for j in range(i, 6):
            name = f"cov_{NAMES[i]}_{NAMES[j]}"
            np.testing.assert_array_equal(column(rows, name), solution.covariance[:, i, j])


def test_rows_without_a_state_are_empty_and_not_nan(solution, tmp_path):
    relnav.write(solution, tmp_path / "track.csv")
    _, rows = read(tmp_path / "track.csv")
    assert rows[0]["x_m"] == rows[0]["nis"] == rows[0]["cov_x_x"] == ""
    assert (rows[0]["dof"], rows[0]["accepted"]) == ("0", "0")
    assert "nan" not in (tmp_path / "track.csv").read_text()


def test_flags_are_those_of_the_epochs(solution, tmp_path):
    relnav.write(solution, tmp_path / "track.csv")
    _, rows = read(tmp_path / "track.csv")
    partial, rejected, empty = rows[99], rows[109], rows[119]
    assert (partial["accepted"], rejected["accepted"], empty["accepted"]) == ("0", "0", "0")
    assert float(partial["nis"]) > 100.0
    assert float(rejected["nis"]) > 100.0
    assert empty["nis"] == ""
    assert empty["x_m"] != ""


def test_metadata_says_frame_units_model_and_version(solution, tmp_path):
    relnav.write(solution, tmp_path / "track.csv")
    head, _ = read(tmp_path / "track.csv")
    entries = dict(line.removeprefix("# ").split(" = ", 1) for line in head)
    assert entries["frame"].startswith("lvlh_ccsds")
    assert entries["units"].startswith("SI; angles in degrees")
    assert entries["model"] == "three_beacon_psd"
    assert entries["method"] == "spots"
    assert entries["relnav"].count(".") == 2
    assert entries["log"] == "log.csv"
    assert entries["log.pass"] == "7"


def test_a_solution_longer_than_what_is_written_at_once(solution, tmp_path, monkeypatch):
    relnav.write(solution, tmp_path / "whole.csv")
    monkeypatch.setattr("relnav.files.tracks.ROWS_AT_ONCE", 7)
    relnav.write(solution, tmp_path / "pieces.csv")
    assert (tmp_path / "whole.csv").read_bytes() == (tmp_path / "pieces.csv").read_bytes()


@pytest.mark.parametrize("name", ["track.xyz", "track", "track.csv.gz"])
def test_another_ending_is_refused(solution, tmp_path, name):
    with pytest.raises(relnav.UsageError, match=r"a table ends in \.csv"):
        relnav.write(solution, tmp_path / name)
    assert list(tmp_path.glob("track*")) == []


def test_json_has_null_for_what_is_no_number(tmp_path):
    value = {"a": math.nan, "b": [1.5, math.inf, {"c": -math.inf}], "d": (1, "x", None, True)}
    write_json(value, tmp_path / "out.json")
    read_back = json.loads((tmp_path / "out.json").read_text(), parse_constant=pytest.fail)
    assert read_back == {"a": None, "b": [1.5, None, {"c": None}], "d": [1, "x", None, True]}
