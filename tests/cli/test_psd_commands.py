"""The bench at the command line: a grid to a calibration, a raw log to a track, a design to its budget."""

import json

import numpy as np
import pytest

from relnav.files.model_folders import find_model
from relnav.simulation.distortion import typical_distortion


@pytest.fixture
def grid_of(tmp_path):
    """grid_of(side) -> a simulated grid of side x side points, 10 um of noise, inside 75 % of the area."""

    def write(side, seed=1):
        line = np.linspace(-3.4641e-3, 3.4641e-3, side)
        true = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        measured = typical_distortion(4e-3, 250e-6, seed=seed).apply(true)
        measured += np.random.default_rng(seed).normal(size=true.shape) * 1e-5
        path = tmp_path / "grid.csv"
        rows = np.column_stack([true, measured]) * 1e6
        np.savetxt(path, rows, "%.4f", ",", header="true_x_um,true_y_um,spot_x_um,spot_y_um", comments="")
        return path

    return write


def test_calibrate_psd(run, tmp_path, grid_of):
    folder = tmp_path / "mine"
    folder.mkdir()
    out, figures = folder / "c.toml", tmp_path / "c.json"
    code, text, _ = run("calibrate", "psd", grid_of(15), "--out", out, "--model", "three_beacon_psd", "--json", figures)
    assert code == 0
    got = json.loads(figures.read_text())
    assert got["points"] == 225
    assert got["raw_max_um"] == pytest.approx(250.0, abs=30.0)
    assert got["residual_3_sigma_um"] < 9.0
    assert 0.9 < got["chance_within_target"] < 1.0
    assert got["detector_share"] == pytest.approx(0.79, abs=0.04)
    assert got["noise_um"] == pytest.approx(10.0, abs=1.5)
    assert f"left by the correction, 3-sigma: {got['residual_3_sigma_um']:.1f} um of 10 um wanted" in text
    assert 'name it in a model: [calibration] file = "c.toml"' in text
    assert "beyond, the correction is held and is wrong by" in text
    (folder / "model.toml").write_text(
        find_model("three_beacon_psd").read_text() + '\n[calibration]\nfile = "c.toml"\n'
    )
    code, text, _ = run("budget", folder)
    assert code == 0
    assert "(distortion, not calibrated)" in text
    assert "  distortion left by calibration" in text


def test_too_few_points_are_told_and_a_grid_recommended(run, grid_of):
    code, text, _ = run("calibrate", "psd", grid_of(7))
    assert code == 0
    assert "NOT met" in text
    assert "recommended: a grid of" in text


@pytest.mark.parametrize(("scale", "said"), [(1.0, False), (1.07, False), (1.3, True), (0.7, True)])
def test_a_gain_far_from_one_is_said(run, grid_of, tmp_path, scale, said):
    path, figures = grid_of(9), tmp_path / "figures.json"
    head, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    path.write_text("\n".join([head, *(f"{x},{y},{float(u) * scale},{v}" for x, y, u, v in cells)]))
    code, text, _ = run("calibrate", "psd", path, "--json", figures)
    assert code == 0
    gain = json.loads(figures.read_text())["gain"]
    assert gain == pytest.approx([scale, 1.0], abs=0.03)
    assert (f"GAIN: the spots move {gain[0]:.2f} times the known way in x and {gain[1]:.2f} times in y" in text) == said


def test_no_probability_beside_holes(run, grid_of):
    """Five scan lines of 17 points leave no row of cells empty, three do: only the first are given a probability."""
    path = grid_of(17)
    head, *points = path.read_text().splitlines()
    for scans, holes in ((range(0, 17, 4), False), ((0, 8, 16), True)):
        path.write_text("\n".join([head, *(point for k in scans for point in points[17 * k : 17 * k + 17])]))
        code, text, _ = run("calibrate", "psd", path, "--target", "100")
        assert code == 0
        assert ("HOLES: 10 of 25 cells of that box hold no point; measure there too." in text) == holes
        assert ("an axis is within with" in text) != holes
        assert ("100 um wanted  NOT met\n" in text) == holes
        assert ("\nrecommended: a grid of" in text) == holes
        assert ("\nenough: a grid of" in text) != holes


def test_what_leaves_the_distortion_open_writes_nothing(run, grid_of, tmp_path):
    """Points of one diagonal band: refused with the reason."""
    path, out = grid_of(15), tmp_path / "c.toml"
    rng = np.random.default_rng(3)
    along = rng.uniform(-3600.0, 3600.0, 40)
    true = np.stack([along, along + 20.0 * rng.normal(size=40)], axis=1)
    rows = np.column_stack([true, true + 20.0 * rng.normal(size=true.shape)])
    np.savetxt(path, rows, "%.4f", ",", header="true_x_um,true_y_um,spot_x_um,spot_y_um", comments="")
    code, _, error = run("calibrate", "psd", path, "--out", out)
    assert code == 3
    assert "the points do not tell the distortion there; add points there" in error
    assert not out.exists()


@pytest.mark.parametrize("shift_um", [500.0, 30_000.0])
def test_an_outlier_is_left_out(run, grid_of, tmp_path, shift_um):
    """A bad spot of 81, gross or not so gross: named with its line, and what is left is as without it."""
    path, figures = grid_of(9), tmp_path / "figures.json"
    lines = path.read_text().splitlines()
    x, y, _, spot_y = lines[41].split(",")
    left = {}
    for name, row in (("without", f"{x},{y},,"), ("with", f"{x},{y},{shift_um},{spot_y}")):
        path.write_text("\n".join([*lines[:41], row, *lines[42:]]))
        code, text, _ = run("calibrate", "psd", path, "--json", figures)
        assert code == 0
        left[name] = json.loads(figures.read_text())
    assert "left out: line 42: the other points contradict the spot known to be at (0.000, 0.000) mm" in text
    assert left["with"].pop("left_out_lines") == [42]
    assert left["without"].pop("left_out_lines") == []
    assert left["with"] == left["without"]


def test_calibrate_wrong_use(run, tmp_path, grid_of):
    path = grid_of(7)
    assert run("calibrate", "psd", path, "--target", "0")[0] == 2
    assert run("calibrate", "psd", path, "--out", path)[0] == 2
    assert run("calibrate", "psd", tmp_path / "none.csv")[0] == 2
    path.write_text("true_x_um,true_y_um,spot_x_um,spot_y_um\n0,0,1,1\n1,1,2,2\n")
    code, _, error = run("calibrate", "psd", path)
    assert code == 3
    assert "grid.csv: twelve different points or more are needed for a calibration; got 2" in error
    path.write_text("true_x_um,true_y_um,spot_x_um,spot_y_um\n0,0,1_0,1\n")
    assert "grid.csv:2: column 'spot_x_um': '1_0' is not a number" in run("calibrate", "psd", path)[2]


def test_raw_log_from_simulation_to_track(run, tmp_path):
    raw, track, figures = tmp_path / "raw.csv", tmp_path / "track.csv", tmp_path / "f.json"
    simulated = ("simulate", "three_beacon_psd", "--out", raw, "--raw", "--duration", "20", "--start-range", "7")
    code, text, _ = run(*simulated, "--final-range", "6", "--distortion", "50")
    assert code == 0
    assert "(800 slots, model three_beacon_psd" in text
    code, text, _ = run("filter", raw, "--model", "three_beacon_psd", "--out", track, "--json", figures)
    assert code == 0
    assert json.loads(figures.read_text())["epochs"] == 800
    head = [line for line in track.read_text().splitlines() if line.startswith("#")]
    assert "# slots = ok 800" in head
    assert len(track.read_text().splitlines()) == 801 + len(head)


def test_raw_logs_have_faults_of_their_own(run, tmp_path):
    out = tmp_path / "raw.csv"
    code, _, error = run("simulate", "three_beacon_psd", "--out", out, "--raw", "--dropout", "0.1")
    assert code == 2
    assert "are faults of spots, not of --raw logs" in error
    code, _, error = run("simulate", "three_beacon_psd", "--out", out, "--distortion", "250")
    assert code == 2
    assert "--distortion belongs to --raw" in error
    code, _, error = run("simulate", "three_beacon_psd", "--out", tmp_path / "raw.parquet", "--raw")
    assert code == 2
    assert "a raw log ends in .csv" in error
    assert not out.exists()


def test_budget_with_a_change(run, tmp_path):
    figures, picture = tmp_path / "b.json", tmp_path / "b.png"
    arguments = ("--set", "focal_length_mm=80", "--set", "spot_noise_um=5", "--json", figures, "--plot", picture)
    code, text, _ = run("budget", "three_beacon_psd", *arguments)
    assert code == 0
    assert "what focal_length_mm=80 spot_noise_um=5 buys" in text
    got = json.loads(figures.read_text())
    assert got["field"][0]["triangle_m"] == pytest.approx(6.0, rel=1e-5)
    assert got["before"]["field"][0]["triangle_m"] == pytest.approx(3.75, rel=1e-5)
    assert {line["name"] for line in got["places"][0]["lines"]} >= {"spot noise", "focal length", "beacon placement"}
    names = {line["name"]: line["counts"] for line in got["places"][0]["lines"]}
    assert names["chaser attitude"]
    assert "\n  chaser attitude  " in text
    assert "chaser attitude: settled `spots` take it as given; one fix does not" in text
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_budget_quietly(run):
    assert run("budget", "three_beacon_psd", "--quiet") == (0, "", "")


@pytest.mark.parametrize(
    ("setting", "code", "message"),
    [
        ("focal_length_mm", 2, "--set is written KEY=VALUE, as in focal_length_mm=80; got 'focal_length_mm'"),
        ("focal_lenth_mm=80", 2, "'focal_lenth_mm' cannot be set: no section has it"),
        ("focal_length_mm=1e300", 3, "sensor.focal_length_m: 1e+297 m is 1.25e+299 times the detector's width"),
        ("focal_length_mm=long", 3, "sensor.focal_length_mm: input should be a valid number; got 'long'"),
    ],
)
def test_budget_wrong_use(run, setting, code, message):
    got, _, error = run("budget", "three_beacon_psd", "--set", setting)
    assert got == code
    assert message in error


def test_budget_without_tolerances(run, tmp_path):
    text = find_model("three_beacon_psd").read_text()
    path = tmp_path / "plain.toml"
    path.write_text(text[: text.index("\n[detector]")])
    code, _, error = run("budget", path)
    assert code == 2
    assert "a budget needs the section [tolerances]" in error
    code, _, error = run("budget", path, "--plot", tmp_path / "b.gif")
    assert code == 2
    assert f"{tmp_path / 'b.gif'}: a picture ends in .png, .pdf or .svg; got '.gif'" in error


@pytest.mark.parametrize(("ending", "begins"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_a_budget_is_drawn_in_every_kind(run, tmp_path, ending, begins):
    code, _, _ = run("budget", "three_beacon_psd", "--plot", tmp_path / f"b.{ending}")
    assert code == 0
    assert (tmp_path / f"b.{ending}").read_bytes().startswith(begins)


def test_spot_noise_by_received_power_is_in_the_log(run, tmp_path):
    out = tmp_path / "log.csv"
    code, _, _ = run("simulate", "three_beacon_psd", "--out", out, "--duration", "5", "--received-power")
    assert code == 0
    lines = [line for line in out.read_text().splitlines() if not line.startswith("#")]
    header = lines[0].split(",")
    first = dict(zip(header, map(float, lines[1].split(",")), strict=True))
    assert first["sigma_spot_a_x_um"] == pytest.approx(23.4, abs=1.0)
    assert first["sigma_spot_c_x_um"] < first["sigma_spot_a_x_um"]
    assert run("filter", out, "--model", "three_beacon_psd")[0] == 0
