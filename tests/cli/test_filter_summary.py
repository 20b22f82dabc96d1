"""What `relnav filter` says: the figures of the run beside the published ones, in the terminal and as JSON."""

import json
import re

import numpy as np
import pytest

import relnav
from relnav.accuracy.run_summary import METHOD_WORDS
from relnav.files.filter_log import filter_log

MODEL = ("--model", "three_beacon_psd")


@pytest.fixture(scope="module")
def solutions(vbar_log):
    return {method: filter_log(vbar_log, "three_beacon_psd", method=method) for method in ("spots", "fix")}


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_the_figures_in_the_terminal(run, vbar_log, solutions, method):
    code, out, err = run("filter", vbar_log, *MODEL, "--method", method)
    solution = solutions[method]
    assert code == 0
    assert err == ""
    assert f"vbar_log.csv: 3000 epochs, 0 s to 299.9 s; model three_beacon_psd, method {method}" in out
    assert METHOD_WORDS[method] in out.splitlines()
    assert "not in the covariance: focal length, mountings, beacons" in out
    assert f"restarts 0; epochs used whole {solution.accepted.sum()}," in out
    assert f"NIS per degree of freedom {solution.nis_consistency().ratio:.3f}" in out
    lines = {line.split()[0]: line for line in out.splitlines() if line.startswith("  ")}
    sigma = solution.docking_sigma[-1]
    assert f"{sigma[0]:.5f} m" in lines["range"]
    assert "0.02 m" in lines["range"]
    assert f"{np.degrees(sigma[1]):.5f} deg" in lines["azimuth"]
    assert "0.176 deg" in lines["azimuth"]
    assert f"{np.degrees(sigma[2]):.5f} deg" in lines["elevation"]
    assert "0.182 deg" in lines["elevation"]
    assert f"{sigma[0] / 0.02:.3f}" in lines["range"]


def test_how_soon_it_was_met_is_a_duration(run, vbar_log, tmp_path):
    """A log in Unix time says the same as one from zero; it said when, 1796040002.1 s."""
    head, *rows = [line for line in vbar_log.read_text().splitlines()[:400] if not line.startswith("#")]
    table = {}
    for name, first in (("zero", 0.0), ("unix", 1796040000.0)):
        path = tmp_path / f"{name}.csv"
        cells = [row.split(",", 1) for row in rows]
        path.write_text("\n".join([head, *(f"{first + float(t):.3f},{rest}" for t, rest in cells)]) + "\n")
        code, out, _ = run("filter", path, *MODEL, "--method", "spots")
        assert code == 0
        table[name] = [line for line in out.splitlines() if line.startswith("  ") and " s" in line]
        assert "within it after" in out
    assert table["unix"] == table["zero"] != []


def test_the_same_as_json(run, vbar_log, solutions, tmp_path):
    path = tmp_path / "summary.json"
    code, _, _ = run("filter", vbar_log, *MODEL, "--method", "spots", "--json", path)
    figures, solution = json.loads(path.read_text()), solutions["spots"]
    assert code == 0
    assert figures["model"] == "three_beacon_psd"
    assert figures["method"] == "spots"
    assert figures["epochs"] == 3000
    assert (figures["t_first_s"], figures["t_last_s"]) == (0.0, 299.9)
    assert figures["accepted"] == int(solution.accepted.sum())
    assert sum(figures["epochs_by_status"].values()) == 3000
    assert figures["epochs_by_status"]["partial"] == int((solution.status == 2).sum())
    assert figures["nis_per_dof"] == pytest.approx(solution.nis_consistency().ratio, rel=1e-14)  # summed in parts
    assert figures["nis_interval"] == [None, None], "the attitude error is the same in every epoch"
    assert (figures["nis_consistent"], figures["nis_overconfident"]) == (None, None)
    rows = {row["quantity"]: row for row in figures["rows"]}
    assert rows["range"]["published"] == 0.02
    assert rows["range"]["sigma_at_end"] == solution.docking_sigma[-1, 0]
    assert rows["elevation"]["unit"] == "deg"
    assert rows["azimuth"]["ratio"] == pytest.approx(np.degrees(solution.docking_sigma[-1, 1]) / 0.176, rel=1e-12)


def test_quiet_prints_nothing_and_still_writes(run, short_log, tmp_path):
    out, figures = tmp_path / "track.csv", tmp_path / "summary.json"
    assert run("filter", short_log, *MODEL, "--quiet", "--out", out, "--json", figures) == (0, "", "")
    assert out.exists()
    assert figures.exists()


def test_the_track_is_the_solution(run, short_log, tmp_path):
    run("filter", short_log, *MODEL, "--out", tmp_path / "by_command.csv")
    relnav.write(filter_log(short_log, "three_beacon_psd"), tmp_path / "by_call.csv")
    assert (tmp_path / "by_command.csv").read_bytes() == (tmp_path / "by_call.csv").read_bytes()


def test_projection_reaches_the_filter(run, short_log, tmp_path):
    for projection in ("perspective", "parallel"):
        run(
            "filter",
            short_log,
            *MODEL,
            "--method",
            "fix",
            "--projection",
            projection,
            "--out",
            tmp_path / f"{projection}.csv",
        )
    tracks = [
        np.genfromtxt(tmp_path / f"{name}.csv", delimiter=",", skip_header=12) for name in ("perspective", "parallel")
    ]
    assert np.nanmax(np.abs(tracks[0][:, 9] - tracks[1][:, 9])) > 0.02, "elevation: the parallel form's bias, b/r of it"


def test_swapped_beacons_are_told(run, short_log):
    text = short_log.read_text().replace("spot_a", "spot_z").replace("spot_b", "spot_a").replace("spot_z", "spot_b")
    short_log.write_text(text)
    code, out, _ = run("filter", short_log, *MODEL)
    assert code == 5
    assert "NOT STARTED: no epoch was confirmed by the next" in out
    assert "SWAPPED" in out
    assert "A and B exchanged?" in out


def test_a_log_of_one_row(run, short_log, tmp_path):
    short_log.write_text("".join(short_log.read_text().splitlines(keepends=True)[:2]))
    code, out, _ = run("filter", short_log, *MODEL, "--out", tmp_path / "track.csv", "--json", tmp_path / "a.json")
    assert code == 5
    assert "NOT STARTED" in out
    figures = json.loads((tmp_path / "a.json").read_text())
    assert figures["started_s"] is None
    assert figures["nis_per_dof"] is None
    assert figures["rows"][0]["sigma_at_end"] is None


def test_ignored_columns_are_told(run, short_log):
    lines = short_log.read_text().splitlines()
    short_log.write_text("\n".join([lines[0] + ",mode", *(line + ",3" for line in lines[1:])]))
    assert "ignored columns: mode" in run("filter", short_log, *MODEL)[1]


def test_restarts_and_rejections_are_counted(run, short_log, tmp_path):
    lines = short_log.read_text().splitlines()
    for k in range(100, 150):
        cells = lines[k].split(",")
        shifted = [repr(float(cell) + 700.0) if cell else "" for cell in cells[1:7]]
        lines[k] = ",".join([cells[0], *shifted, *cells[7:]])
    short_log.write_text("\n".join(lines))
    _, out, _ = run("filter", short_log, *MODEL, "--method", "spots", "--json", tmp_path / "a.json")
    figures = json.loads((tmp_path / "a.json").read_text())
    assert figures["restarts"] == 2
    rejected = figures["epochs_by_status"]["rejected"]
    assert (
        rejected
        == (filter_log(short_log, "three_beacon_psd", method="spots").status == relnav.EpochStatus.REJECTED).sum()
        >= 6
    )
    assert "restarts 2" in out
    assert f"rejected {rejected}" in out


def test_a_model_without_published_figures(run, short_log, tmp_path):
    from relnav.files.model_folders import find_model

    (tmp_path / "model.toml").write_text(find_model("three_beacon_psd").read_text())
    code, out, _ = run("filter", short_log, "--model", tmp_path)
    assert code == 0
    assert "NIS per degree of freedom" in out
    assert "0.02 m" not in out


QUATERNIONS = {"scalar first (w, x, y, z)": "-0.5,0.5,-0.5,-0.5", "the inverse rotation": "-0.5,0.5,0.5,-0.5"}


@pytest.mark.parametrize("name", QUATERNIONS)
def test_quaternions_read_another_way(run, tmp_path, name):
    """The camera looks along -x; written another way it looks elsewhere, and no image fits."""
    log = tmp_path / "log.csv"
    head = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
    head += "".join(f",q_cam_from_lvlh_{axis}" for axis in "xyzw")
    log.write_text("\n".join([head, *(f"{0.1 * k:.1f},-1500,0,1500,0,0,0,{QUATERNIONS[name]}" for k in range(20))]))
    code, out, _ = run("filter", log, *MODEL)
    assert code == 5
    assert f"read as {name}" in out
    assert "q_cam_from_lvlh does start the filter; x, y, z, w of v_cam = R v_lvlh is expected" in out


def test_milliseconds_under_the_name_of_seconds(run, tmp_path):
    log = tmp_path / "log.csv"
    head = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
    log.write_text("\n".join([head, *(f"{100 * k},-1500,0,1500,0,0,0" for k in range(20))]))
    assert "rows are 100 s apart: if the times are milliseconds, name the column t_ms" in run("filter", log, *MODEL)[1]
    log.write_text(log.read_text().replace("t_s", "t_ms"))
    assert "apart" not in run("filter", log, *MODEL)[1]


def test_a_gap_is_not_told_as_rejections(run, tmp_path):
    log = tmp_path / "log.csv"
    head = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
    times = [*(0.1 * k for k in range(10)), *(86_400.0 + 0.1 * k for k in range(10))]
    log.write_text("\n".join([head, *(f"{t!r},-1500,0,1500,0,0,0" for t in times)]))
    out = run("filter", log, *MODEL)[1]
    assert "rejected, more than" not in out
    assert "the track was started anew 1 times; longest gap 86399.1 s" in out


def test_sigmas_of_a_model_of_ones_own(run, short_log, tmp_path):
    """Without published figures there is nothing to set them beside, but they are told."""
    copy = tmp_path / "mine.toml"
    assert run("models", "three_beacon_psd", "--copy", copy)[0] == 0
    code, out, _ = run("filter", short_log, "--model", copy)
    assert code == 0
    assert re.search(r"1-sigma at 19.9 s: range 0\.\d+ m, azimuth 0\.\d+ deg, elevation 0\.\d+ deg", out)


def test_a_gap_without_its_thrust_is_told_as_a_gap(run, tmp_path):
    """The chaser has moved by 2 m meanwhile: three images contradict the prediction, and the track starts anew."""
    log, head = tmp_path / "log.csv", "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
    rows = [f"{0.1 * k!r},-1500,0,1500,0,0,0" for k in range(50)]
    rows += [f"{65.0 + 0.1 * k!r},-1875,0,1875,0,0,0" for k in range(50)]
    log.write_text("\n".join([head, *rows]))
    _, out, _ = run("filter", log, *MODEL, "--json", tmp_path / "a.json")
    figures = json.loads((tmp_path / "a.json").read_text())
    assert "more than the gate alone explains" not in out
    assert "the track was started anew 1 times; longest gap 60.1 s; " in out
    assert (
        f"{figures['epochs_by_status']['rejected']} images after gaps contradict what was predicted across them" in out
    )
    assert not figures["refused_unexplained"]
    assert figures["nis_overconfident"] is False
    assert "errors smaller than stated, no fault" in out, "spots without noise"
