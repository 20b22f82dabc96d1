"""Pictures of a run: every kind of file, nothing clipped, what lies beyond an axis shown, the same bytes twice."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.errors import UsageError
from relnav.files.filter_log import filter_log
from relnav.files.run_view import watcher_of


@pytest.fixture(scope="module")
def solution(tmp_path_factory, vbar_log):
    """Three hundred rows of the example, one image far off, one spot off, one image empty."""
    lines = vbar_log.read_text().splitlines()[:301]
    for row, spots in ((100, ["3000", "3000", "-3000", "3000", "1000", "1000"]), (120, [""] * 6)):
        cells = lines[row].split(",")
        lines[row] = ",".join([cells[0], *spots, *cells[7:]])
    path = tmp_path_factory.mktemp("picture") / "a log with $x^2$ and a very <b>long name that goes on.csv"
    path.write_text("\n".join(lines))
    return filter_log(path, "three_beacon_psd", method="spots")


@pytest.fixture(scope="module")
def view(solution):
    watcher = watcher_of(relnav.load_model("three_beacon_psd"), 1500)
    for begin in range(0, 300, 100):
        watcher.take(solution.part(begin, begin + 100))
    return watcher.view()


def test_counts_and_events(view, solution):
    assert view.thin.epochs == 300
    assert view.counts == {int(code): int((solution.status == code).sum()) for code in np.unique(solution.status)}
    assert {"STARTED", "REJECTED"} <= {event.what for event in view.events}
    assert str(view.nis) == str(solution.nis_consistency())
    np.testing.assert_array_equal(view.line("range_m"), solution.range_m)


def test_why_gates_are_missing_is_said(view, vbar_log):
    assert view.unsaid == "No gates: lasting errors are considered."  # the attitude's, of what `spots` sees
    solution = filter_log(vbar_log, "three_beacon_psd")
    for part, said in ((solution, ""), (replace(solution, smoothed=True), "No gates: the track is smoothed")):
        watcher = watcher_of(relnav.load_model("three_beacon_psd"), 1500)
        watcher.take(part)
        assert watcher.view().unsaid[: len(said) or None] == said


def test_alarms_are_told_beside_what_became_of_images(solution, tmp_path):
    """One stretch, over the parts in which it came; in the picture a row of its own."""
    number = np.arange(len(solution))
    alarm = np.where((number >= 190) & (number < 210), int(relnav.Alarm.STUCK), 0)
    alarmed = replace(solution, alarm=alarm)
    watcher = watcher_of(relnav.load_model("three_beacon_psd"), 1500)
    for begin in range(0, 300, 100):
        watcher.take(alarmed.part(begin, begin + 100))
    told = [event for event in watcher.view().events if event.what.startswith("ALARM")]
    assert [(event.what, event.epochs) for event in told] == [("ALARM STUCK", 20)]
    assert (told[0].begin_s, told[0].end_s) == (solution.t_s[190], solution.t_s[209])
    figure = alarmed.plot(tmp_path / "a.svg")
    assert "ALARM STUCK (20)" in {text.get_text() for axis in figure.axes for text in axis.get_yticklabels()}


@pytest.fixture(scope="module")
def plotted(solution, tmp_path_factory):
    path = tmp_path_factory.mktemp("plot") / "a.png"
    return solution.plot(path), path


def test_no_word_is_cut_off_and_titles_do_not_collide(plotted):
    figure, path = plotted
    assert path.stat().st_size > 50_000
    assert len(figure.subfigs) == 4
    figure.canvas.draw()  # the file has another resolution than the figure, and words are measured in dots
    titles = []
    for axis in figure.axes:
        for text in (axis._left_title, axis._right_title, axis.xaxis.label, axis.yaxis.label):
            if not text.get_text():
                continue
            box, page = text.get_window_extent(), figure.bbox
            assert box.x0 >= page.x0 - 1, text.get_text()
            assert box.x1 <= page.x1 + 1, text.get_text()
            assert box.y0 >= page.y0 - 1, text.get_text()
            assert box.y1 <= page.y1 + 1, text.get_text()
            titles.append((box.padded(-1.0), text.get_text()))
    assert len(titles) > 40
    for k, (box, name) in enumerate(titles):
        for other, second in titles[k + 1 :]:
            assert not box.overlaps(other), (name, second)


def test_what_lies_beyond_an_axis_is_marked(plotted):
    marks = [line for axis in plotted[0].axes for line in axis.lines if line.get_marker() in ("^", "v")]
    assert {100} <= {round(t * 10) + 1 for line in marks for t in line.get_xdata()}


@pytest.fixture(scope="module")
def nothing():
    """A log in which nothing was ever seen."""
    return relnav.filter_epochs(relnav.load_model("three_beacon_psd"), np.arange(3.0), np.full((3, 3, 2), np.nan))


@pytest.mark.parametrize(("ending", "begins"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_files_of_every_kind_the_same_bytes_twice(nothing, tmp_path, ending, begins):
    first, second = tmp_path / f"first.{ending}", tmp_path / f"second.{ending}"
    for path in (first, second):
        nothing.plot(path)
    assert first.read_bytes().startswith(begins)
    assert first.read_bytes() == second.read_bytes()


def test_another_ending_is_refused(nothing, tmp_path):
    with pytest.raises(UsageError, match=r"a picture ends in \.png, \.pdf or \.svg; got '\.jpg'"):
        nothing.plot(tmp_path / "a.jpg")
    assert "0 with a state" in repr(nothing)


def test_a_solution_fits_a_screen(solution):
    text = repr(solution)
    assert len(text.splitlines()) <= 7
    assert all(len(line) <= 80 for line in text.splitlines())
    assert "300 epochs" in text
