"""`relnav calibrate fold`: a mirror nobody measured, found from frames of the sky; a wrong frame is named."""

import csv
import json
import tomllib

import numpy as np
import pytest

import relnav
from relnav.sensors.dual_field.fold import mirror_fold
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

VELOCITY = (-10.2, 25.3, 11.0)
NORMAL = np.array([1.0, 0.03, -1.1]) / np.linalg.norm([1.0, 0.03, -1.1])
OPTIONS = ("--model", "dual_field_star", "--velocity-km-s", *VELOCITY)


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """Eight frames of one mirror, and a ninth after it was knocked by an arcminute."""
    path = tmp_path_factory.mktemp("fold") / "frames.csv"
    sensor, rng = relnav.load_model("dual_field_star"), np.random.default_rng(1)
    knocked = NORMAL + np.array([0.0, np.radians(1.0 / 60.0), 0.0])
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t_s", "x_px", "y_px", "magnitude"])
        for t in range(9):
            normal = NORMAL if t < 8 else knocked / np.linalg.norm(knocked)
            frame = StarFieldSimulator(sensor, SkyConditions(), mirror_fold(normal)).frame(
                rng, velocity_km_s=np.array(VELOCITY)
            )
            writer.writerows([t, *spot, m] for spot, m in zip(frame.spots_px, frame.magnitude, strict=True))
    return path


def test_the_mirror_is_found(run, frames, tmp_path):
    out, figures = tmp_path / "fold.toml", tmp_path / "fold.json"
    code, text, err = run("calibrate", "fold", frames, *OPTIONS, "--out", out, "--json", figures)
    assert (code, err) == (0, "")
    values = json.loads(figures.read_text())
    assert values["left_out_t_s"] == [8.0]
    assert values["used"] == 8
    assert "left out: the frame at t_s = 8 contradicts the others" in text
    fold = tomllib.loads(out.read_text())["fold"]
    off = np.degrees(np.linalg.norm(np.array(fold["mirror_normal"]) - NORMAL)) * 3600.0
    assert off < 4.0 * fold["error_arcsec"]
    assert 0.5 < fold["error_arcsec"] < 2.5
    assert values["sigma_arcsec"][0] < 0.3


def test_frames_of_one_field_are_refused(run, tmp_path):
    path = tmp_path / "few.csv"
    path.write_text("t_s,x_px,y_px,magnitude\n0,1,2,3\n0,5,6,4\n")
    code, _, err = run("calibrate", "fold", path, *OPTIONS, "--out", tmp_path / "fold.toml")
    assert code == 3
    assert "none of 1 frames shows both fields" in err
    assert not (tmp_path / "fold.toml").exists()


def test_a_camera_without_a_mirror_is_refused(run, frames):
    code, _, err = run("calibrate", "fold", frames, "--model", "ground_camera", "--velocity-km-s", 0, 0, 0)
    assert code == 2
    assert "[fold] kind is 'none'" in err
