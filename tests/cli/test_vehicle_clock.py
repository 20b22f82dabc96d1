"""A vehicle's log whose clock is set back or counts milliseconds: nothing of it is lost without a word."""

import os
import threading

import pytest

import relnav
from relnav.errors import LogError
from relnav.files.vehicle_log import filter_rows

HEADER = "t_s,sensor,v0,v1,v2"
LATE = "gyro came too late for the window (replay_window_s = 2)"
GOES_BACK = "rows of gyro go back in time by {} s, and all were sorted by time"


def samples(count, begin_s=0.0):
    return [round(begin_s + 0.01 * k, 6) for k in range(count)]


def text(times):
    return "\n".join([HEADER, *(f"{t!r},gyro,0,0.001,0" for t in times)]) + "\n"


@pytest.fixture
def follow(run, tmp_path):
    """follow(times of gyro samples) -> (exit code, output, error) of a log that comes through a pipe."""

    def call(times):
        os.mkfifo(tmp_path / "pipe")
        writer = threading.Thread(target=(tmp_path / "pipe").write_text, args=(text(times),))
        writer.start()
        arguments = ("--model", "rendezvous_demo", "--out", tmp_path / "live.csv")
        said = run("filter", "--follow", tmp_path / "pipe", *arguments)
        writer.join()
        return said

    return call


@pytest.fixture
def whole(run, tmp_path):
    """whole(times of gyro samples) -> (exit code, output, error) of a log that is there."""

    def call(times):
        (tmp_path / "log.csv").write_text(text(times))
        return run("filter", tmp_path / "log.csv", "--model", "rendezvous_demo")

    return call


@pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")
def test_followed_each_row_that_is_too_late_is_told_and_counted(follow):
    """Here and there: the rows between them are used, and the input goes on."""
    times = samples(300)
    for k in range(130):
        times.insert(165 + 2 * k, 0.001 * k - 1.0)  # before the start
    code, out, error = follow(times)
    assert code == 0
    assert error.count(f"{LATE}; row left out\n") == 130
    assert f"at -0.9 s: {LATE}; row left out" in error
    assert f"130 rows of {LATE}\n" in out
    assert "130 rows left out, reported above" in out


@pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")
def test_followed_a_clock_that_is_set_back_ends_it(follow):
    """A hundred rows one after another that the filter cannot take, as of any log."""
    code, _, error = follow([*samples(500), *samples(500)])
    assert code == 3
    assert error.count(f"{LATE}; row left out\n") == 100
    assert "100 rows left out one after another: not the log it began as" in error


def test_a_row_that_is_too_late_ends_what_has_nobody_to_tell():
    vehicle, rate = relnav.load_model("rendezvous_demo"), [0.0, 0.001, 0.0]
    with pytest.raises(LogError, match=r"at 0\.5 s: gyro came too late for the window \(replay_window_s = 2\)"):
        list(filter_rows([("gyro", t, rate) for t in (0.0, 2.6, 0.7, 0.5)], vehicle))


@pytest.mark.parametrize(("again_s", "back"), [(0.5, "2.49"), (-8.0, "10.99")])
def test_a_whole_log_of_which_the_clock_is_set_back(whole, again_s, back):
    code, out, error = whole([*samples(300), *samples(300, again_s)])
    assert (code, error) == (0, "")
    assert GOES_BACK.format(back) in out


def test_rows_that_are_late_within_the_window_say_nothing(whole):
    """A second's samples after those of the next one; not so the last ones, before all others."""
    times = samples(300)
    code, out, error = whole([*times[100:200], *times[:100], *times[200:]])
    assert (code, error) == (0, "")
    assert "go back" not in out
    assert "go back" in whole([*times[230:], *times[:230]])[1]


def test_milliseconds_are_refused(whole):
    """Before a flight of a thousand times the length is filtered."""
    code, _, error = whole([1e3 * t for t in samples(300)])
    assert code == 3
    assert "log.csv: rows of gyro are 10 s apart, and 0.01 s by its rate_hz: the times are milliseconds" in error
    assert "divide them by 1000" in error


@pytest.mark.parametrize("apart", [0.002, 0.05, 1.0, 8.0])
def test_another_rate_is_not(whole, apart):
    assert whole([apart * k for k in range(20)])[0] == 0
