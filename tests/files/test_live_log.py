"""A log that is followed: the bits of the whole log however its bytes arrive, bad rows told and left out."""

import json
import math

import numpy as np
import pytest

import relnav
from relnav.errors import LogError, UsageError
from relnav.files import live_log
from relnav.files.filter_file import filter_file
from relnav.files.live_log import LiveLog
from relnav.files.live_track import LineByLine, ending_of
from relnav.files.marker_logs import marker_header, marker_solutions, write_marker_log, write_track
from relnav.files.simulated import write_log
from relnav.simulation.detector import Faults
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A log of 200 rows with drops and glints."""
    path = tmp_path_factory.mktemp("live") / "log.csv"
    model = relnav.load_model("three_beacon_psd")
    write_log(simulate(model, Approach(duration_s=20.0), Faults(dropout=0.1, outliers=0.05), seed=4), path)
    return path


def body(path):
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


def cut(data, sizes):
    """The bytes in pieces of these sizes, again and again."""
    out, place, k = [], 0, 0
    while place < len(data):
        size = sizes[k % len(sizes)]
        out.append(data[place : place + size])
        place, k = place + size, k + 1
    return out


def live(path, pieces, told=None, **options):
    """A log whose bytes come in these pieces."""
    told = [] if told is None else told
    return LiveLog(path, lambda _: iter(pieces), told.append, **options)


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("sizes", [(1,), (100, 3, 517), (10**9,)], ids=str)
def test_the_same_bits_however_the_bytes_arrive(flown, tmp_path, sizes, ending):
    filter_file(flown, "three_beacon_psd", tmp_path / "whole.csv")
    data = b"\xef\xbb\xbf" + flown.read_text().replace("\n", ending).encode()
    summary = filter_file(
        live(flown, cut(data, sizes)), "three_beacon_psd", tmp_path / "live.csv", writer=LineByLine(".csv")
    )
    assert (tmp_path / "live.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert summary.epochs == 200


def test_json_lines_hold_the_numbers_of_the_table(flown, tmp_path):
    filter_file(flown, "three_beacon_psd", tmp_path / "whole.csv")
    names, *rows = body(tmp_path / "whole.csv")
    filter_file(
        live(flown, [flown.read_bytes()]), "three_beacon_psd", tmp_path / "a.jsonl", writer=LineByLine(".jsonl")
    )
    relnav.write(relnav.filter_log(flown, "three_beacon_psd"), tmp_path / "b.jsonl")
    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "b.jsonl").read_bytes()
    found = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert len(found) == len(rows) == 200
    assert found[0]["x_m"] is None, "no state yet"
    for one, row in zip(found, rows, strict=True):
        assert list(one) == names.split(",")
        expected = [float(cell) if cell else math.nan for cell in row.split(",")]
        np.testing.assert_array_equal([math.nan if value is None else value for value in one.values()], expected)


def test_markers_one_by_one_are_the_bits_of_the_whole_log(tmp_path):
    mission = relnav.load_model("three_marker_vision")
    log = tmp_path / "log.csv"
    write_marker_log(simulate_flight(mission, Approach(duration_s=6.0, rate_hz=5.0), seed=2), log)
    write_track(marker_solutions(log, mission), mission.name, tmp_path / "whole.csv")
    rows = log.read_bytes().splitlines(keepends=True)
    parts = marker_solutions(live(log, rows, parse=marker_header(mission)), mission)
    write_track(parts, mission.name, tmp_path / "live.csv", None, LineByLine(".csv"))
    assert (tmp_path / "live.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


BAD = {
    "text in a number": ("1.5,abc,0,1500,0,0,0", "log.csv:5: column 'spot_a_x_um': 'abc' is not a number"),
    "half a row": ("1.5,-1500,0", "log.csv:5: 7 cells are expected as in the header; got 3"),
    "a time that repeats": ("1,-1500,0,1500,0,0,0", "log.csv:5: time 1 s repeats 1 s of the row before"),
    "no time": (",-1500,0,1500,0,0,0", "log.csv:5: column 't_s' is empty or NaN"),
    "no text": (b"1.5,\xff\xfe,0,1500,0,0,0", "log.csv: not a text file in UTF-8 (after line 4)"),
}


@pytest.mark.parametrize("at_once", [True, False], ids=["a block", "row by row"])
@pytest.mark.parametrize("name", BAD)
def test_a_bad_row_is_told_and_left_out(write_log, lines, name, at_once):
    bad, sentence = BAD[name]
    after = [f"{t},-1500,0,1500,0,0,0" for t in (2, 2.5, 3)]
    rows = [line.encode() for line in [*lines, *after]]
    rows.insert(4, bad if isinstance(bad, bytes) else bad.encode())
    data, told = b"\n".join(rows) + b"\n", []
    log = live(write_log(data), [data] if at_once else data.splitlines(keepends=True), told)
    times = np.concatenate([values[:, 0] for values in log.tables()])
    np.testing.assert_array_equal(times, [0.0, 0.5, 1.0, 2.0, 2.5, 3.0])
    assert log.refusals.count == len(told) == 1
    assert sentence in told[0]
    assert told[0].endswith("; row left out")


def test_a_row_of_which_the_end_is_missing_is_the_last(write_log, lines):
    path = write_log("\n".join(lines))
    assert sum(len(values) for values in live(path, [path.read_bytes()]).tables()) == 3


def test_what_is_no_log_any_more_ends_it(write_log, lines):
    told = []
    log = live(write_log(""), ["\n".join([*lines, *["log rotated"] * 150]).encode() + b"\n"], told)
    with pytest.raises(LogError, match="100 rows left out one after another"):
        list(log.tables())
    assert len(told) == live_log.MOST_REFUSED


def test_rows_left_out_here_and_there_do_not(write_log, lines):
    rows = [line for k in range(300) for line in ("x", f"{10 + k},-1500,0,1500,0,0,0")]
    log = live(write_log(""), ["\n".join([*lines, *rows]).encode() + b"\n"])
    assert sum(len(values) for values in log.tables()) == 303
    assert log.refusals.count == 300


def test_empty_lines_are_no_rows(write_log, lines):
    """A recorder may beat the time with them for ever."""
    pieces = ["\n".join(lines).encode(), *[b"\n" * 60_000] * 4, b"7,-1500,0,1500,0,0,0\n"]
    log = live(write_log(""), pieces)
    assert sum(len(values) for values in log.tables()) == 4
    assert log.refusals.count == 0


def test_what_cannot_be_followed(write_log, lines, tmp_path):
    with pytest.raises(LogError, match="no rows after the header"):
        list(live(write_log(""), [f"{lines[0]}\n".encode()]).tables())
    with pytest.raises(LogError, match="column 'spot_c_y_um' is missing"):
        live(write_log(""), [f"{lines[0][:-12]}\n".encode()])
    with pytest.raises(UsageError, match="a raw log of slots is filtered whole"):
        live(write_log(""), [b"t_s,beacon,adc_x1,adc_x2,adc_y1,adc_y2\n"])
    with pytest.raises(UsageError, match="--follow reads CSV"):
        live(tmp_path / "log.parquet", [])


def test_endings(tmp_path):
    assert ending_of(tmp_path / "a.jsonl", None) == ".jsonl"
    assert ending_of(tmp_path / "a.csv", ".csv") == ".csv"
    with pytest.raises(UsageError, match=r"ends in \.csv, but \.jsonl is asked for; name it a\.jsonl"):
        ending_of(tmp_path / "a.csv", ".jsonl")
    with pytest.raises(UsageError, match=r"row by row ends in \.csv or \.jsonl; got '\.oem'"):
        ending_of(tmp_path / "a.oem", None)
