"""`relnav sun measure`, a birefringent sensor's self-calibration, and simulated logs and pictures of stars and suns."""

import dataclasses
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import relnav

SENSORS = ("aps_sun", "birefringent_sun")


def table(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    rows = [[float(cell) if cell else np.nan for cell in line.split(",")] for line in lines[1:]]
    return lines[0].split(","), np.array(rows)


def simulate(run, tmp_path, model, name, *options):
    code, _, err = run("simulate", model, "--out", tmp_path / name, "--truth", tmp_path / "truth.csv", *options)
    assert (code, err) == (0, "")
    return tmp_path / name, table(tmp_path / "truth.csv")[1]


@pytest.mark.parametrize("model", SENSORS)
def test_a_log(run, tmp_path, model):
    """Directions of a simulated log: as far from the truth as their covariance says (NEES of rank 2, 200 images)."""
    log, truth = simulate(run, tmp_path, model, "log.csv", "--duration", 40, "--rate", 5, "--dropout", 0.05)
    out, values = tmp_path / "out.csv", tmp_path / "out.json"
    code, said, err = run("sun", "measure", log, "--model", model, "--out", out, "--json", values)
    assert (code, err) == (0, "")
    names, rows = table(out)
    assert names[:7] == ["t_s", "alpha_deg", "beta_deg", "x", "y", "z", "sigma_deg"]
    assert rows.shape == (200, 14)
    seen = rows[:, 13] == 0.0
    assert f"{seen.sum()} of 200 images have a direction" in said
    assert 0.8 < seen.mean() < 1.0
    assert np.isnan(rows[~seen, 1:13]).all()
    covariance = np.zeros((seen.sum(), 3, 3))
    covariance[:, *np.triu_indices(3)] = covariance[:, *np.triu_indices(3)[::-1]] = rows[seen, 7:13]
    error = rows[seen, 3:6] - truth[seen, 3:6]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.pinv(covariance, rcond=1e-6), error)
    assert np.mean(nees) / 2.0 == pytest.approx(1.0, abs=0.25)
    first = json.loads(values.read_text())["measurements"][0]
    assert first["status"] == "OK"
    assert first["direction"] == pytest.approx(rows[0, 3:6])


@pytest.mark.parametrize("ending", [".png", ".tif", ".fits"])
@pytest.mark.parametrize("model", SENSORS)
def test_a_picture(run, tmp_path, model, ending):
    needed = "astropy" if ending == ".fits" else "PIL"
    pytest.importorskip(needed, reason=f"{needed}, of the extra `images`, is not installed")
    picture, truth = simulate(run, tmp_path, model, f"sun{ending}", "--seed", 3)
    code, said, err = run("sun", "measure", picture, "--model", model, "--json", tmp_path / "out.json")
    assert (code, err) == (0, "")
    assert said.startswith("OK: alpha -33.40")
    (found,) = json.loads((tmp_path / "out.json").read_text())["measurements"]
    off = np.degrees(np.linalg.norm(np.array(found["direction"]) - truth[0, 3:6]))
    assert off < 4.0 * found["sigma_deg"]


def test_a_window_has_its_corner(run, tmp_path):
    from PIL import Image

    picture, truth = simulate(run, tmp_path, "aps_sun", "sun.tif")
    counts = np.array(Image.open(picture))
    row, column = np.unravel_index(counts.argmax(), counts.shape)
    x, y = int(column) - 14, int(row) - 15
    Image.fromarray(np.ascontiguousarray(counts[y : y + 30, x : x + 30])).save(tmp_path / "window.tif")
    arguments = ["sun", "measure", tmp_path / "window.tif", "--model", "aps_sun", "--corner-px", x, y]
    assert run(*arguments, "--json", tmp_path / "out.json")[0] == 0
    (found,) = json.loads((tmp_path / "out.json").read_text())["measurements"]
    assert found["direction"] == pytest.approx(truth[0, 3:6], abs=2e-4)


def test_the_calibration_of_a_turntable_is_used(run, tmp_path):
    calibration = tmp_path / "sun.json"
    turntable = Path(__file__).parents[2] / "examples" / "aps_sun_turntable" / "turntable.csv"
    assert run("calibrate", "sun", turntable, "--out", calibration)[0] == 0
    log, truth = simulate(run, tmp_path, "aps_sun", "log.csv", "--duration", 10, "--rate", 5)
    out = tmp_path / "out.csv"
    assert run("sun", "measure", log, "--model", "aps_sun", "--calibration", calibration, "--out", out)[0] == 0
    error = np.degrees(table(out)[1][:, 3:6] - truth[:, 3:6])
    assert 3.0 * np.sqrt(np.mean(np.sum(error**2, axis=1) / 2.0)) < 0.03


def test_first_pixel_and_spots_in_any_order(run, tmp_path):
    log, _ = simulate(run, tmp_path, "birefringent_sun", "log.csv", "--duration", 2, "--rate", 5)
    names, rows = table(log)
    moved = np.column_stack([rows[:, 0], rows[:, [3, 4, 1, 2]] + 0.5])
    np.savetxt(tmp_path / "moved.csv", moved, "%.12g", ",", header=",".join(names), comments="")
    command = ["--model", "birefringent_sun", "--out"]
    assert run("sun", "measure", log, *command, tmp_path / "a.csv")[0] == 0
    assert (
        run("sun", "measure", tmp_path / "moved.csv", *command, tmp_path / "b.csv", "--first-pixel-px", "0.5")[0] == 0
    )
    np.testing.assert_allclose(table(tmp_path / "b.csv")[1][:, :6], table(tmp_path / "a.csv")[1][:, :6], atol=1e-8)


def test_self_calibration(run, tmp_path):
    """The opening is 1.6 px from where the model has it; three pairs are wrong. Found to 4 sigma, and named."""
    log, _ = simulate(run, tmp_path, "birefringent_sun", "log.csv", "--duration", 100, "--rate", 5)
    names, rows = table(log)
    rows[:, 1:] += np.tile([1.3, -0.9], 2)
    rows[[20, 100, 300], 1] += 25.0
    np.savetxt(tmp_path / "moved.csv", rows, "%.12g", ",", header=",".join(names), comments="")
    out, figures = tmp_path / "sensor.toml", tmp_path / "out.json"
    code, said, err = run(
        "calibrate", "sun", tmp_path / "moved.csv", "--model", "birefringent_sun", "--out", out, "--json", figures
    )
    assert (code, err) == (0, "")
    values = json.loads(figures.read_text())
    assert values["left_out_lines"] == [22, 102, 302]
    assert said.count("left out: line") == 3
    assert values["chi2_per_dof"] == pytest.approx(1.0, abs=0.2)
    for name, true in (("zero_spot_x_px", 512.8), ("zero_spot_y_px", 510.6)):
        found = values["parameters"][name]
        assert abs(found["value"] - true) < 4.0 * found["sigma"] < 0.7
    section = tomllib.loads(out.read_text())["sensor"]["zero_spot_px"]
    assert section["value"] == pytest.approx(
        [values["parameters"][f"zero_spot_{axis}_px"]["value"] for axis in "xy"], abs=1e-4
    )
    assert section["source"] == "derived"
    from relnav.files.model_folders import models_root

    text = (models_root() / "birefringent_sun" / "model.toml").read_text().splitlines()
    fitted = out.read_text().splitlines()[1]
    (tmp_path / "model.toml").write_text("\n".join(fitted if x.startswith("zero_spot_px") else x for x in text))
    assert relnav.load_model(tmp_path / "model.toml").sensor.zero_spot_px == pytest.approx(section["value"])


@pytest.mark.parametrize(("more_px", "found_px"), [(0.0, 0.125), (0.3, 0.325)])
def test_the_spot_noise_of_a_self_calibration(run, tmp_path, more_px, found_px):
    """What is found is said beside what the model states, and the sigmas are of it if it is more."""
    log, _ = simulate(run, tmp_path, "birefringent_sun", "log.csv", "--duration", 100, "--rate", 5)
    names, rows = table(log)
    rows[:, 1:] += more_px * np.random.default_rng(6).normal(size=rows[:, 1:].shape)
    np.savetxt(tmp_path / "noisy.csv", rows, "%.12g", ",", header=",".join(names), comments="")
    arguments = ["--model", "birefringent_sun", "--out", tmp_path / "sensor.toml", "--json", tmp_path / "out.json"]
    code, said, _ = run("calibrate", "sun", tmp_path / "noisy.csv", *arguments)
    assert code == 0
    values = json.loads((tmp_path / "out.json").read_text())
    assert values["spot_noise_px"] == 0.125
    assert values["spot_noise_found_px"] == pytest.approx(found_px, rel=0.07)  # three sigma of 1000 residuals
    line = f"spot noise found {values['spot_noise_found_px']:.4g} px, the model states 0.125 px"
    assert (line + "; the sigmas below are of the noise found" in said) == (more_px > 0.0)
    assert line in said


def test_spots_far_beyond_their_noise_are_refused(run, tmp_path):
    """With the model's noise seven times too small: of its own spots, and of a turntable's."""
    log, _ = simulate(run, tmp_path, "birefringent_sun", "log.csv", "--duration", 100, "--rate", 5)
    on_a_turntable(tmp_path / "table.csv")
    from relnav.files.model_folders import models_root

    text = (models_root() / "birefringent_sun" / "model.toml").read_text()
    assert "spot_noise_px = { value = 0.125," in text
    model = tmp_path / "model.toml"
    model.write_text(text.replace("spot_noise_px = { value = 0.125,", "spot_noise_px = { value = 0.018,"))
    for path, said in (
        (log, "the two spots of an image are 7 times as far from those of one direction as the model's spot_noise"),
        (tmp_path / "table.csv", "spots are 7 times as far from where the angles put them as the model's spot_noise"),
    ):
        code, _, err = run("calibrate", "sun", path, "--model", model, "--out", tmp_path / "sensor.toml")
        assert code == 3
        assert said in err
        assert "or is spot_noise too small?" in err
    assert not (tmp_path / "sensor.toml").exists()


TRUE = {
    "zero_spot_px": (513.1, 510.4),
    "crystal_thickness_m": 5.02e-3,
    "axis_polar_rad": np.pi / 4 + 0.004,
    "axis_azimuth_rad": -0.006,
}
TURN_DEG = np.array([0.3, -0.2, 0.5])


def on_a_turntable(path, *, roll=False, wrong=(), names=("outer_deg", "inner_deg")):
    """49 positions of a sensor that is not as its model says, in its mount turned; spots in any order."""
    from relnav.geometry.projection_angles import direction_from_gimbal
    from relnav.geometry.rotation_vector import turned
    from relnav.sensors.birefringent_sun.spots import project

    rng, axis = np.random.default_rng(5), np.linspace(-45.0, 45.0, 7)
    outer, inner = (side.ravel() for side in np.meshgrid(axis, axis))
    s = direction_from_gimbal(np.radians(outer), np.radians(inner))
    rolled = np.tile([0.0, 90.0, 180.0, 270.0], 13)[:49] if roll else np.zeros(49)
    about = np.array(
        [turned(np.eye(3), np.array([0.0, 0.0, np.radians(angle)])).T @ v for angle, v in zip(rolled, s, strict=True)]
    )
    seen = about @ turned(np.eye(3), np.radians(TURN_DEG)).T
    sensor = dataclasses.replace(relnav.load_model("birefringent_sun").sensor, **TRUE)
    spots = project(sensor, seen) + 0.125 * rng.normal(size=(49, 2, 2))
    spots[::2] = spots[::2, ::-1]
    for row in wrong:
        spots[row, 0, 1] += 5.0
    columns = [outer, inner, *([rolled] if roll else []), *spots.reshape(49, 4).T]
    header = [*names, *(["roll_deg"] if roll else []), "spot_a_x_px", "spot_a_y_px", "spot_b_x_px", "spot_b_y_px"]
    np.savetxt(path, np.column_stack(columns), "%.10g", ",", header=",".join(header), comments="")


@pytest.mark.parametrize("roll", [False, True])
def test_a_birefringent_sensor_on_a_turntable(run, tmp_path, roll):
    """Constants and the turn in the mount within 4 sigma, with two or three angles; wrong points named."""
    table_path, out, figures = tmp_path / "table.csv", tmp_path / "sensor.toml", tmp_path / "out.json"
    on_a_turntable(table_path, roll=roll, wrong=(7, 30))
    arguments = ["calibrate", "sun", table_path, "--model", "birefringent_sun", "--out", out, "--json", figures]
    code, said, err = run(*arguments)
    assert (code, err) == (0, "")
    values = json.loads(figures.read_text())
    assert values["left_out_lines"] == [9, 32]
    assert "left out: line 9:" in said
    assert values["frames"] == 47
    assert values["chi2_per_dof"] == pytest.approx(1.0, abs=0.45)  # 4.5 sigma of 180 degrees of freedom
    assert values["error_after_3rms_deg"] == pytest.approx(0.034, rel=0.3)
    expected = dict(zip(("zero_spot_x_px", "zero_spot_y_px"), TRUE["zero_spot_px"], strict=True)) | {
        name: value for name, value in TRUE.items() if name != "zero_spot_px"
    }
    for name, true in expected.items():
        found = values["parameters"][name]
        assert abs(found["value"] - true) < 4.0 * found["sigma"], name
    assert np.all(np.abs(np.array(values["alignment_deg"]) - TURN_DEG) < 4.0 * np.array(values["alignment_sigma_deg"]))
    assert max(values["alignment_sigma_deg"]) < 0.02
    section = tomllib.loads(out.read_text())["sensor"]
    assert section["crystal_thickness_mm"]["value"] == pytest.approx(5.02, abs=2e-3)
    assert section["axis_polar_deg"]["why"] == "calibrated with known directions"


def test_a_birefringent_turntable_that_is_not_one(run, tmp_path):
    path, arguments = tmp_path / "table.csv", ["--model", "birefringent_sun", "--out", tmp_path / "sensor.toml"]
    on_a_turntable(path, names=("beta_deg", "alpha_deg"))  # gimbal angles under other names
    code, _, err = run("calibrate", "sun", path, *arguments)
    assert code == 3
    assert "are these a turntable's gimbal angles" in err or "pairs of spots contradict the others" in err
    on_a_turntable(path, names=("inner_deg", "outer_deg"))
    code, _, err = run("calibrate", "sun", path, *arguments)
    assert code == 3
    assert "the axes are exchanged" in err
    on_a_turntable(path, wrong=range(0, 49, 2))
    code, _, err = run("calibrate", "sun", path, *arguments)
    assert code == 3
    path.write_text("outer_deg,inner_deg,roll_deg,spot_a_x_px,spot_a_y_px,spot_b_x_px,spot_b_y_px\n0,0,,1,2,3,4\n")
    code, _, err = run("calibrate", "sun", path, *arguments)
    assert code == 3
    assert "column 'roll_deg' is empty" in err
    head = "outer_deg,inner_deg,spot_a_x_px,spot_a_y_px,spot_b_x_px,spot_b_y_px\n"
    for rows, text in (("", "no rows after the header"), ("0,0,511,511,580,511\n", "1 points with both spots")):
        path.write_text(head + rows)
        code, _, err = run("calibrate", "sun", path, *arguments)
        assert code == 3
        assert text in err
    assert not (tmp_path / "sensor.toml").exists()


def test_which_pairs_agree_does_not_settle(run, tmp_path, monkeypatch):
    """One pass leaves two points out; that the others then agree is never seen."""
    monkeypatch.setattr("relnav.files.sun_self_calibration.PASSES", 1)
    on_a_turntable(tmp_path / "table.csv", wrong=(7, 30))
    arguments = ["--model", "birefringent_sun", "--out", tmp_path / "sensor.toml"]
    code, _, err = run("calibrate", "sun", tmp_path / "table.csv", *arguments)
    assert code == 3
    assert "agree with the others does not settle" in err


@pytest.mark.parametrize("model", ["dual_field_star", "ground_camera"])
def test_frames_of_stars(run, tmp_path, model):
    """A simulated log of a star sensor holds what `relnav.dual_field.measure` solves, near the truth beside it."""
    log, truth = simulate(run, tmp_path, model, "frames.csv", "--duration", 1.5, "--rate", 2)
    _, rows = table(log)
    (velocity,) = [line for line in log.read_text().splitlines() if line.startswith("# velocity_km_s")]
    velocity = np.array(velocity.partition("=")[2].split(), dtype=float)
    assert np.linalg.norm(velocity) == pytest.approx(30.3, rel=1e-3)
    assert set(rows[:, 0]) == {0.0, 0.5, 1.0}
    frame = rows[rows[:, 0] == 0.5]
    sensor = relnav.load_model(model)
    solution = relnav.dual_field.measure(frame[:, 1:3], sensor, magnitude=frame[:, 3], velocity_km_s=velocity)
    assert solution.ok
    from relnav.geometry.rotation import dcm_from_quaternion

    error = solution.dcm_cam_from_icrs - dcm_from_quaternion(truth[1, 1:])
    assert np.abs(error).max() < 6.0 * solution.sigma_rad.max()


def test_a_picture_of_two_fields_is_solved(run, tmp_path):
    pytest.importorskip("PIL", reason="pillow, of the extra `images`, is not installed")
    from PIL import Image

    picture, _ = simulate(run, tmp_path, "dual_field_star", "sky.png", "--seed", 2)
    velocity = dict(entry.split(" = ") for entry in Image.open(picture).text["Comment"].split("; "))["velocity_km_s"]
    options = ["--model", "dual_field_star", "--epoch", "2026", "--velocity-km-s", *velocity.split()]
    code, said, _ = run("stars", "solve", picture, *options)
    assert code == 0
    assert said.startswith("ok: ")
    assert "in field 1" in said


REFUSED = {
    "another model": (["sun", "measure", "log.csv", "--model", "ground_camera"], 3, "a sun sensor is expected"),
    "spots of the other": (["sun", "measure", "log.csv", "--model", "birefringent_sun"], 3, "column 'spot_a_x_px'"),
    "empty": (["sun", "measure", "head.csv", "--model", "aps_sun"], 3, "no rows after the header"),
    "no time": (["sun", "measure", "nan.csv", "--model", "aps_sun"], 3, "nan.csv:3: column 't_s' is empty or infinite"),
    "calibration": (
        ["sun", "measure", "log.csv", "--model", "birefringent_sun", "--calibration", "head.csv"],
        3,
        "head.csv: not readable as JSON, so not a calibration file",
    ),
    "corner of a log": (["sun", "measure", "log.csv", "--model", "aps_sun", "--corner-px", 1, 1], 2, "for a picture"),
    "pixel of a picture": (
        ["sun", "measure", "bright.png", "--model", "aps_sun", "--first-pixel-px", "0"], 2, "is for a log of spots",
    ),
    "too many counts": (["sun", "measure", "bright.png", "--model", "aps_sun"], 3, "aps_sun reads up to 1023"),
    "no picture": (["sun", "measure", "bad.png", "--model", "aps_sun"], 3, "not a readable picture"),
    "ending": (["calibrate", "sun", "log.csv", "--model", "birefringent_sun", "--out", "a.json"], 2, "as .toml"),
    "method": (
        ["calibrate", "sun", "log.csv", "--model", "birefringent_sun", "--out", "a.toml", "--method", "rays"],
        2,
        "--method is for an APS sensor",
    ),
    "free": (["calibrate", "sun", "log.csv", "--out", "a.json", "--free", "zero_spot_x_px"], 2, "--free is for"),
    "free what": (
        ["calibrate", "sun", "log.csv", "--model", "birefringent_sun", "--out", "a.toml", "--free", "colour"],
        2,
        "constants after commas, each once, of zero_spot_x_px",
    ),
    "one pair": (
        ["calibrate", "sun", "pair.csv", "--model", "birefringent_sun", "--out", "a.toml"], 3, "more than 1 frames",
    ),
    "no pair": (
        ["calibrate", "sun", "none.csv", "--model", "birefringent_sun", "--out", "a.toml"], 3, "no image shows both",
    ),
    "raw stars": (["simulate", "ground_camera", "--out", "a.csv", "--raw"], 2, "are not for ground_camera"),
    "glints of the sun": (["simulate", "aps_sun", "--out", "a.csv", "--outliers", 0.1], 2, "--outliers are not for"),
    "picture of beacons": (["simulate", "three_beacon_psd", "--out", "a.png"], 2, "a table ends in .csv or .parquet"),
    "jpeg": (["simulate", "aps_sun", "--out", "a.jpg"], 2, "a picture is written as .png, .tif"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused(run, tmp_path, monkeypatch, name):
    Image = pytest.importorskip("PIL.Image", reason="pillow, of the extra `images`, is not installed")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text("t_s,spot_x_px,spot_y_px\n0,500,500\n1,501,500\n")
    (tmp_path / "head.csv").write_text("t_s,spot_x_px,spot_y_px\n")
    (tmp_path / "nan.csv").write_text("t_s,spot_x_px,spot_y_px\n0,500,500\n,501,500\n")
    pair = "spot_a_x_px,spot_a_y_px,spot_b_x_px,spot_b_y_px\n"
    (tmp_path / "pair.csv").write_text(pair + "511,511,580.6,511\n")
    (tmp_path / "none.csv").write_text(pair + ",,580.6,511\n")
    (tmp_path / "bad.png").write_text("no picture")
    Image.fromarray(np.full((30, 30), 5000, dtype=np.uint16)).save("bright.png")
    before = sorted(tmp_path.iterdir())
    arguments, expected, text = REFUSED[name]
    code, out, err = run(*arguments)
    assert (code, out) == (expected, "")
    assert text in err
    assert sorted(tmp_path.iterdir()) == before
