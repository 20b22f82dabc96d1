"""Small models and logs written for one test."""

from pathlib import Path

import pytest

import relnav.cli
from relnav.files.model_folders import models_root

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


SCENARIO = """[approach]
duration_s = 8.0
rate_hz = 2.0
assumed_noise = true
[results]
range_edges_m = [9.0, 9.8, 10.5]
settling_s = 2.0
"""


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
