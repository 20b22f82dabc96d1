"""Parquet in and out: the same numbers as CSV, units in the columns, one sentence when it cannot be."""

import sys

import numpy as np
import pytest

import relnav
from relnav.files.logs import read_log
from relnav.files.simulated import write_log, write_truth
from relnav.files.tables import COLUMNS
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `parquet` is not installed")


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def simulated(model):
    return simulate(model, Approach(duration_s=20.0), Faults(dropout=0.1), seed=2)


def test_log_is_the_same_as_csv(simulated, tmp_path):
    logs = []
    for name in ("log.csv", "log.parquet"):
        write_log(simulated, tmp_path / name, {"seed": "2"})
        logs.append(read_log(tmp_path / name))
    assert np.array_equal(logs[0].spots_m, logs[1].spots_m, equal_nan=True)
    assert np.array_equal(logs[0].t_s, logs[1].t_s)
    assert np.array_equal(logs[0].acceleration_m_s2, logs[1].acceleration_m_s2)
    assert np.allclose(logs[0].spots_m, simulated.spots_m, rtol=1e-14, atol=1e-17, equal_nan=True)
    assert logs[1].metadata["seed"] == "2"


def test_track_is_the_same_as_csv(model, simulated, tmp_path):
    write_log(simulated, tmp_path / "log.parquet")
    solution = relnav.filter_log(tmp_path / "log.parquet", model, smooth=True, method="spots")
    relnav.write(solution, tmp_path / "track.parquet")
    relnav.write(solution, tmp_path / "track.csv")
    table = parquet.read_table(tmp_path / "track.parquet")
    assert tuple(table.column_names) == COLUMNS
    lines = [line for line in (tmp_path / "track.csv").read_text().splitlines() if not line.startswith("#")]
    text = np.genfromtxt(lines, delimiter=",", names=True)
    for name in COLUMNS:
        column = table.column(name).to_numpy().astype(float)
        assert np.array_equal(column, text[name], equal_nan=True), name
    assert table.schema.field("sigma_range_m").metadata[b"unit"] == b"m"
    assert table.schema.field("azimuth_deg").metadata[b"unit"] == b"deg"
    assert table.schema.metadata[b"frame"].startswith(b"lvlh_ccsds")
    assert table.schema.metadata[b"method"] == b"spots, smoothed"
    assert table.column("x_m").null_count == np.isnan(solution.state[:, 0]).sum() > 0  # while waiting for a start


def test_truth_columns(simulated, tmp_path):
    write_truth(simulated, tmp_path / "truth.parquet")
    table = parquet.read_table(tmp_path / "truth.parquet")
    assert np.array_equal(table.column("vz_m_s").to_numpy(), simulated.truth[:, 5])


def test_not_parquet(tmp_path):
    path = tmp_path / "log.parquet"
    path.write_text("t_s,spot_a_x_um\n")
    with pytest.raises(relnav.LogError, match="not a readable Parquet file"):
        read_log(path)


def test_text_in_a_column(simulated, tmp_path):
    import pyarrow

    write_log(simulated, tmp_path / "log.parquet")
    table = parquet.read_table(tmp_path / "log.parquet")
    text = pyarrow.array(["x"] * len(table))
    parquet.write_table(table.set_column(1, "spot_a_x_um", text), tmp_path / "bad.parquet")
    with pytest.raises(relnav.LogError, match="column 'spot_a_x_um' holds string; numbers are expected"):
        read_log(tmp_path / "bad.parquet")


def test_time_going_back_names_the_row(simulated, tmp_path):
    write_log(simulated, tmp_path / "log.parquet")
    table = parquet.read_table(tmp_path / "log.parquet")
    parquet.write_table(table.take([0, 2, 1, 3]), tmp_path / "bad.parquet")
    with pytest.raises(relnav.LogError, match=r"bad.parquet:3: time .* goes back"):
        read_log(tmp_path / "bad.parquet")


def test_without_pyarrow_it_says_how_to_get_it(simulated, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(relnav.UsageError, match=r"pip install 'relnav\[parquet\]'"):
        write_log(simulated, tmp_path / "log.parquet")
    assert list(tmp_path.iterdir()) == []
