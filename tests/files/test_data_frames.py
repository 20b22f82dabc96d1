"""Solutions as pandas and xarray have them, and logs that are data frames."""

from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.errors import LogError, UsageError
from relnav.files import optional

EXAMPLE = Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    path = tmp_path_factory.mktemp("frames") / "log.csv"
    path.write_text("".join(EXAMPLE.read_text().splitlines(keepends=True)[:101]))
    return path


@pytest.fixture(scope="module")
def solution(short):
    return relnav.filter_log(short, "three_beacon_psd")


def test_a_missing_package_is_named_with_its_line(solution, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(optional, "import_module", missing)
    with pytest.raises(UsageError, match=r"A data frame needs pandas: pip install 'relnav\[pandas\]'"):
        solution.to_dataframe()
    with pytest.raises(UsageError, match=r"A Dataset needs xarray: pip install 'relnav\[xarray\]'"):
        solution.to_xarray()


def test_a_frame_has_the_columns_of_the_track(solution, tmp_path):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = solution.to_dataframe()
    relnav.write(solution, tmp_path / "track.csv")
    track = pandas.read_csv(tmp_path / "track.csv", comment="#")
    pandas.testing.assert_frame_equal(frame[track.columns], track, check_dtype=False, rtol=0, atol=0)
    assert frame.attrs["units"]["vx_m_s"] == "m s-1"
    assert frame.attrs["units"]["azimuth_deg"] == "degree"
    assert frame.attrs["model"] == "three_beacon_psd"


def test_a_frame_of_another_frame(solution):
    """State and covariance are those of `in_frame`, units stand beside them."""
    pytest.importorskip("pandas", reason="pandas is not installed")
    track = solution.in_frame("rsw")
    frame = track.to_dataframe()
    np.testing.assert_array_equal(frame[list(frame.columns[1:7])].to_numpy(), track.state)
    np.testing.assert_array_equal(frame["sigma_vz_m_s"], track.sigma[:, 5])
    np.testing.assert_array_equal(frame["cov_y_vx"], track.covariance[:, 1, 3])
    assert (frame.attrs["units"]["vy_m_s"], frame.attrs["frame"][:4]) == ("m s-1", "rsw:")
    pytest.importorskip("xarray", reason="xarray is not installed")
    data = track.to_xarray()
    np.testing.assert_array_equal(data.covariance, track.covariance)
    assert (data.vx.attrs["units"], data.attrs["frame"]) == ("m s-1", frame.attrs["frame"])


def test_what_is_shown_fits_a_screen(solution):
    for shown in (solution, solution.in_frame("rsw"), solution.in_frame("eci", orientation_deg=(51.6, 130.0, 40.0))):
        assert max(len(line) for line in repr(shown).splitlines()) <= 80


def test_a_log_may_be_a_frame(solution, short):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = pandas.read_csv(short)
    for given in (frame, frame.set_index("t_s")):
        again = relnav.filter_log(given, "three_beacon_psd")
        np.testing.assert_array_equal(again.state, solution.state)
    frame.loc[7, "accel_x_m_s2"] = np.nan
    with pytest.raises(
        LogError, match=r"DataFrame:7: column 'accel_x_m_s2' is empty or NaN; only a spot may be missing"
    ):
        relnav.filter_log(frame, "three_beacon_psd")
    with pytest.raises(LogError, match="unit"):
        relnav.filter_log(frame.rename(columns={"spot_a_x_um": "spot_a_x"}), "three_beacon_psd")


class Table:
    """The least that is a table in memory."""

    def __init__(self, columns):
        self._columns, self.columns = columns, list(columns)

    def __getitem__(self, name):
        return self._columns[name]

    def __len__(self):
        return len(next(iter(self._columns.values())))


def test_any_table_with_columns_is_a_log(solution, short):
    names = short.read_text().split("\n", 1)[0].split(",")
    values = np.genfromtxt(short, delimiter=",", skip_header=1)
    table = Table({name: values[:, k] for k, name in enumerate(names)})
    again = relnav.filter_log(table, "three_beacon_psd")
    np.testing.assert_array_equal(again.state, solution.state)
    table._columns["t_s"] = [f"{t}" for t in values[:, 0]]
    with pytest.raises(LogError, match="column 't_s' holds real numbers; got text"):
        relnav.filter_log(table, "three_beacon_psd")


def test_a_dataset_has_units(solution):
    pytest.importorskip("xarray", reason="xarray is not installed")
    data = solution.to_xarray()
    np.testing.assert_array_equal(data["x"], solution.state[:, 0])
    np.testing.assert_array_equal(data["covariance"], solution.covariance)
    assert data["x"].attrs["units"] == "m"
    assert data["vx"].attrs["units"] == "m s-1"
    assert data["sigma_azimuth"].attrs["units"] == "degree"
    assert data["time"].attrs["units"] == "s"
    assert data["covariance"].sel(component="vx", component_2="z").dims == ("time",)
    assert data.attrs["frame"].startswith("lvlh_ccsds")
