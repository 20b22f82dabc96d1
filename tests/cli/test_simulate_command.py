"""`relnav simulate`: a log that `relnav filter` reads, its truth, and the same seed the same files."""

from pathlib import Path

import numpy as np
import pytest

import relnav
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


def test_a_sensor_as_built_and_a_filter_that_considers_it(tmp_path):
    """Twelve sensors: range errors fit the sigma that a model with `considered = true` reports, not the other."""
    text = Path(relnav.load_model("three_beacon_psd").path).read_text()
    spots = text.replace("distortion_limit_um = { value = 250.0", "distortion_limit_um = { value = 0.0")
    (tmp_path / "told.toml").write_text(spots.replace("considered = { value = false", "considered = { value = true"))
    errors, sigmas = [], []
    for seed in range(12):
        log, truth = str(tmp_path / f"{seed}.csv"), str(tmp_path / f"truth-{seed}.csv")
        made = ["simulate", "three_beacon_psd", "--as-built", "--seed", str(seed), "--out", log, "--truth", truth]
        assert run([*made, "--start-range", "8", *SHORT]) == 0
        rows = [line for line in Path(truth).read_text().splitlines() if line[0] != "#"]
        x = np.genfromtxt(rows, delimiter=",", names=True)["x_m"][-1]
        tracks = [
            relnav.filter_log(log, model, method="spots") for model in ("three_beacon_psd", str(tmp_path / "told.toml"))
        ]
        errors.append(tracks[0].state[-1, 0] - x)
        sigmas.append([track.sigma[-1, 0] for track in tracks])
    ratio = np.sqrt(np.mean((np.array(errors)[:, None] / sigmas) ** 2, axis=0))
    assert ratio[0] > 2.0
    assert 0.5 < ratio[1] < 1.6  # 1 +- 3 sigma of 12 draws


def test_as_built_needs_tolerances(tmp_path, capsys):
    for name in ("three_beacon_psd", "three_marker_vision"):
        lines = Path(relnav.load_model(name).path).read_text().split("\n[")
        bare = tmp_path / f"{name}.toml"
        bare.write_text("\n[".join(section for section in lines if not section.startswith("tolerances")))
        assert run(["simulate", str(bare), "--as-built", "--out", str(tmp_path / "no.csv"), *SHORT]) == 2
        assert "has no [tolerances]" in capsys.readouterr().err
        assert not (tmp_path / "no.csv").exists()


def test_markers_as_built(tmp_path):
    """Other spots than of the model as drawn; the camera looks where it should, so the chaser stands 0.05 deg askew."""
    logs = []
    for name, more in (("drawn.csv", []), ("built.csv", ["--as-built"])):
        assert run(["simulate", "three_marker_vision", *more, "--out", str(tmp_path / name), *SHORT]) == 0
        rows = [line for line in (tmp_path / name).read_text().splitlines() if line[0] != "#"]
        logs.append(np.genfromtxt(rows, delimiter=",", names=True))
    assert 1e-3 < np.abs(logs[1]["spot_a_x_px"] - logs[0]["spot_a_x_px"]).max() < 1.0
    turn = [
        2.0 * np.abs(logs[1][f"q_chaser_from_lvlh_{axis}"] - logs[0][f"q_chaser_from_lvlh_{axis}"]) for axis in "xyzw"
    ]
    assert 0.01 < np.degrees(np.linalg.norm(turn, axis=0)).max() < 0.3
