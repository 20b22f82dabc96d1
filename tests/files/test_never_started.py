"""Runs without a state: page and picture show what there is, and say that the filter never started."""

import csv
import json
import re

import numpy as np
import pytest

import relnav
import relnav.cli
from relnav.files.run_page import NOT_STARTED
from relnav.files.run_view import watcher_of

MODELS = {"beacons": "three_beacon_psd", "markers": "three_marker_vision"}


def table(path):
    with path.open() as file:
        return list(csv.reader(line for line in file if not line.startswith("#")))


def write(path, rows):
    path.write_text("".join(",".join(row) + "\n" for row in rows))


@pytest.fixture(params=["beacons", "markers"])
def model(request):
    return MODELS[request.param]


@pytest.fixture(params=["one row", "a spot that is never seen"])
def log(request, model, vbar_log, marker_log, tmp_path):
    """Logs of which no image is confirmed by the next; each kind of log has the blank cells of its third spot."""
    rows = table(vbar_log if model == MODELS["beacons"] else marker_log)[:31]
    if request.param == "one row":
        rows = rows[:2]
    else:
        unseen = [k for k, name in enumerate(rows[0]) if name.startswith("spot_c_")]
        assert len(unseen) == 2
        rows[1:] = [["" if k in unseen else cell for k, cell in enumerate(row)] for row in rows[1:]]
    write(tmp_path / "log.csv", rows)
    return tmp_path / "log.csv"


def page_of(source, *options):
    out = source.with_suffix(".html")
    arguments = ["report", str(source), "--out", str(out), "--quiet", "--capture-m", "0.2", *options]
    assert relnav.cli.run(arguments) == 0
    return out.read_text(encoding="utf-8")


def charts(page):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S).group(1))


@pytest.mark.parametrize("options", [(), ("--smooth",)])
def test_a_page_says_so(log, model, options):
    page = page_of(log, "--model", model, *options)
    assert NOT_STARTED in page
    assert "No innovations: the filter never started." in page
    assert not re.search(r"\b1 epochs\b", page)
    data = charts(page)
    assert data["path"] is None
    assert {chart["section"] for chart in data["charts"]} == {"measurements", "timeline"}


def test_so_do_track_and_picture(log, model):
    track, picture = log.with_name("track.csv"), log.with_suffix(".png")
    arguments = ["filter", str(log), "--model", model, "--out", str(track), "--plot", str(picture), "--quiet"]
    assert relnav.cli.run(arguments) == 5
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert NOT_STARTED in page_of(track)


def test_a_place_that_nobody_knows_is_no_number(log, model):
    mission = relnav.load_model(model)
    solution = (relnav.filter_log if model == MODELS["beacons"] else relnav.filter_marker_log)(log, mission)
    watcher = watcher_of(mission, 1500)
    watcher.take(solution)
    view = watcher.view()
    assert not view.started
    for values in view.place():
        assert values.shape == (3, len(solution))
        assert np.isnan(values).all()


def test_a_track_without_range_or_port_has_no_place(vbar_log, tmp_path):
    """The columns that a track cannot do without are enough for a page."""
    log, track = tmp_path / "log.csv", tmp_path / "track.csv"
    write(log, table(vbar_log)[:31])
    relnav.write(relnav.filter_log(log, MODELS["beacons"]), track)
    rows = table(track)
    kept = [rows[0].index(name) for name in ("t_s", "x_m", "y_m", "z_m", "sigma_x_m", "nis", "dof")]
    write(track, [[row[k] for k in kept] for row in rows])
    page = page_of(track)
    assert NOT_STARTED not in page
    assert charts(page)["path"] is None
