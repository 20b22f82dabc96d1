"""`relnav simulate`: a log that `relnav filter` reads, its truth, and the same seed the same files."""

from pathlib import Path

import numpy as np
import pytest

from relnav.cli import run

SHORT = ["--duration", "20", "--quiet"]


def test_simulated_log_filters_back_to_its_truth(tmp_path, capsys):
    log, truth, track = (str(tmp_path / name) for name in ("log.csv", "truth.csv", "track.csv"))
    faults = ["--dropout", "0.05", "--outliers", "0.02", "--j2", "--air-density", "4e-12"]
    assert run(["simulate", "three_beacon_psd_rbar", "--out", log, "--truth", truth, *SHORT, *faults]) == 0
    assert run(["filter", log, "--model", "three_beacon_psd_rbar", "--out", track, "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    got, true = (
        np.genfromtxt(
            [line for line in Path(path).read_text().splitlines() if line[0] != "#"], delimiter=",", names=True
        )
        for path in (track, truth)
    )
    late = got["t_s"] > 10.0
    for name in ("x_m", "y_m", "z_m"):
        assert np.max(np.abs(got[name] - true[name])[late]) < 0.03


def test_same_seed_same_file(tmp_path):
    for name, seed in (("a.csv", "3"), ("b.csv", "3"), ("c.csv", "4")):
        assert run(["simulate", "three_beacon_psd", "--out", str(tmp_path / name), "--seed", seed, *SHORT]) == 0
    texts = [(tmp_path / name).read_text() for name in ("a.csv", "b.csv", "c.csv")]
    assert texts[0] == texts[1] != texts[2]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--duration", "-1"], "duration_s must be positive and finite; got -1.0"),
        (["--rate", "0"], "rate_hz must be positive and finite"),
        (["--outliers", "1.5"], "outliers is a probability"),
        (["--duration", "0.1"], "must give two epochs or more; got 1"),
        (["--start-range", "nan"], "start_m must be finite"),
        (["--start-range", "2"], "not inside final_range_m"),
        (["--air-density", "-1"], "air_density_kg_m3 must be >= 0 and finite; got -1.0"),
        (["--air-density", "1e30"], "flew out of all numbers"),
    ],
)
def test_wrong_use(tmp_path, capsys, options, message):
    assert run(["simulate", "three_beacon_psd", "--out", str(tmp_path / "log.csv"), *options]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
