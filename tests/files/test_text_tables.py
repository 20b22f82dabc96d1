"""One reader for every table: the same encodings, limits and sentences for logs, grids, frames, orbits and joins."""

import gzip
import os
import re
import threading

import numpy as np
import pytest

import relnav
from relnav.errors import InputError
from relnav.files import text_table
from relnav.files.attitude_log import join_attitude, read_orbit, read_star_log
from relnav.files.logs import read_log
from relnav.files.marker_logs import filter_marker_log
from relnav.files.models import load_model
from relnav.files.psd_grid import read_grid
from relnav.files.raw_logs import read_raw_log
from relnav.files.star_frames import read_star_frame
from relnav.files.sun_measurements import read_sun_measurements

SPOTS = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
PIXELS = SPOTS.replace("_um", "_px")


def join(path):
    """Two attitudes, from 0 to 10 s."""
    return join_attitude(path, np.array([0.0, 10.0]), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)), path.with_name("out.csv"))


# name: (reader, header, row with {} for a number that must be one, value of it in a good row)
READERS = {
    "beacon log": (read_log, SPOTS, "{},-1500,0,1500,0,0,0"),
    "marker log": (lambda path: filter_marker_log(path, load_model("three_marker_vision")), PIXELS, "{},1,2,3,4,5,6"),
    "raw log": (read_raw_log, "t_s,beacon,adc_x1,adc_x2,adc_y1,adc_y2", "{},a,1,2,3,4"),
    "grid": (read_grid, "true_x_um,true_y_um,spot_x_um,spot_y_um", "{},2,3,4"),
    "sun table": (
        lambda path: read_sun_measurements(path, load_model("aps_sun")),
        "alpha_deg,beta_deg,spot_x_px,spot_y_px",
        "{},2,500,500",
    ),
    "star frame": (read_star_frame, "x_px,y_px,flux", "{},2,3"),
    "star log": (read_star_log, "t_s,x_px,y_px,flux", "{},1,2,3"),
    "orbit": (read_orbit, "t_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s", "{},6778,0,0,0,7.6,0"),
    "joined log": (join, SPOTS, "{},-1500,0,1500,0,0,0"),
}


@pytest.fixture(params=READERS)
def table(request, tmp_path):
    """table(text or bytes) -> the sentence with which this reader refuses it, without the file's name."""
    reader, header, row = READERS[request.param]

    def refuse(make):
        content = make(header, row)
        path = tmp_path / "table.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(InputError) as caught:
            reader(path)
        message = str(caught.value)
        assert message.startswith(str(path))
        assert message.isprintable(), "one line, and nothing that a terminal obeys"
        assert len(message) < 3_000
        assert not (tmp_path / "out.csv").exists()
        return message.removeprefix(str(path))

    return refuse


def test_latin_1(table):
    assert table(lambda head, row: f"# für\n{head}\n{row.format(0)}\n".encode("latin-1")).startswith(
        ": not a text file in UTF-8"
    )


def test_compressed(table):
    """In one line, and with a byte that is a line's end in its header (its time of 10 s)."""
    for mtime in (0, 10):
        said = table(lambda head, row, t=mtime: gzip.compress(f"{head}\n{row.format(0)}\n".encode(), mtime=t))
        assert said == ": compressed with gzip; a CSV is expected: unpack it first (gunzip)"


def test_utf_16(table):
    assert "UTF-16? save it as UTF-8" in table(lambda head, row: f"{head}\n{row.format(0)}\n".encode("utf-16"))


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "utf-32-le"])
def test_utf_16_without_its_mark(table, encoding):
    assert "zero bytes; UTF-16? save it as UTF-8" in table(
        lambda head, row: f"{head}\n{row.format(0)}\n".encode(encoding)
    )


def test_empty(table):
    assert table(lambda *_: "").startswith(": the file is empty; a header line and one row")


def test_semicolons(table):
    assert table(lambda head, _: head.replace(",", ";")).startswith(":1: cells separated by commas are expected")


def test_text_in_a_number(table):
    message = table(lambda head, row: f"# a\n{head}\n{row.format(0)}\n{row.format('1_5')}\n")
    assert re.match(r":4: column '\w+': '1_5' is not a number", message)


def test_a_nan_where_none_may_be(table):
    assert re.match(
        r":3: .*(empty|NaN|finite|nan)", table(lambda head, row: f"{head}\n{row.format(0)}\n{row.format('nan')}\n")
    )


def test_a_short_row(table):
    assert re.match(
        r":3: \d cells are expected as in the header; got 1", table(lambda head, row: f"{head}\n{row.format(0)}\n1\n")
    )


def test_a_field_longer_than_the_csv_module_takes(table):
    long = '"' + "1" * 140_000 + '"'
    assert ":3: not a row of cells" in table(lambda head, row: f"{head}\n{row.format(0)}\n{row.format(long)}\n")


def test_a_line_without_end(table):
    assert ":2: a line of 1000000 characters" in table(lambda head, _: head + "\n" + "1" * 1_000_001)


def test_a_million_columns(table):
    assert ":1: 3000 columns; up to 2000 are read" in table(lambda *_: ",".join(f"a{k}" for k in range(3_000)))


def test_no_header(table):
    assert "10000 lines and no header yet" in table(lambda *_: "# a\n" * 10_001)


def test_no_rows_without_end(table, monkeypatch):
    monkeypatch.setattr(text_table, "MOST_EMPTY_LINES", 100)
    assert "100 lines without a row" in table(lambda head, _: head + "\n" * 200)


def test_control_characters(table):
    """An escape, a carriage return in quotes, a line separator: none reaches the terminal."""
    table(lambda head, row: f"{head}\n{row.format(0)}\n{row.format(chr(27) + '[31mred')}\n")
    table(lambda head, _: "\x1b]0;own\x07" + head[1:] + "\n")
    table(lambda head, row: f"{head}\n{row.format(0)}\n{row.format(chr(0x2028))}\n")


GOOD = {
    "beacon log": read_log,
    "raw log": read_raw_log,
    "star log": read_star_log,
    "orbit": read_orbit,
    "joined log": join,
}


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_byte_order_mark_comments_blank_lines_and_any_line_end(tmp_path, name, end):
    _, header, row = READERS[name]
    path = tmp_path / "table.csv"
    lines = ["\ufeff# one = 1", "", header, row.format(0), "", "# between", row.format(1)]
    path.write_bytes(end.join(lines).encode())
    GOOD[name](path)


def test_a_joined_log_keeps_its_lines_and_may_be_in_milliseconds(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(f"# model = a\n{SPOTS.replace('t_s', 't_ms')}\n0,-1500,0,1500,0,0,0\n10000,-1500,0,1500,0,0,\n")
    assert join(path) == 2
    assert (tmp_path / "out.csv").read_text().splitlines()[3] == "10000,-1500,0,1500,0,0,,0.0,0.0,0.0,1.0"
    path.write_text(f"{SPOTS}\n0,-1500,0,1500,0,0,0\n20,-1500,0,1500,0,0,0\n")
    with pytest.raises(InputError, match=r"log.csv:3: time 20 s lies outside the star sensor's attitudes, 0 to 10 s"):
        join(path)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no /dev/zero on this system")
@pytest.mark.parametrize("name", READERS)
def test_an_endless_device(name):
    from pathlib import Path

    with pytest.raises(InputError, match="a line of 1000000 characters or more"):
        READERS[name][0](Path("/dev/zero"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
@pytest.mark.parametrize("name", ["beacon log", "raw log", "grid", "star frame", "star log", "orbit", "joined log"])
def test_a_pipe_is_read_as_the_file_is(tmp_path, name):
    reader, header, row = READERS[name]
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    text = "\n".join([header, *(row.format(k) for k in range(3))])
    writer = threading.Thread(target=lambda: pipe.write_text(text))
    writer.start()
    reader(pipe)
    writer.join(timeout=10.0)
    assert not writer.is_alive()


BEYOND = {
    "time": ("1e300,1,2,3,4,5,6,0,0,0", "column 't_s' is 1e+300 in SI units; up to 1e+11 is credible; milliseconds"),
    "control": ("1,1,2,3,4,5,6,1e308,0,0", "column 'accel_x_m_s2' is 1e+308 in SI units; up to 10000 is credible"),
    "control below": ("1,1,2,3,4,5,6,0,-1e20,0", "column 'accel_y_m_s2' is -1e+20 in SI units"),
}


@pytest.mark.parametrize("name", BEYOND)
@pytest.mark.parametrize(("kind", "model"), [("um", "three_beacon_psd"), ("px", "three_marker_vision")])
def test_numbers_beyond_all_belief(tmp_path, name, kind, model):
    """In logs of beacons and of markers alike, before they make a covariance that is none."""
    row, text = BEYOND[name]
    path = tmp_path / "log.csv"
    head = SPOTS.replace("_um", f"_{kind}") + ",accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
    path.write_text(f"{head}\n0,1,2,3,4,5,6,0,0,0\n{row}\n")
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:3: {text}")):
        relnav.filter_log(path, model)


def test_an_orbit_that_is_none(tmp_path):
    path = tmp_path / "orbit.csv"
    path.write_text("t_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n0,6778,0,0,0,7.6e3,0\n")
    with pytest.raises(InputError, match=r"orbit.csv:2: a speed of 7600 km/s at 6778 km from the Earth's centre"):
        read_orbit(path)
