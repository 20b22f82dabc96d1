"""Logs that are refused: the message begins with file and line, names the column and says what came."""

import re

import pytest

import relnav
from relnav.files.filter_log import filter_log
from relnav.files.logs import read_log

GOOD = "0.5,-1500,0,1500,0,0,0"

# name: (line 3 of the file, which is its second row, text of the message after "path:3: ")
ROWS = {
    "time NaN": ("nan,-1500,0,1500,0,0,0", "column 't_s' is empty or NaN; only a spot may be missing"),
    "time empty": (",-1500,0,1500,0,0,0", "column 't_s' is empty or NaN"),
    "time infinite": ("inf,-1500,0,1500,0,0,0", "column 't_s' is infinite"),
    "time overflows": ("1e999,-1500,0,1500,0,0,0", "column 't_s' is infinite"),
    "time text": ("12:30:01,-1500,0,1500,0,0,0", "column 't_s': '12:30:01' is not a number"),
    "text in a number": ("0.5,-1500,zero,1500,0,0,0", "column 'spot_a_y_um': 'zero' is not a number"),
    "decimal comma": ("0,5,-1500,0,1500,0,0,0", "7 cells are expected as in the header; got 8"),
    "short row": ("0.5,-1500,0,1500", "7 cells are expected as in the header; got 4"),
    "long row": (GOOD + ",7", "7 cells are expected as in the header; got 8"),
    "comma at the end": (GOOD + ",", "7 cells are expected as in the header; got 8"),
    "one cell": ("0.5", "7 cells are expected as in the header; got 1"),
    "time repeats": ("0.0,-1500,0,1500,0,0,0", "time 0 s repeats 0 s of the row before; sort the log by time"),
    "time goes back": ("-1,-1500,0,1500,0,0,0", "time -1 s goes back from 0 s of the row before"),
    "semicolons": ("0.5;-1500;0;1500;0;0;0", "7 cells are expected as in the header; got 1"),
    "units in a cell": ("0.5,-1500 um,0,1500,0,0,0", "column 'spot_a_x_um': '-1500 um' is not a number"),
    "a second header": (
        "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um",
        "column 't_s': 't_s' is not a number",
    ),
}


@pytest.mark.parametrize("name", ROWS)
def test_a_wrong_row_is_named_by_its_line(write_log, lines, name):
    row, text = ROWS[name]
    lines[2] = row
    path = write_log("\n".join(lines))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:3: {text}")):
        read_log(path)


def test_lines_are_counted_as_an_editor_does(write_log, lines):
    """Byte order mark, metadata, blank lines and CRLF before the wrong row."""
    text = "\ufeff# one = 1\r\n\r\n# two = 2\r\n" + "\r\n\r\n".join([*lines, "1.2,x,0,1500,0,0,0"])
    path = write_log(text)
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:12: column 'spot_a_x_um': 'x' is not a number")):
        read_log(path)


@pytest.mark.parametrize("row", [0, 19_998, 19_999, 20_000, 20_001, 44_999])
@pytest.mark.parametrize("kind", ["text", "short", "time"])
def test_a_wrong_row_far_down(write_log, lines, row, kind):
    """Chunks are 20000 lines: the line is right on either side of the seam."""
    rows = [f"{k},-1500,0,1500,0,0,0" for k in range(45_000)]
    wrong = {"text": f"{row},-1500,0,15OO,0,0,0", "short": f"{row},-1500", "time": f"{row - 7.5},-1500,0,1500,0,0,0"}
    if kind == "time" and row == 0:
        row = 1
    rows[row] = wrong[kind]
    rows[10] += "\n"  # an empty line, which counts
    path = write_log("\n".join([lines[0], *rows]))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:{row + 2 + (row > 10)}: ")):
        read_log(path)


# name: (piece of the header, what stands there instead, text of the message after "path:1: ")
HEADERS = {
    "no time": ("t_s,", "time,", "column 't_s' is missing; the columns are time, spot_a_x_um"),
    "missing column": ("spot_b_x_um", "voltage", "column 'spot_b_x_um' is missing; the columns are t_s, "),
    "misspelt": ("spot_b_x_um", "spto_b_x_um", "unknown column 'spto_b_x_um'; did you mean 'spot_b_x_um'?"),
    "misspelt end": ("spot_b_x_um", "spot_b_xx_um", "unknown column 'spot_b_xx_um'; did you mean 'spot_b_x_um'?"),
    "capital": ("spot_b_x_um", "Spot_b_x_um", "did you mean 'spot_b_x_um'?"),
    "wrong unit": (
        "spot_b_x_um",
        "spot_b_x_deg",
        "column 'spot_b_x_deg': unit 'deg' does not fit; write one of spot_b_x_um, spot_b_x_mm, spot_b_x_cm",
    ),
    "unknown unit": ("spot_b_x_um", "spot_b_x_kg", "column 'spot_b_x_kg': unknown unit 'kg'; write one of spot_b_x_um"),
    "pixels": ("spot_b_x_um", "spot_b_x_px", "column 'spot_b_x_px': pixels are of a camera that sees markers"),
    "radial": (
        "t_s",
        "accel_r_m_s2,t_s",
        "column 'accel_r_m_s2': controls are in lvlh_ccsds, with axes x, y, z, and radial",
    ),
    "radial, capital": ("t_s", "accel_R_m_s2,t_s", "column 'accel_R_m_s2': controls are in lvlh_ccsds"),
    "radial, as a word": ("t_s", "accel_radial_m_s2,t_s", "and radial out is -z there: turn all three, accel_x_m_s2"),
    "in-track": ("t_s", "delta_v_i_m_s,t_s", "and along-track is x there: turn all three, delta_v_x_m_s"),
    "cross-track": ("t_s", "accel_c_m_s2,t_s", "and +h is -y there"),
    "normal": ("t_s", "delta_v_w_mm_s,t_s", "+h is -y there: turn all three, delta_v_x_mm_s"),
    "no unit": ("spot_b_x_um", "spot_b_x", "column 'spot_b_x': the unit is missing; write one of spot_b_x_um"),
    "time without unit": ("t_s,", "t,", "column 't': the unit is missing; write one of t_s, t_min"),
    "time in metres": ("t_s,", "t_m,", "column 't_m': unit 'm' does not fit; write one of t_s, t_min"),
    "repeated": ("spot_b_x_um", "spot_a_x_um", "column 'spot_a_x_um' repeats 'spot_a_x_um'; keep one"),
    "repeated in another unit": ("spot_b_x_um", "spot_a_x_mm", "column 'spot_a_x_mm' repeats 'spot_a_x_um'"),
    "semicolons": (",", ";", "in the header; got ';': save it with commas between cells, and points in numbers"),
    "tabs": (",", "\t", "in the header; got tabs: save it with commas between cells, and points in numbers"),
    "brackets": ("t_s,", "t (s),", "the columns are t (s), spot_a_x_um, "),
    "unit in brackets": ("t_s,", "t [s],", "; write a unit without brackets: t_s"),
    "half a control": (
        "spot_c_y_um",
        "spot_c_y_um,accel_x_m_s2,accel_z_m_s2",
        "column 'accel_y_m_s2' is missing; the others of its group are there",
    ),
    "three of four": (
        "spot_c_y_um",
        "spot_c_y_um,q_cam_from_lvlh_x,q_cam_from_lvlh_y,q_cam_from_lvlh_z",
        "column 'q_cam_from_lvlh_w' is missing",
    ),
}


@pytest.mark.parametrize("name", HEADERS)
def test_a_wrong_header(write_log, lines, name):
    old, new, text = HEADERS[name]
    lines[0] = lines[0].replace(old, new)
    path = write_log("\n".join(lines))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:1: ") + ".*" + re.escape(text)):
        read_log(path)


@pytest.mark.parametrize("text", ["", "\n\n", "\ufeff", "# only = metadata\n"])
def test_an_empty_file(write_log, text):
    path = write_log(text)
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}: the file is empty; a header line and one row")):
        read_log(path)


def test_a_header_alone(write_log, lines):
    path = write_log(lines[0] + "\n\n")
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}: no rows after the header")):
        read_log(path)


def test_rows_without_a_header(write_log, lines):
    path = write_log("\n".join(lines[1:]))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:1: column 't_s' is missing")):
        read_log(path)


@pytest.mark.parametrize(
    "content", [b"\xff\xfet\x00_\x00", b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", b"PK\x03\x04\xff\xfe"]
)
def test_not_a_text_file(write_log, content):
    path = write_log(content)
    with pytest.raises(relnav.LogError, match=re.escape(str(path))):
        read_log(path)


def test_no_file(tmp_path):
    with pytest.raises(relnav.LogError, match=r"none.csv: cannot be read: No such file"):
        read_log(tmp_path / "none.csv")


def test_a_folder(tmp_path):
    with pytest.raises(relnav.LogError, match="cannot be read: Is a directory"):
        read_log(tmp_path)


@pytest.mark.parametrize(
    ("column", "cell", "text"),
    [
        ("accel_{}_m_s2", "", "is empty or NaN; only a spot may be missing"),
        ("delta_v_{}_m_s", "nan", "is empty or NaN"),
        ("delta_v_{}_m_s", "-inf", "is infinite"),
    ],
)
def test_control_must_be_there(write_log, lines, column, cell, text):
    names = [column.format(axis) for axis in "xyz"]
    rows = [lines[0] + "," + ",".join(names), lines[1] + ",0,0,0", lines[2] + f",0,{cell},0"]
    path = write_log("\n".join(rows))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:3: column '{names[1]}' {text}")):
        read_log(path)


def test_a_quaternion_that_is_none(write_log, lines):
    names = ",".join(f"q_cam_from_lvlh_{axis}" for axis in "xyzw")
    path = write_log("\n".join([f"{lines[0]},{names}", f"{lines[1]},0,0,0,1", f"{lines[2]},0,0,1,1"]))
    with pytest.raises(
        relnav.LogError, match=re.escape(f"{path}:3: q_cam_from_lvlh [0.0, 0.0, 1.0, 1.0] is not a unit")
    ):
        read_log(path)


def test_filter_log_refuses_the_same(write_log, lines):
    lines[3] = lines[1]
    path = write_log("\n".join(lines))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:4: time 0 s goes back from 0.5 s")):
        filter_log(path, "three_beacon_psd", method="spots")
