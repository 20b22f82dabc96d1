"""The report page: self-contained, honest about what it shows, and proof against hostile words."""

import base64
import html
import json
import os
import re
import shutil
import threading

import numpy as np
import pytest

import relnav
import relnav.cli
from relnav.files.marker_logs import write_marker_log
from relnav.files.report_page import data_block, words
from relnav.files.sealed import write_sealed
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"


@pytest.fixture(scope="module")
def track(tmp_path_factory, vbar_log):
    folder = tmp_path_factory.mktemp("report")
    log = folder / "log.csv"
    log.write_text(f"# note = {HOSTILE}\n" + "".join(vbar_log.read_text().splitlines(keepends=True)[:151]))
    assert (
        relnav.cli.run(
            ["filter", str(log), "--model", "three_beacon_psd", "--out", str(folder / "track.csv"), "--quiet"]
        )
        == 0
    )
    return folder / "track.csv"


@pytest.fixture(scope="module")
def page(track):
    out = track.with_suffix(".html")
    assert relnav.cli.run(["report", str(track), "--out", str(out), "--quiet"]) == 0
    return out.read_text(encoding="utf-8")


def data_of(page):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S).group(1))


def test_hostile_words_stay_words(page):
    assert HOSTILE not in page
    assert html.escape(HOSTILE) in page
    assert page.count("<script") == 3  # data, library, ours
    assert "<" not in data_block({"title": HOSTILE}).removeprefix('<script type="application/json" id="data">')[:-9]
    assert words("a\u202eb\x1b[2J") == "a\\u202eb\\x1b[2J"


def test_errors_alike_from_image_to_image_are_no_good_news(tmp_path):
    """NIS is below its interval, which alone would be harmless; of white noise it is."""
    rng, noise, tiles = np.random.default_rng(2), np.zeros(6), []
    head = ",".join(["t_s", *(f"spot_{one}_{axis}_um" for one in "abc" for axis in "xy")])
    for keep in (0.0, 0.9):
        rows = []
        for k in range(400):
            noise = keep * noise + 8.0 * (1.0 - keep**2) ** 0.5 * rng.normal(size=6)
            rows.append(",".join([f"{0.1 * k:.1f}", *map(str, np.array([-1500, 0, 1500, 0, 0, 0]) + noise)]))
        (tmp_path / "log.csv").write_text("\n".join([head, *rows]) + "\n")
        said = [
            "report",
            tmp_path / "log.csv",
            "--model",
            "three_beacon_psd",
            "--out",
            tmp_path / "run.html",
            "--quiet",
        ]
        assert relnav.cli.run(list(map(str, said))) == 0
        text = (tmp_path / "run.html").read_text(encoding="utf-8")
        tiles.append(next(part for part in text.split('<div class="tile') if "NIS per degree of freedom" in part))
    assert "errors smaller than stated, no fault" in tiles[0]
    assert "overconfident: errors are alike from image to image" in tiles[1]
    assert ['class="bad"' in tile for tile in tiles] == [False, True]


def test_the_page_needs_nothing_else(page):
    outside = re.sub(r"<script>.*?</script>|<footer>.*?</footer>", "", page, flags=re.S)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", outside)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-inline" not in policy.split("style-src")[0]
    assert "Permission is hereby granted" in page  # the licence of what draws the charts
    assert len(page) < 1_000_000


def test_numbers_are_those_of_the_track(page, track):
    data = data_of(page)
    table = [line for line in track.read_text().splitlines() if not line.startswith("#")]
    rows = np.genfromtxt(table, delimiter=",", names=True)
    t = np.frombuffer(base64.b64decode(data["time"]), "<f8")
    np.testing.assert_array_equal(t, rows["t_s"])
    shown = np.frombuffer(base64.b64decode(data["columns"]["range_m"]), "<f4")
    np.testing.assert_allclose(shown[1:], rows["range_m"][1:], rtol=1e-6)


def test_envelopes_lie_within_their_axes(page):
    """All of the estimate, and nearly all of its 3 sigma: the start alone may reach beyond."""
    data = data_of(page)
    columns = {name: np.frombuffer(base64.b64decode(text), "<f4") for name, text in data["columns"].items()}
    around = [chart for chart in data["charts"] if any("sigma" in line for line in chart.get("lines", ()))]
    assert len(around) > 8
    for chart in around:
        (line,), (low, high) = chart["lines"], chart["limits"]
        value, three = columns[line["column"]], 3.0 * columns[line["sigma"]]
        known = np.isfinite(value)
        assert ((value[known] > low) & (value[known] < high)).all(), chart["title"]
        inside = (value - three > low) & (value + three < high)
        assert inside[known].mean() > 0.93, chart["title"]


def test_alarms_are_on_the_timeline(track, tmp_path):
    """Beside what became of the images: a stuck spot is used whole."""
    lines = track.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("t_s,"))
    column = lines[head].split(",").index("alarm")
    for k in range(head + 60, head + 80):
        cells = lines[k].split(",")
        cells[column] = str(int(relnav.Alarm.STUCK | relnav.Alarm.SHIFTED))
        lines[k] = ",".join(cells)
    path = tmp_path / "alarmed.csv"
    path.write_text("\n".join(lines) + "\n")
    assert relnav.cli.run(["report", str(path), "--out", str(tmp_path / "page.html"), "--quiet"]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    rows = next(chart["rows"] for chart in data_of(page)["charts"] if "rows" in chart)
    assert {row["label"] for row in rows if "ALARM" in row["label"]} == {"ALARM SHIFTED (20)", "ALARM STUCK (20)"}
    assert "ALARM SHIFTED+STUCK" in page
    assert {row["column"] for row in rows} <= set(data_of(page)["columns"])


def test_the_same_run_gives_the_same_page(page, track):
    """Byte for byte: the order of the columns is the track's, not that of a set, which is another in every process."""
    header = next(line for line in track.read_text().splitlines() if not line.startswith("#")).split(",")
    shown = [name for name in data_of(page)["columns"] if name in header]
    assert shown == [name for name in header if name in shown]


def test_it_says_what_was_assumed_and_where_figures_come_from(page):
    for said in ("What the model assumed", "published 0.02 m", "abstract and section 3", "sensor.focal_length_mm"):
        assert said in page.replace("<wbr>", ""), said


def test_a_long_track_keeps_its_peaks(tmp_path, track):
    lines = track.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("t_s"))
    names, row = lines[head].split(","), lines[-1].split(",")
    nis = names.index("nis")
    out = []
    for k in range(40_000):
        row[0], row[nis] = f"{k / 10}", "77.0" if k == 23_456 else "3.0"
        out.append(",".join(row))
    long = tmp_path / "long.csv"
    long.write_text("\n".join([*lines[: head + 1], *out]) + "\n")
    page = tmp_path / "long.html"
    assert relnav.cli.run(["report", str(long), "--out", str(page), "--quiet"]) == 0
    data = data_of(page.read_text(encoding="utf-8"))
    nis = np.frombuffer(base64.b64decode(data["columns"]["nis"]), "<f4")
    assert nis.max() == 77.0
    assert len(nis) < 40_000
    assert "no peak is lost" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.json", "[1, 2]", "an object with 'model' and 'rows'"),
        ("b.json", "{", "not readable as JSON"),
        ("c.csv", "t_s,x_m,sigma_x_m,nis,dof\n0,1,1,1,1\n", "column 'y_m' is missing"),
        (
            "d.csv",
            "t_s,x_m,y_m,z_m,sigma_x_m,nis,dof\n1,1,1,1,1,1,1\n1,1,1,1,1,1,1\n",
            "d.csv:3: t_s does not increase",
        ),
    ],
)
def test_bad_input_gets_one_sentence(tmp_path, capsys, name, text, said):
    path = tmp_path / name
    path.write_text(text)
    assert relnav.cli.run(["report", str(path), "--out", str(tmp_path / "x.html")]) == 3
    error = capsys.readouterr().err
    assert said in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "x.html").exists()


def test_wrong_use(tmp_path, capsys, vbar_log, track):
    assert relnav.cli.run(["report", str(track), "--out", str(tmp_path / "x.pdf")]) == 2
    assert "a page ends in .html; got '.pdf'" in capsys.readouterr().err
    assert relnav.cli.run(["report", str(vbar_log), "--out", str(tmp_path / "x.html")]) == 2
    assert "needs --model" in capsys.readouterr().err


def test_an_accuracy_report(tmp_path):
    row = {"quantity": HOSTILE, "method": "fix", "range_m": 5.0, "published": 0.02, "measured": 0.01, "unit": "m",
           "statistic": "rms", "met": True, "expected": "met", "reason": "r"}  # fmt: skip
    report = {"model": HOSTILE, "runs": 3, "seed": 7, "rows": [row, row | {"published": None}], "ok": True}
    (tmp_path / "a.json").write_text(json.dumps(report))
    assert relnav.cli.run(["report", str(tmp_path / "a.json"), "--out", str(tmp_path / "a.html"), "--quiet"]) == 0
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert HOSTILE not in page
    assert "<script" not in page
    assert "script-src 'none'" in page
    assert 'style="width:25.0%"' in page


@pytest.fixture
def copied(campaign, tmp_path):
    return shutil.copytree(campaign, tmp_path / "copied")


def page_of(folder):
    out = folder.with_suffix(".html")
    assert relnav.cli.run(["report", str(folder), "--out", str(out), "--quiet"]) == 0
    return out.read_text(encoding="utf-8").replace("<wbr>", "")


def test_a_campaign(campaign):
    page = page_of(campaign)
    assert "<script" not in page
    assert "script-src 'none'" in page
    summary = json.loads((campaign / "summary.json").read_text())
    assert f"<td class=n>{summary['final_nees']['ratio']:.3f}</td>" in page
    seen = [row for row in summary["bins"] if row["runs"]]
    assert len(seen) >= 3
    for row in seen:
        assert f"<td class=n>{row['rms']:.4g} {row['unit']}</td>" in page
    for said in ("seed 3", "sensor.focal_length_m", "approach.assumed_noise", "flown by relnav", "published 0.02 m"):
        assert said in page, said
    assert page.count("<svg") == 3 + 6  # docking quantities by range, and the state at the end


def test_options_of_a_run_are_refused_for_a_campaign(campaign, tmp_path, capsys):
    assert relnav.cli.run(["report", str(campaign), "--out", str(tmp_path / "x.html"), "--smooth"]) == 2
    assert "--smooth is for a track or a log; " in capsys.readouterr().err
    assert not (tmp_path / "x.html").exists()


def test_histograms_hold_every_run(campaign):
    """The bars' area in the drawing is that of the normal distribution's whole: each run was counted once."""
    page = page_of(campaign)
    drawn = re.search(r'<svg[^>]*aria-label="x_m: .*?</svg>', page, re.S).group(0)
    bars = re.findall(r'width="([0-9.]+)" height="([0-9.]+)" style="fill:var\(--estimate\)', drawn)
    heights = re.findall(r'<text x="47.00" y="([0-9.]+)"[^>]*>([0-9.]+)</text>', drawn)
    (zero, _), (above, value) = heights[0], heights[1]
    unit = (float(zero) - float(above)) / float(value) * (400.0 - 52.0 - 18.0) / 10.0
    assert sum(float(w) * float(h) for w, h in bars) / unit == pytest.approx(1.0, rel=2e-3)


def test_hostile_words_of_a_campaign_stay_words(copied):
    from pyarrow import parquet

    described = json.loads((copied / "campaign.json").read_text())
    described |= {"method": HOSTILE, "relnav": HOSTILE}
    described["model"] |= {"name": HOSTILE, HOSTILE: HOSTILE}
    (copied / "campaign.json").write_text(json.dumps(described))
    summary = json.loads((copied / "summary.json").read_text())
    summary["outcomes"] |= {"failed": 4, HOSTILE: 1}
    for row in (summary["bins"][0], summary["final"][0], summary["nis"]):
        row |= {name: HOSTILE for name, value in row.items() if isinstance(value, str) and name != "component"}
    (copied / "summary.json").write_text(json.dumps(summary))
    part = copied / "runs" / "part-000000000004.parquet"
    table = parquet.read_table(part)
    table = table.set_column(1, "status", [[3] * 4]).set_column(2, "reason", [[HOSTILE] * 4])
    write_sealed(table, part)
    page = page_of(copied)
    assert HOSTILE not in page
    assert "<script" not in page
    assert "4 runs failed" in page
    assert page.count(html.escape(HOSTILE)) >= 4 + 4


def of_other_runs(folder):
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps(summary | {"runs": summary["runs"] + 1}))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: (folder / "campaign.json").unlink(), "no campaign's folder, as it holds no campaign.json"),
        (lambda folder: (folder / "campaign.json").write_text("{"), "not readable as JSON"),
        (lambda folder: (folder / "campaign.json").write_text("[]"), "not the description of a campaign"),
        (lambda folder: (folder / "summary.json").unlink(), "unfinished, as it holds no summary.json"),
        (lambda folder: (folder / "summary.json").write_text('{"runs": "x"}'), "not the summary of a campaign"),
        (of_other_runs, "not the summary of this campaign; delete it, and"),
        (lambda folder: (folder / "runs" / "part-000000000004.parquet").unlink(), "unfinished, 1 of 2 batches"),
        (lambda folder: (folder / "runs" / "part-000000000004.parquet").write_bytes(b"PAR1"), "damaged"),
        (lambda folder: shutil.rmtree(folder / "runs"), "unfinished, 2 of 2 batches"),
    ],
)  # fmt: skip
def test_no_finished_campaign_gets_one_sentence(copied, capsys, spoil, said):
    spoil(copied)
    assert relnav.cli.run(["report", str(copied), "--out", str(copied.with_suffix(".html"))]) == 3
    error = capsys.readouterr().err
    assert said in error
    assert len(error.strip().splitlines()) == 1
    assert not copied.with_suffix(".html").exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
@pytest.mark.parametrize("what", ["log", "track", "marker log", "vehicle log"])
def test_a_pipe_is_read_once(tmp_path, vbar_log, marker_log, what):
    """The head told what it is, and the rest was then looked for behind it: "the file is empty"."""
    flown = {"marker log": "three_marker_vision", "vehicle log": "rendezvous_demo"}.get(what, "three_beacon_psd")
    text = (
        marker_log.read_text() if what == "marker log" else "".join(vbar_log.read_text().splitlines(keepends=True)[:60])
    )
    if what == "vehicle log":
        head = "t_s,sensor," + ",".join(f"v{k}" for k in range(12)) + "\n"
        text = head + "".join(f"{0.1 * k:.1f},gyro,1e-4,-1e-3,2e-4" + "," * 9 + "\n" for k in range(25))
    if what == "track":
        (tmp_path / "log.csv").write_text(text)
        relnav.write(relnav.filter_log(tmp_path / "log.csv", flown), tmp_path / "track.csv")
        text = (tmp_path / "track.csv").read_text()
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=(tmp_path / "pipe").write_text, args=(text,))
    writer.start()
    arguments = ["report", tmp_path / "pipe", "--model", flown, "--out", tmp_path / "page.html", "--quiet"]
    assert relnav.cli.run([str(argument) for argument in arguments]) == 0
    writer.join()
    assert "<canvas" in (tmp_path / "page.html").read_text()


def test_ambiguous_poses_are_counted(tmp_path, page):
    mission = relnav.load_model("three_marker_vision_flat")
    flight = simulate_flight(mission, Approach(duration_s=10.0, rate_hz=4.0), seed=1)
    write_marker_log(flight, tmp_path / "log.csv")
    solution = relnav.filter_marker_log(tmp_path / "log.csv", mission)
    count = np.count_nonzero((solution.ambiguity < AMBIGUITY_LIMIT) & (solution.status != relnav.EpochStatus.WAITING))
    assert count > 10
    log, out = str(tmp_path / "log.csv"), tmp_path / "page.html"
    assert relnav.cli.run(["report", log, "--model", mission.name, "--out", str(out), "--quiet"]) == 0
    text = out.read_text(encoding="utf-8")
    assert re.search(rf"epochs with an ambiguous pose.{{0,80}}\b{count}\b.{{0,80}}not to be used", text, re.DOTALL)
    assert f"ambiguous pose ({count})" in text
    assert "ambiguous pose" not in page
