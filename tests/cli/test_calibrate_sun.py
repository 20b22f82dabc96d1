"""`relnav calibrate sun`: file, report, maps and exit codes, on the example that ships."""

import json
from pathlib import Path

import pytest

from relnav.cli import run

EXAMPLE = Path(__file__).parents[2] / "examples" / "aps_sun_turntable" / "turntable.csv"


def test_all_outputs(tmp_path, capsys):
    files = {name: tmp_path / name for name in ("sun.json", "maps.png", "report.json")}
    arguments = ["--plot", str(files["maps.png"]), "--json", str(files["report.json"])]
    assert run(["calibrate", "sun", str(EXAMPLE), "--out", str(files["sun.json"]), *arguments]) == 0
    out = capsys.readouterr().out
    assert "49 points, model aps_sun, method: rays, field +-60 deg" in out
    assert "residual map, rms in 0.001 deg" in out
    assert "deg, each point predicted by the others; its spot's noise included" in out
    assert "hole_height_m" in out
    assert files["maps.png"].read_bytes().startswith(b"\x89PNG")
    report = json.loads(files["report.json"].read_text())
    assert report["error_before_max_deg"] > 5.0
    assert report["error_after_3rms_deg"] < 0.03
    assert json.loads(files["sun.json"].read_text())["format"] == "relnav sun calibration 1"


def test_quiet(tmp_path, capsys):
    assert run(["calibrate", "sun", str(EXAMPLE), "--out", str(tmp_path / "sun.json"), "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def with_bad_spot(path, lines_of_file, shift_px):
    """The example with the spots of some lines moved; where it was written."""
    rows = EXAMPLE.read_text().splitlines()
    for number in lines_of_file:
        *angles, x, y = rows[number - 1].split(",")
        rows[number - 1] = ",".join([*angles, f"{float(x) + shift_px:.4f}", y])
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("shift_px", [1.0, 200.0])
def test_a_bad_spot_is_left_out_and_named(tmp_path, capsys, shift_px):
    """One spot of 49, a pixel off or two hundred: the calibration is as without it."""
    bad, report = with_bad_spot(tmp_path / "t.csv", [20], shift_px), tmp_path / "report.json"
    command = ["calibrate", "sun", str(bad), "--out", str(tmp_path / "sun.json"), "--json", str(report)]
    assert run(command) == 0
    assert "left out: line 20: its spot is " in capsys.readouterr().out
    figures = json.loads(report.read_text())
    assert figures["left_out_lines"] == [20]
    assert figures["points_in_field"] == 48
    assert figures["error_after_3rms_deg"] < 0.03


def test_more_than_a_few_bad_spots_all_stay(tmp_path):
    """A tenth of the points is not left out: the fit says by its chi^2 that it is none."""
    bad, report = with_bad_spot(tmp_path / "t.csv", range(15, 25), 3.0), tmp_path / "report.json"
    assert run(["calibrate", "sun", str(bad), "--out", str(tmp_path / "sun.json"), "--json", str(report)]) == 0
    figures = json.loads(report.read_text())
    assert figures["left_out_lines"] == []
    assert figures["chi2_per_dof"] > 100.0


def test_scattered_points_give_true_figures(tmp_path, capsys):
    """Points beyond the square field that others span have no direction in the table: they are counted, not NaN."""
    rows = EXAMPLE.read_text().splitlines()
    header = next(k for k, line in enumerate(rows) if not line.startswith("#"))
    some = [row for row in rows[header + 1 :] if float(row.split(",")[0]) < 30.0]
    (tmp_path / "t.csv").write_text("\n".join([*rows[: header + 1], *some]) + "\n")
    command = ["calibrate", "sun", str(tmp_path / "t.csv"), "--incomplete", "--out", str(tmp_path / "sun.json")]
    assert run(command) == 0
    out = capsys.readouterr().out
    assert "field +-20 deg" in out
    assert "points lie beyond the field" in out
    assert "nan" not in out


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["--out", "{tmp}/none/sun.json"], 2, "the folder"),
        (["--out", "{tmp}/sun.toml"], 2, "a sun calibration is written as .json; got '.toml'"),
        (["--out", "{tmp}/sun.json", "--plot", "{tmp}/maps.gif"], 2, "a picture ends in .png, .pdf or .svg"),
        (["--out", "{tmp}/sun.json", "--json", "{tmp}/sun.json"], 2, "is named twice"),
        (["--out", "{tmp}/sun.json", "--model", "three_beacon_psd"], 3, "a sun sensor is expected"),
        (["--out", "{tmp}/sun.json", "--method", "patent"], 3, "lacks 14592 of 14641"),
        (["--out", "{tmp}/sun.json", "--method", "best"], 2, "'best' is not one of"),
    ],
)
def test_wrong_use(tmp_path, capsys, arguments, code, text):
    assert run(["calibrate", "sun", str(EXAMPLE), *(a.format(tmp=tmp_path) for a in arguments)]) == code
    assert text in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_help_lists_the_sensor(capsys):
    assert run(["calibrate", "--help"]) == 0
    assert "sun" in capsys.readouterr().out
    assert run(["calibrate", "sun", "--help"]) == 0
    assert "alpha_deg, beta_deg (projection angles) or outer_deg, inner_deg" in " ".join(
        capsys.readouterr().out.split()
    )
