"""`relnav simulate` and `relnav filter` for a marker model: the track is right, wrong use and wrong files say so."""

import json
from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.cli import run

FLIGHT = ["--duration", "40", "--rate", "4", "--quiet"]


def table(path):
    lines = [line for line in Path(path).read_text().splitlines() if line[0] != "#"]
    return np.genfromtxt(lines, delimiter=",", names=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log and its truth: drops, and marker c hidden for ten seconds."""
    path = tmp_path_factory.mktemp("markers")
    out = ["--out", str(path / "log.csv"), "--truth", str(path / "truth.csv")]
    faults = ["--dropout", "0.05", "--hide", "c:20:30", "--seed", "3"]
    assert run(["simulate", "three_marker_vision", *out, *FLIGHT, *faults]) == 0
    return path


def test_the_track_is_within_its_sigmas_of_the_truth(folder, tmp_path, capsys):
    track, figures = tmp_path / "track.csv", tmp_path / "summary.json"
    model = ["--model", "three_marker_vision"]
    assert run(["filter", str(folder / "log.csv"), *model, "--out", str(track), "--json", str(figures)]) == 0
    shown = capsys.readouterr().out
    assert "160 epochs, model three_marker_vision, 159 with a state" in shown
    assert "NIS per degree of freedom" in shown
    got, truth = table(track), table(folder / "truth.csv")
    late = got["t_s"] > 15.0
    for name in ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "rate_x_deg_s", "rate_y_deg_s", "rate_z_deg_s"):
        ratio = (got[name] - truth[name])[late] / got["sigma_" + name][late]
        assert np.sqrt(np.mean(ratio**2)) < 2.0, name
    for axis in "xyzw":
        name = f"q_lvlh_from_target_{axis}"
        assert np.abs(got[name] - truth[name])[late].max() < 2e-3
    np.testing.assert_allclose(got["cov_x_x"], got["sigma_x_m"] ** 2, rtol=1e-12)
    assert json.loads(figures.read_text())["epochs_unobservable"] == 0


def test_the_engine_on_filterpy_gives_the_same_track(folder, tmp_path, capsys):
    """Of the first ten seconds, by both; it follows no log that grows."""
    short, tracks = tmp_path / "short.csv", {}
    rows = (folder / "log.csv").read_text().splitlines(keepends=True)
    short.write_text("".join(rows[: 40 + sum(row[0] == "#" for row in rows) + 1]))
    asked = ["filter", str(short), "--model", "three_marker_vision", "--engine"]
    for engine in ("compiled", "filterpy"):
        path = tmp_path / f"{engine}.csv"
        assert run([*asked, engine, "--out", str(path), "--quiet"]) == 0
        assert ("# engine = filterpy" in path.read_text()) == (engine == "filterpy")
        tracks[engine] = table(path)
    ours, theirs = tracks["compiled"][1:], tracks["filterpy"][1:]
    for name in ("x_m", "vz_m_s", "rate_y_deg_s"):
        assert np.max(np.abs(ours[name] - theirs[name]) / ours[f"sigma_{name}"]) < 1e-4
    assert set(theirs["alarm"]) == {64.0}
    assert run([*asked, "filterpy", "--smooth"]) == 2
    assert "forward alone" in capsys.readouterr().err
    assert run([*asked, "filterpy", "--follow"]) == 2
    assert "leave --follow or it out" in capsys.readouterr().err


def test_filter_log_takes_a_marker_model(folder, tmp_path):
    """One public face: the same call and the same `write` as for beacons, the same track as the command's."""
    log, plain, track = folder / "log.csv", tmp_path / "plain.csv", tmp_path / "track.csv"
    assert run(["filter", str(log), "--model", "three_marker_vision", "--out", str(plain), "--quiet"]) == 0
    for model in ("three_marker_vision", relnav.load_model("three_marker_vision")):
        relnav.write(relnav.filter_log(log, model), track)
        written = [[line for line in path.read_text().splitlines() if line[0] != "#"] for path in (track, plain)]
        assert written[0] == written[1]
    with pytest.raises(relnav.UsageError, match="method is for three-beacon models"):
        relnav.filter_log(log, "three_marker_vision", method="fix")


def test_smoothed(folder, tmp_path, capsys):
    """The command and the call write the same track, which says that it is smoothed; sigmas are smaller."""
    log, track, called = folder / "log.csv", tmp_path / "track.csv", tmp_path / "called.csv"
    assert run(["filter", str(log), "--model", "three_marker_vision", "--smooth", "--out", str(track)]) == 0
    assert "model three_marker_vision, smoothed" in capsys.readouterr().out
    solution = relnav.filter_log(log, "three_marker_vision", smooth=True)
    relnav.write(solution, called)
    texts = [path.read_text().splitlines() for path in (track, called)]
    assert all("# smoothed = yes" in text for text in texts)
    assert [line for line in texts[0] if line[0] != "#"] == [line for line in texts[1] if line[0] != "#"]
    plain = relnav.filter_log(log, "three_marker_vision")
    ratio = np.sqrt(solution.covariance[:, range(12), range(12)] / plain.covariance[:, range(12), range(12)])
    assert np.nanmax(ratio) <= 1.0 + 1e-3  # with errors that are considered it need not be smaller everywhere
    across = [1, 2]  # the chaser's attitude error times the range, which no image tells
    assert (np.delete(np.nanmedian(ratio, axis=0), across) < 0.8).all()
    np.testing.assert_array_equal(solution.state[-1], plain.state[-1])


def test_a_log_is_read_piece_by_piece(folder, monkeypatch):
    """The navigator goes on from piece to piece: no bit changes."""
    whole = relnav.filter_log(folder / "log.csv", "three_marker_vision")
    monkeypatch.setattr("relnav.files.logs.CHUNK_LINES", 37)
    pieces = relnav.filter_log(folder / "log.csv", "three_marker_vision")
    for name in ("t_s", "state", "covariance", "docking_covariance", "ambiguity", "status"):
        np.testing.assert_array_equal(getattr(pieces, name), getattr(whole, name))


def test_the_track_says_what_is_doubtful(tmp_path, capsys):
    """A flat pattern from 20 m: more than one pose, their odds in a column of their own, empty where one is left.

    Odds of ten thousand and more are no doubt.
    """
    log, out = tmp_path / "log.csv", tmp_path / "track.csv"
    flight = ["--duration", "20", "--rate", "1", "--start-range", "20", "--seed", "5", "--quiet"]
    assert run(["simulate", "three_marker_vision_flat", "--out", str(log), *flight]) == 0
    assert run(["filter", str(log), "--model", "three_marker_vision_flat", "--out", str(out)]) == 0
    track = table(out)
    np.testing.assert_array_equal(np.isnan(track["ambiguity"]), track["hypotheses"] <= 1)
    assert (track["hypotheses"] > 1).any()
    ambiguous = int((track["ambiguity"] < 18.42).sum())
    assert ambiguous > 0
    assert f"{ambiguous} epochs with an ambiguous pose" in capsys.readouterr().out


def test_images_that_come_too_late_are_counted(folder, tmp_path, capsys):
    lines = [line for line in (folder / "log.csv").read_text().splitlines() if line[0] != "#"]
    rows = ["image_t_s," + lines[0]]
    for k, line in enumerate(lines[1:]):
        t = float(line.split(",")[0])
        rows.append(f"{t - 3.0 if k in (50, 60) else t!r}," + line)
    log, out = tmp_path / "late.csv", tmp_path / "track.csv"
    log.write_text("\n".join(rows) + "\n")
    assert run(["filter", str(log), "--model", "three_marker_vision", "--out", str(out)]) == 0
    assert "2 images later than the model's longest_delay_s" in capsys.readouterr().out
    assert np.flatnonzero(table(out)["too_late"]).tolist() == [50, 60]


def test_late_exposures_in_a_log(folder, tmp_path):
    """The same spots, each written half a second after its exposure: the same state at the end."""
    lines = [line for line in (folder / "log.csv").read_text().splitlines() if line[0] != "#"]
    spots = [line.split(",")[1:7] for line in lines[1:]]
    rows = ["image_t_s," + lines[0]]
    for k, line in enumerate(lines[1:]):
        cells = line.split(",")
        image = cells[0] if k < 2 else lines[1 + k - 2].split(",")[0]
        rows.append(",".join([image, cells[0], *(spots[k - 2] if k >= 2 else [""] * 6), *cells[7:]]))
    log, track, plain = (tmp_path / name for name in ("late.csv", "late_track.csv", "track.csv"))
    log.write_text("\n".join(rows) + "\n")
    for path, out in ((log, track), (folder / "log.csv", plain)):
        assert run(["filter", str(path), "--model", "three_marker_vision", "--out", str(out), "--quiet"]) == 0
    late, order = table(track), table(plain)
    sigma = order["sigma_x_m"][-1]
    assert abs(late["x_m"][-1] - order["x_m"][-1]) < 3.0 * sigma
    assert late["sigma_x_m"][-1] == pytest.approx(sigma, rel=0.2)


def test_the_same_seed_the_same_log(folder, tmp_path):
    out = tmp_path / "again.csv"
    faults = ["--dropout", "0.05", "--hide", "c:20:30", "--seed", "3"]
    assert run(["simulate", "three_marker_vision", "--out", str(out), *FLIGHT, *faults]) == 0
    assert out.read_text() == (folder / "log.csv").read_text()
    hidden = table(out)
    gone = (hidden["t_s"] >= 20.0) & (hidden["t_s"] < 30.0)
    assert np.isnan(hidden["spot_c_x_px"][gone]).all()
    assert not np.isnan(hidden["spot_c_x_px"][~gone]).all()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["simulate", "three_marker_vision", "--hide", "z:1:2"], "a marker of a, b, c and two times in s"),
        (["simulate", "three_beacon_psd", "--hide", "c:1:2"], "--hide is for marker models"),
    ],
)
def test_wrong_use(tmp_path, capsys, arguments, text):
    assert run([*arguments, "--out", str(tmp_path / "log.csv"), *FLIGHT]) == 2
    assert text in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_what_a_marker_model_has_no_use_for(folder, capsys):
    assert run(["filter", str(folder / "log.csv"), "--model", "three_marker_vision", "--method", "fix"]) == 2
    assert "--method is for three-beacon models" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("spot_b_y_px", "spot_b_y_um", "column 'spot_b_y_px' is missing"),
        ("q_chaser_from_lvlh_w", "q_chaser_w", "column 'q_chaser_from_lvlh_w' is missing"),
        ("accel_x_m_s2", "accel_x_g", "column 'accel_x_g': unknown unit 'g'"),
        ("-0.5,0.5,0.5,0.5\n", "-0.5,0.5,0.5,1.5\n", "is not a unit quaternion"),
    ],
)
def test_wrong_logs(folder, tmp_path, capsys, old, new, text):
    log = tmp_path / "log.csv"
    log.write_text((folder / "log.csv").read_text().replace(old, new, 1))
    assert run(["filter", str(log), "--model", "three_marker_vision"]) == 3
    assert text in capsys.readouterr().err


def test_an_exposure_in_the_future(folder, tmp_path, capsys):
    lines = [line for line in (folder / "log.csv").read_text().splitlines() if line[0] != "#"]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["image_t_s," + lines[0], *("99.0," + line for line in lines[1:])]) + "\n")
    assert run(["filter", str(log), "--model", "three_marker_vision"]) == 3
    assert "image_t_s 99 s lies after its row's t_s 0 s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("columns", "signs", "text"),
    [
        (
            (3, 0, 1, 2),
            (1, 1, 1, 1),
            "180 deg away from the attitude in which the model sees the target; read as scalar",
        ),
        (
            (0, 1, 2, 3),
            (-1, -1, -1, 1),
            "120 deg away from the attitude in which the model sees the target; read as the",
        ),
        ((0, 1, 2, 3), (1, 1, 1, 1), ""),
    ],
)
def test_quaternions_read_another_way(folder, tmp_path, capsys, columns, signs, text):
    """The filter starts on any held attitude, and its track is then in wrong axes."""
    log = tmp_path / "log.csv"
    lines = [line.split(",") for line in (folder / "log.csv").read_text().splitlines()[:30]]
    for cells in lines:
        if cells[0][0].isdigit():
            q = cells[-4:]
            cells[-4:] = [repr(sign * float(q[k])) for k, sign in zip(columns, signs, strict=True)]
    log.write_text("\n".join(map(",".join, lines)))
    run(["filter", str(log), "--model", "three_marker_vision"])
    out = capsys.readouterr().out
    assert text in out
    assert ("x, y, z, w of v_chaser = R v_lvlh is expected" in out) == bool(text)


def test_a_log_of_another_sensor_names_the_model(folder, tmp_path, capsys):
    assert run(["filter", str(folder / "log.csv"), "--model", "three_beacon_psd"]) == 3
    assert "--model three_marker_vision, or a marker model of yours" in capsys.readouterr().err
    log = tmp_path / "log.csv"
    log.write_text((folder / "log.csv").read_text().replace("_px", "_um"))
    assert run(["filter", str(log), "--model", "three_marker_vision"]) == 3
    assert "a log of beacons? --model three_beacon_psd, or a beacon model of yours" in capsys.readouterr().err


def cut(folder, path, rows, change=lambda cells, _names: cells):
    """The first rows of the log, each changed."""
    lines = [line for line in (folder / "log.csv").read_text().splitlines() if line[0] != "#"][: rows + 1]
    names = lines[0].split(",")
    changed = [",".join(change(line.split(","), names)) for line in lines[1:]]
    path.write_text("\n".join([lines[0], *changed]))
    return path


def test_no_start_is_an_exit_code(folder, tmp_path, capsys):
    """One image starts nothing; why stands in the summary."""
    log = cut(folder, tmp_path / "one.csv", 1)
    assert run(["filter", str(log), "--model", "three_marker_vision", "--out", str(tmp_path / "track.csv")]) == 5
    assert "no start: two images in a row must show three markers or more" in capsys.readouterr().out
    assert (tmp_path / "track.csv").exists()


def test_times_in_milliseconds_are_noticed(folder, tmp_path, capsys):
    def slow(cells, names):
        at = names.index("t_s")
        return [*cells[:at], repr(round(1000.0 * float(cells[at]))), *cells[at + 1 :]]

    log = cut(folder, tmp_path / "ms.csv", 10, slow)
    run(["filter", str(log), "--model", "three_marker_vision"])
    assert "rows are 250 s apart: if the times are milliseconds, name the column t_ms" in capsys.readouterr().out
    run(["filter", str(cut(folder, tmp_path / "s.csv", 10)), "--model", "three_marker_vision"])
    assert "milliseconds" not in capsys.readouterr().out


def test_refused_spots_without_control_columns_are_explained(folder, tmp_path, capsys):
    """The log says nothing of thrusters, and the markers run away from where the filter expects them."""
    lines = [line.split(",") for line in (folder / "log.csv").read_text().splitlines() if line[0] != "#"]
    keep = [k for k, name in enumerate(lines[0]) if not name.startswith(("accel_", "delta_v_"))]
    x = [k for k, name in enumerate(lines[0]) if name.startswith("spot_") and name.endswith("_x_px")]
    for row, cells in enumerate(lines[1:]):
        for k in x:
            if cells[k] and row > 40:
                cells[k] = repr(float(cells[k]) + 15.0 * (row % 3))
    log = tmp_path / "thrusting.csv"
    log.write_text("\n".join(",".join(cells[k] for k in keep) for cells in lines))
    run(["filter", str(log), "--model", "three_marker_vision"])
    assert "the log has no control columns" in capsys.readouterr().out
    run(["filter", str(folder / "log.csv"), "--model", "three_marker_vision"])
    assert "the log has no control columns" not in capsys.readouterr().out
