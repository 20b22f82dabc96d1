"""Pictures and pages of vehicles and of markers: every axis, envelopes, gates, published figures, alarms."""

import base64
import json
import re

import numpy as np
import pytest

import relnav
import relnav.cli
from relnav.files.model_folders import find_model
from relnav.files.run_view import PORT_MOTION, PORTS
from relnav.files.sensor_picture import DEVIATION_TITLE, DRIFT_TITLE, NIS_TITLE, TIMELINE_TITLE
from relnav.files.track_file import TrackFile
from relnav.files.track_picture import track_figures
from relnav.files.vehicle_view import vehicle_watcher
from relnav.vehicle.monitor import ALARM_SIGMA

SENSORS = ("camera", "psd", "star", "sun_aps", "sun_birefringent")


def data_of(page):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S).group(1))


def table_of(path):
    return np.genfromtxt([row for row in path.read_text().splitlines() if row[0] != "#"], delimiter=",", names=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A vehicle that is sampled slower, its log, its track and picture; the gyro is lost for a while."""
    folder = tmp_path_factory.mktemp("vehicle")
    text = find_model("rendezvous_demo").read_text(encoding="utf-8")
    for rate in ("100.0", "10.0", "5.0"):
        text = text.replace(f"rate_hz = {{ value = {rate}", f"rate_hz = {{ value = {float(rate) / 5.0}")
    (folder / "slow.toml").write_text(text, encoding="utf-8")
    (folder / "published.toml").write_text(
        find_model("rendezvous_demo").with_name("published.toml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    model, log = str(folder / "slow.toml"), folder / "log.csv"
    assert relnav.cli.run(["simulate", model, "--out", str(log), "--final-range", "29", "--seed", "5", "--quiet"]) == 0
    rows = log.read_text().splitlines(keepends=True)
    kept = [row for row in rows if not (",gyro," in row and 4.0 < float(row.split(",")[0]) < 6.5)]
    log.write_text("".join(row for row in kept if not (",psd," in row and float(row.split(",")[0]) > 5.0)))
    written = ["--out", str(folder / "track.csv"), "--plot", str(folder / "run.svg")]
    assert relnav.cli.run(["filter", str(log), "--model", model, *written, "--quiet"]) == 0
    return folder


@pytest.fixture(scope="module")
def alarmed(folder):
    """The track, with an alarm of the star sensor, as a file."""
    lines = (folder / "track.csv").read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("t_s,"))
    names = lines[head].split(",")
    for k in (head + 4, head + 5):
        cells = lines[k].split(",")
        cells[names.index("alarm_star")], cells[names.index("deviation_star")] = "1", "6.5"
        lines[k] = ",".join(cells)
    path = folder / "alarmed.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def view(folder, alarmed):
    track = TrackFile(alarmed)
    watcher = vehicle_watcher(relnav.load_model(folder / "slow.toml"), 1500)
    for part in track.parts():
        watcher.take_columns(part)
    return watcher.view("alarmed.csv", "slow", track.metadata)


@pytest.fixture(scope="module")
def sheets(view):
    return track_figures(view)


def test_the_track_says_how_sensors_fare(folder):
    rows = table_of(folder / "track.csv")
    assert {f"{what}_{s}" for s in SENSORS for what in ("used", "refused", "nis", "deviation", "alarm")} < set(
        rows.dtype.names
    )
    assert rows["used_camera"][:-1].all()  # the last row may be at the time of the one before
    assert rows["used_psd"][:5].all()
    assert not rows["used_psd"][6:].any()
    np.testing.assert_allclose(rows["protection_x_m"], 5.3267 * rows["sigma_x_m"], rtol=1e-4)  # two-sided 1e-7
    assert rows["gyro_lost"].sum() >= 1
    t = rows["t_s"]
    assert set(np.flatnonzero(rows["gyro_lost"])) <= set(np.flatnonzero((t > 4.0) & (t < 7.0)))


def test_sheets_of_a_vehicle(view, sheets):
    approach, space, ports, sensors = sheets
    assert [axis.name for axis in space.axes] == ["3d"]
    assert [len(sheet.axes) for sheet in (approach, ports, sensors)] == [8, 18, 4]
    titles = [axis.get_title(loc="left") for axis in (*approach.axes, *ports.axes)]
    for quantity in (*PORTS, *PORT_MOTION):
        (axis,) = [a for a in (*approach.axes, *ports.axes) if a.get_title(loc="left") == quantity.label]
        (band,) = axis.collections
        assert band.get_label() == "3-sigma envelope"
        edges = band.get_paths()[0].vertices[:, 1]
        value, three = view.line(quantity.column), 3.0 * view.largest(quantity.sigma)
        assert edges.max() == pytest.approx((value + three).max())
        assert edges.min() == pytest.approx((value - three).min())
    assert len(set(titles) - {""}) == len([t for t in titles if t])


def test_published_figure_and_protection_level_beside_the_sigma(view, sheets):
    approach = sheets[0]
    named = {axis.get_title(loc="left"): {line.get_label(): line for line in axis.lines} for axis in approach.axes}
    along = named["Port, x, 1-sigma"]
    (claim,) = [line for label, line in along.items() if label.startswith("published figure: three-beacon sensor")]
    assert set(claim.get_ydata()) == {0.02}
    (level,) = [line for label, line in along.items() if label.startswith("protection level")]
    np.testing.assert_allclose(level.get_ydata(), 5.3267 * view.largest("sigma_port_x_m"), rtol=1e-4)
    assert not any("published" in label for label in named["Port, y, 1-sigma"])


def test_sensors_when_and_alarms(view, sheets):
    timeline, watched, drifting, nis = sheets[3].axes
    titles = [axis.get_title(loc="left") for axis in (timeline, watched, drifting, nis)]
    assert titles == [TIMELINE_TITLE, DEVIATION_TITLE, DRIFT_TITLE, NIS_TITLE]
    assert {line.get_label() for line in drifting.lines} >= {
        *SENSORS,
        "gyro",
        "thrust",
        f"alarm, {ALARM_SIGMA:g} sigma",
    }
    labels = [text.get_text() for text in timeline.get_yticklabels()]
    assert [label.split(" ")[0] for label in labels if "used" in label] == [*reversed(SENSORS)]
    assert labels[0] == "ALARM star (2)"
    assert any(label.startswith("gyro lost") for label in labels)
    assert timeline.collections[-1].get_paths()  # the first row, drawn last from below
    assert {line.get_label() for line in watched.lines} >= {*SENSORS, f"alarm, {ALARM_SIGMA:g} sigma"}
    (star,) = [line for line in watched.lines if line.get_label() == "star"]
    assert np.nanmax(star.get_ydata()) == 6.5
    assert watched.get_ylim()[1] > 6.5  # not cut off
    (event,) = [event for event in view.events if event.what.startswith("ALARM")]
    assert (event.what, event.epochs) == ("ALARM star", 2)


def test_words_stay_on_the_sheet(sheets):
    for sheet in (sheets[0], sheets[3]):
        sheet.canvas.draw()
        words = [text for axis in sheet.axes for text in (axis._left_title, axis._right_title, axis.yaxis.label)]
        words += [text for legend in sheet.legends for text in legend.get_texts()]
        boxes = [(text.get_text(), text.get_window_extent().padded(-1.0)) for text in words if text.get_text()]
        assert len(boxes) > 10
        for said, box in boxes:
            assert box.x0 >= sheet.bbox.x0 - 1, said
            assert box.x1 <= sheet.bbox.x1 + 1, said
        for k, (said, box) in enumerate(boxes):
            assert not [other for other, second in boxes[k + 1 :] if box.overlaps(second)], said


def test_page_of_a_vehicles_track(folder, alarmed):
    out = folder / "page.html"
    command = ["report", str(alarmed), "--model", str(folder / "slow.toml"), "--out", str(out), "--quiet"]
    assert relnav.cli.run(command) == 0
    page = out.read_text(encoding="utf-8").replace("<wbr>", "")
    data = data_of(page)
    sections = [chart["section"] for chart in data["charts"]]
    counted = {name: sections.count(name) for name in dict.fromkeys(sections)}
    assert counted == {"docking": 6, "ports": 18, "measurements": 17, "timeline": 1}
    rows = next(chart["rows"] for chart in data["charts"] if "rows" in chart)
    assert {"ALARM star (2)", *(f"{name} used" for name in SENSORS)} <= {row["label"] for row in rows} | {
        row["label"].rpartition(" (")[0] for row in rows
    }
    assert {row["column"] for row in rows} <= set(data["columns"])
    along = next(chart for chart in data["charts"] if chart["title"] == "Port, x, 1-sigma")
    assert [line.get("constant") for line in along["lines"] if line["label"] == "published"] == [0.02]
    assert "protection_port_x_m" in data["columns"]
    assert data["path"]["far"] > 29.0
    for said in ("ALARM star", "three-beacon sensor alone at 6.5 m", "Which sensor was used when", "hand_over"):
        assert said in page, said
    shown = np.frombuffer(base64.b64decode(data["columns"]["port_x_m"]), "<f4")
    np.testing.assert_allclose(shown, table_of(alarmed)["x_m"], rtol=1e-6)


def test_a_track_without_its_sensors_has_a_page_too(folder):
    lines = [line.split(",") for line in (folder / "track.csv").read_text().splitlines()]
    head = next(k for k, cells in enumerate(lines) if cells[0] == "t_s")
    more = ("used_", "refused_", "nis_", "deviation_", "drift_", "alarm_", "protection_", "gyro_")
    kept = [k for k, name in enumerate(lines[head]) if not name.startswith(more) or name == "gyro_lost"]
    rows = [",".join(cells[k] for k in kept) for cells in lines[head:]]
    (folder / "few.csv").write_text("\n".join(rows) + "\n")
    assert relnav.cli.run(["report", str(folder / "few.csv"), "--out", str(folder / "few.html"), "--quiet"]) == 0
    charts = data_of((folder / "few.html").read_text(encoding="utf-8"))["charts"]
    assert {chart["section"] for chart in charts} == {"docking", "ports", "timeline"}  # the gyro that was lost


def test_page_of_a_vehicles_log_is_that_of_its_track(folder):
    pages = []
    for source in ("log.csv", "track.csv"):
        out = folder / f"{source}.html"
        command = ["report", str(folder / source), "--model", str(folder / "slow.toml"), "--out", str(out), "--quiet"]
        assert relnav.cli.run(command) == 0
        pages.append(data_of(out.read_text(encoding="utf-8")))
    assert pages[0]["charts"] == pages[1]["charts"]
    assert pages[0]["columns"] == pages[1]["columns"]


@pytest.mark.parametrize(
    ("source", "options", "said"),
    [
        ("track.csv", ["--model", "three_beacon_psd"], "a vehicle's track, and --model three_beacon_psd is no vehicle"),
        ("log.csv", ["--model", "{slow}", "--method", "fix"], "--method is not for a vehicle"),
    ],
)
def test_what_does_not_fit_gets_one_sentence(folder, capsys, source, options, said):
    options = [option.format(slow=folder / "slow.toml") for option in options]
    assert relnav.cli.run(["report", str(folder / source), "--out", str(folder / "x.html"), *options]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.strip().splitlines()) == 1
    assert not (folder / "x.html").exists()


def test_a_vehicles_picture_of_one_command(folder):
    text = (folder / "run.svg").read_text(encoding="utf-8")
    for said in ("Approach: slow; log.csv", "Port attitude, x", TIMELINE_TITLE, "sun_birefringent used", "gyro lost"):
        assert said in text, said


@pytest.fixture(scope="module")
def marker_log(tmp_path_factory):
    log = tmp_path_factory.mktemp("markers") / "log.csv"
    arguments = ["--duration", "20", "--outliers", "0.03", "--seed", "3", "--quiet"]
    assert relnav.cli.run(["simulate", "three_marker_vision", "--out", str(log), *arguments]) == 0
    return log


def test_markers_have_innovations_within_gates(marker_log):
    from relnav.files.marker_logs import filter_marker_log

    solution = filter_marker_log(marker_log, relnav.load_model("three_marker_vision"))
    figure = solution.plot()
    assert len(figure.subfigs) == 5
    for marker in "ABC":
        for axis_name in "xy":
            title = f"Spot {marker}, {axis_name}: measured minus predicted"
            (axis,) = [a for a in figure.axes if a.get_title(loc="left") == title]
            lines = {}
            for line in axis.lines:
                lines.setdefault(line.get_label(), []).append(line.get_ydata())
            above, below = lines["gate, 99.99 %"]
            np.testing.assert_array_equal(above, -below)
            dots = np.abs(lines["one image"][0])
            assert 2.0 * np.nanstd(dots) < np.nanmedian(np.abs(above)) < 12.0 * np.nanmedian(dots)
    assert any(line.get_label() == "beyond the axis" for axis in figure.axes for line in axis.lines)  # the glints


def test_page_of_markers(marker_log, tmp_path):
    out = tmp_path / "page.html"
    command = ["report", str(marker_log), "--model", "three_marker_vision", "--out", str(out), "--quiet"]
    assert relnav.cli.run(command) == 0
    page = out.read_text(encoding="utf-8")
    data = data_of(page)
    gated = [c["title"] for c in data["charts"] if any("gate_i" in x.get("column", "") for x in c.get("lines", []))]
    assert gated == [f"Spot {marker}, {axis}" for marker in "ABC" for axis in "xy"]
    assert sum(chart["section"] == "ports" for chart in data["charts"]) == 18
    for said in ("error growth with range", "filtered over raw attitude error", "iteration that reaches the truth"):
        assert said in page, said  # what the paper claims are ratios, which no curve of one run shows
