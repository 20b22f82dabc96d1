"""`relnav stars solve` on the real sky and on what goes wrong."""

import json
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / "data" / "real_sky"
FRAME = FOLDER / "Alt40_Azi135.csv"
REFERENCE = json.loads((FOLDER / "reference.json").read_text())["Alt40_Azi135"]


def solve(run, tmp_path, *arguments):
    code, out, err = run("stars", "solve", *arguments, "--json", tmp_path / "out.json")
    assert (code, err) == (0, "")
    return out, json.loads((tmp_path / "out.json").read_text())


def test_with_the_camera_known(run, tmp_path):
    out, values = solve(run, tmp_path, FRAME, "--model", "ground_camera", "--plot", tmp_path / "field.png")
    assert values["status"] == "ok"
    assert values["matches"] == len(values["stars"]) >= 35
    assert values["ra_deg"] == pytest.approx(296.9158, abs=1e-3)
    assert values["dec_deg"] == pytest.approx(11.2621, abs=1e-3)
    assert values["roll_deg"] == pytest.approx(REFERENCE["roll_deg"], abs=0.05)
    assert len(values["sigma_arcsec"]) == 3
    A = np.array(values["dcm_cam_from_icrs"])
    assert np.degrees(np.arctan2(-A[0, 2], A[1, 2])) == pytest.approx(values["roll_deg"])
    assert np.degrees(np.arctan2(A[2, 1], A[2, 0])) % 360.0 == pytest.approx(values["ra_deg"])
    star = values["stars"][0]
    assert {"spot", "x_px", "y_px", "hip", "field", "residual_arcsec"} == set(star)
    assert (tmp_path / "field.png").read_bytes().startswith(b"\x89PNG")
    assert out.startswith("ok: right ascension 296.9158")


@pytest.mark.parametrize("options", [["--focal-px", "5012"], ["--focal-px", "5216", "--model", "ground_camera"]])
def test_with_the_focal_length_two_percent_wrong(run, tmp_path, options):
    _, values = solve(run, tmp_path, FRAME, *options)
    assert values["status"] == "ok"
    assert values["focal_length_px"] == pytest.approx(5114.4, abs=5.0)
    if "--model" not in options:  # the principal point is then the image's centre, as in the reference
        assert values["ra_deg"] == pytest.approx(REFERENCE["ra_deg"], abs=1e-3)
        assert values["dec_deg"] == pytest.approx(REFERENCE["dec_deg"], abs=1e-3)


def test_a_refused_frame_has_its_reason_and_no_numbers(run, tmp_path):
    lines = FRAME.read_text().splitlines()
    few = tmp_path / "few.csv"
    few.write_text("\n".join(lines[:4]) + "\n")
    out, values = solve(run, tmp_path, few, "--model", "ground_camera")
    assert values["status"] == "too_few"
    assert out == "too_few: 3 spots; 4 or more are needed\n"
    assert values["reason"] == "3 spots; 4 or more are needed"
    assert values["ra_deg"] is values["dec_deg"] is values["roll_deg"] is values["q_cam_from_icrs"] is None
    assert values["sigma_arcsec"] == [None, None, None]
    assert (values["matches"], values["stars"]) == (0, [])


def test_aberration_only_when_asked_for(run, tmp_path):
    _, still = solve(run, tmp_path, FRAME, "--model", "ground_camera", "--epoch", "2019-07-29T20:47")
    _, moving = solve(
        run, tmp_path, FRAME, "--model", "ground_camera", "--epoch", "2019-07-29T20:47", "--velocity-km-s", 25, -15, -6
    )
    shift = np.degrees(np.linalg.norm(np.subtract(still["dcm_cam_from_icrs"], moving["dcm_cam_from_icrs"])[2])) * 3600
    assert 5.0 < shift < 21.0
    assert moving["velocity_km_s"] == [25.0, -15.0, -6.0]


WRONG_USE = {
    "no camera": ([FRAME], "--model or --focal-px is needed"),
    "no frame": (["nowhere.csv", "--focal-px", "5000"], "'nowhere.csv' does not exist"),
    "another model": ([FRAME, "--model", "three_beacon_psd"], "a star sensor is expected"),
    "unknown model": ([FRAME, "--model", "ground_cam"], "did you mean 'ground_camera'?"),
    "two fields at rest": ([FRAME, "--model", "dual_field_star"], "two fields need --epoch and --velocity-km-s"),
    "two fields, no focal length": ([FRAME, "--model", "dual_field_star", "--focal-px", "8000"], "a single field"),
    "velocity alone": ([FRAME, "--model", "ground_camera", "--velocity-km-s", 1, 2, 3], "needs --epoch as well"),
    "epoch": ([FRAME, "--model", "ground_camera", "--epoch", "soon"], "--epoch takes a Julian year or an ISO date"),
    "picture": ([FRAME, "--model", "ground_camera", "--plot", "a.gif"], "a picture ends in .png, .pdf or .svg"),
    "folder": ([FRAME, "--model", "ground_camera", "--json", "none/a.json"], "the folder none does not exist"),
    "negative": ([FRAME, "--focal-px", "-5"], "-5"),
    "no number": ([FRAME, "--focal-px", "nan"], "--focal-px is a focal length in pixels; got nan"),
    "without end": ([FRAME, "--focal-px", "inf"], "--focal-px is a focal length in pixels; got inf"),
    "two centres": (
        [FRAME, "--focal-px", "5000", "--centre-px", "5", "5", "--image-size-px", "10", "10"],
        "--centre-px and --image-size-px say the same",
    ),
    "no centre": ([FRAME, "--focal-px", "5000", "--centre-px", "nan", "0"], "--centre-px is two numbers of pixels"),
    "m/s": (
        [FRAME, "--focal-px", "5000", "--epoch", "2020", "--velocity-km-s", 25e3, -15e3, -6e3],
        "--velocity-km-s: velocity_km_s is in km/s and up to 300 in size",
    ),
    "velocity": (
        [FRAME, "--model", "ground_camera", "--epoch", "2020", "--velocity-km-s", "nan", 0, 0],
        "velocity_km_s is three finite numbers",
    ),
    "noise of no camera": (
        ["noise.csv", "--focal-px", "5000", "--residual-px", "0"],
        "--residual-px needs a camera that is known: --model without --focal-px",
    ),
    "gain of spots": (
        [FRAME, "--model", "ground_camera", "--electrons-per-count", "2"],
        "--electrons-per-count is for a picture",
    ),
    "no such command": ([], "Missing argument 'FRAME'"),
}


@pytest.mark.parametrize("name", WRONG_USE)
def test_wrong_use_is_2(run, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    arguments, text = WRONG_USE[name]
    if "noise.csv" in arguments:
        (tmp_path / "noise.csv").write_text("x_px,y_px,sigma_x_px,sigma_y_px,correlation\n1,2,0.1,0.1,0\n")
    code, out, err = run("stars", "solve", *arguments)
    assert code == 2
    assert text in err
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == [file for file in arguments if file == "noise.csv"]


def lines_of(rows):
    return "x_px,y_px,flux\n" + "".join(f"{x},{y},{flux}\n" for x, y, flux in rows)


@pytest.mark.parametrize("options", [("--focal-px", "5200"), ("--model", "ground_camera")])
@pytest.mark.parametrize("kind", ["random", "mirrored", "one place", "stretched", "few and false"])
def test_frames_of_no_sky_are_refused(run, tmp_path, kind, options):
    """One clear sentence, and no attitude."""
    rows = np.loadtxt(FRAME, delimiter=",", skiprows=1)
    rng = np.random.default_rng(3)
    if kind == "random":
        rows[:, :2] = (rng.random((40, 2)) - 0.5) * (1024.0, 768.0)
    elif kind == "mirrored":
        rows[:, 0] *= -1.0
    elif kind == "one place":
        rows[:, :2] = -100.0, 50.0
    elif kind == "stretched":
        rows[:, 0] *= 1.2
    else:
        rows = np.concatenate([rows[:3], np.column_stack([(rng.random((9, 2)) - 0.5) * 700.0, rows[:9, 2]])])
    (tmp_path / "frame.csv").write_text(lines_of(rows))
    out, values = solve(run, tmp_path, tmp_path / "frame.csv", *options)
    assert values["status"] == "no_match"
    assert values["ra_deg"] is None
    assert out == f"no_match: {values['reason']}\n"


@pytest.mark.parametrize("options", [("--focal-px", "5200"), ("--model", "ground_camera")])
def test_what_is_added_to_a_frame_does_no_harm(run, tmp_path, options):
    """Every spot twice, a spot far off the detector, fluxes below zero, and a byte order mark before the header."""
    rows = np.loadtxt(FRAME, delimiter=",", skiprows=1)
    more = [[1e308, -1e308, 9.0], [1.0, 2.0, -5.0], [3.0, 4.0, 0.0]]
    (tmp_path / "frame.csv").write_text("\ufeff" + lines_of(np.concatenate([rows, rows, more])), encoding="utf-8")
    _, plain = solve(run, tmp_path, FRAME, *options)
    _, values = solve(run, tmp_path, tmp_path / "frame.csv", *options)
    assert values["status"] == "ok"
    for key in ("ra_deg", "dec_deg", "roll_deg"):
        assert values[key] == pytest.approx(plain[key], abs=1e-6)
    assert values["matches"] == plain["matches"]


@pytest.mark.parametrize("focal", ["0.001", "40"])
def test_a_focal_length_of_another_unit_is_refused(run, tmp_path, focal):
    """Millimetres instead of pixels: hardly a spot would be within 60 deg of the axis."""
    out, values = solve(run, tmp_path, FRAME, "--focal-px", focal)
    assert values["status"] == "too_few"
    assert "spots within 60 deg of the axis; with unknown focal length 6 or more are needed" in out


def test_a_bad_frame_is_3(run, tmp_path):
    (tmp_path / "frame.csv").write_text("x_px,y_px\n1,a\n")
    code, _, err = run("stars", "solve", tmp_path / "frame.csv", "--focal-px", "5000")
    assert code == 3
    assert "frame.csv:2: column 'y_px': 'a' is not a number" in err


def test_the_group_lists_its_commands(run):
    code, out, _ = run("stars", "--help")
    assert code == 0
    assert "solve" in out
    assert "Example: relnav stars solve" in out
