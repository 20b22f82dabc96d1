"""Tables of turntable angles and spots: what is read, and what is refused with its line and its fix."""

import re
from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.files.sun_measurements import read_sun_measurements
from relnav.geometry.projection_angles import direction_from_gimbal
from relnav.sensors.aps_sun.rays import project

HEADER = "alpha_deg,beta_deg,spot_x_px,spot_y_px"


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("aps_sun")


@pytest.fixture(scope="module")
def rows(model):
    """Rows (alpha deg, beta deg, x px, y px) of a 5 x 5 grid, noise-free."""
    along = np.linspace(-60.0, 60.0, 5)
    angles = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
    t = np.column_stack([np.tan(np.radians(angles)), np.ones(25)])
    return np.column_stack([angles, project(model, t / np.linalg.norm(t, axis=1, keepdims=True))])


@pytest.fixture
def write(tmp_path):
    """write(rows or lines, header) -> path."""

    def to(rows, header=HEADER):
        path = tmp_path / "table.csv"
        lines = rows if isinstance(rows, list) else [",".join(repr(float(v)) for v in row) for row in rows]
        path.write_text("\n".join([header, *lines]) + "\n")
        return path

    return to


def test_it_reads(write, model, rows):
    read = read_sun_measurements(write(rows), model)
    np.testing.assert_allclose(np.degrees(read.angles_rad), rows[:, :2], atol=1e-12)
    np.testing.assert_array_equal(read.spots_px, rows[:, 2:])
    np.testing.assert_array_equal(read.lines, np.arange(2, 27))
    assert (read.not_seen, read.gimbal) == (0, False)


def test_units_order_comments_and_other_columns(write, model, rows):
    mixed = np.column_stack(
        [rows[:, 3], 20.0 + 0 * rows[:, 0], np.radians(rows[:, 1]), rows[:, 2], rows[:, 0] * 60 * 60]
    )
    path = write(mixed, "# bench = 3\nspot_y_px,temperature_C,beta_rad,spot_x_px,alpha_arcsec")
    read = read_sun_measurements(path, model)
    np.testing.assert_allclose(np.degrees(read.angles_rad), rows[:, :2], atol=1e-9)
    np.testing.assert_array_equal(read.spots_px, rows[:, 2:])


def test_empty_spots_are_not_seen(write, model, rows):
    lines = [",".join(repr(float(v)) for v in row) for row in rows]
    lines[3] = "-60.0,30.0,,"
    read = read_sun_measurements(write(lines), model)
    assert (len(read.spots_px), read.not_seen) == (24, 1)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_gimbal_angles(write, model, axis):
    along = np.radians(np.linspace(-40.0, 40.0, 5))
    outer, inner = (part.ravel() for part in np.meshgrid(along, along))
    spots = project(model, direction_from_gimbal(outer, inner, axis))
    path = write(
        np.column_stack([np.degrees(outer), np.degrees(inner), spots]), "outer_deg,inner_deg,spot_x_px,spot_y_px"
    )
    read = read_sun_measurements(path, model, outer_axis=axis)
    assert read.gimbal
    np.testing.assert_allclose(read.directions, direction_from_gimbal(outer, inner, axis), atol=1e-12)
    with pytest.raises(relnav.InputError, match="the axes are exchanged"):
        read_sun_measurements(path, model, outer_axis="y" if axis == "x" else "x")


def with_rows(change):
    return lambda rows: (change(rows.copy()), HEADER)


def cell(row, column, value):
    def change(rows):
        rows[row, column] = value
        return rows

    return with_rows(change)


# ruff: noqa: E501  (a row a mistake reads best in one line)
# name: (rows -> (rows, header), text of the message after the path)
WRONG = {
    "one node missing": (with_rows(lambda r: np.delete(r, 7, axis=0)), ": the grid of 5 x 5 nodes lacks 1: (-30, 0); measure them, or say --incomplete"),
    "many nodes missing": (with_rows(lambda r: r[:18]), ": the grid of 4 x 5 nodes lacks 2: (30, 30), (30, 60); measure"),
    "a node twice": (with_rows(lambda r: np.vstack([r, r[4]])), ":27: the node (-60, 60) was measured in line 6 already; average them or keep one"),
    "radians called degrees": (with_rows(lambda r: np.column_stack([np.radians(r[:, :2]), r[:, 2:]])), ": spots move 71 times as far as the model expects: these angles are radians under the name of degrees; name the columns alpha_rad, beta_rad"),
    "degrees called radians": (lambda r: (r, HEADER.replace("deg", "rad")), ":2: column 'alpha_rad' is -60, beyond 89 deg; degrees? then name it alpha_deg"),
    "axes exchanged": (lambda r: (r, "beta_deg,alpha_deg,spot_x_px,spot_y_px"), ": spot_x_px follows 'beta_deg' and spot_y_px 'alpha_deg': the axes are exchanged; exchange the names"),
    "a mirrored axis": (with_rows(lambda r: r * [1, -1, 1, 1]), ": spot_y_px falls where 'beta_deg' grows: turn the sign"),
    "another sensor": (with_rows(lambda r: r * [0.2, 0.2, 1, 1]), ": spots move 6.1"),
    "spots in millimetres of another origin": (cell(3, 2, -3.2), ":5: the spot (-3.2, "),
    "a spot beyond": (cell(3, 3, 1024.0), "px lies off the detector of 1024 x 1024 px; spots are in whole-detector pixels"),
    "no angle": (cell(5, 1, np.nan), ":7: column 'beta_deg' is empty or no finite number"),
    "beyond the horizon": (cell(5, 0, 95.0), ":7: column 'alpha_deg' is 95, beyond 89 deg; the sun lies above the detector"),
    "a line": (lambda r: (r[r[:, 0] == 0.0].repeat(2, axis=0)[:5] + np.column_stack([np.zeros((5, 1)), np.arange(5.0), np.zeros((5, 2))]), HEADER), ": 5 points with a spot; a calibration needs six or more"),
    "no unit": (lambda r: (r, HEADER.replace("alpha_deg", "alpha")), ":1: column 'alpha': the unit is missing; write one of alpha_rad"),
    "a length": (lambda r: (r, HEADER.replace("alpha_deg", "alpha_mm")), ":1: column 'alpha_mm': unit 'mm' does not fit"),
    "misspelt": (lambda r: (r, HEADER.replace("spot_x_px", "spot_xx_px")), ":1: unknown column 'spot_xx_px'; did you mean 'spot_x_px'?"),
    "missing": (lambda r: (r, HEADER.replace("beta_deg", "bench")), ":1: column 'beta_deg' is missing; the columns are alpha_deg, bench"),
    "repeated": (lambda r: (r, HEADER.replace("beta_deg", "alpha_rad")), ":1: column 'alpha_rad' repeats 'alpha_deg'; keep one"),
    "both kinds": (lambda r: (r, HEADER.replace("beta_deg", "outer_deg")), ":1: both alpha, beta (projection angles) and outer, inner (gimbal angles)"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said(write, model, rows, name):
    change, text = WRONG[name]
    path = write(*change(rows))
    with pytest.raises(relnav.InputError) as caught:
        read_sun_measurements(path, model)
    assert re.search(re.escape(str(path)) + ".*" + re.escape(text.split(";")[0]), str(caught.value)), str(caught.value)
    assert text in str(caught.value)


def test_text_in_a_number(write, model, rows):
    lines = [",".join(repr(float(v)) for v in row) for row in rows]
    lines[2] = "-60,0,5l2.0,300"
    with pytest.raises(relnav.InputError, match=r"table.csv:4: column 'spot_x_px': '5l2.0' is not a number"):
        read_sun_measurements(write(lines), model)


def test_no_rows(write, model):
    with pytest.raises(relnav.InputError, match="no rows after the header; at least one point"):
        read_sun_measurements(write([]), model)


def test_points_on_one_line(write, model):
    line = np.column_stack([np.zeros(7), np.arange(7.0), np.full(7, 512.0), 500.0 + 4 * np.arange(7)])
    with pytest.raises(relnav.InputError, match="all points lie on one line of the field"):
        read_sun_measurements(write(line), model)


def test_an_incomplete_grid_can_be_wanted(write, model, rows):
    assert len(read_sun_measurements(write(rows[:-1]), model, incomplete=True).spots_px) == 24


def test_scattered_points_are_no_grid(write, model):
    rng = np.random.default_rng(0)
    angles = rng.uniform(-60.0, 60.0, (30, 2))
    t = np.column_stack([np.tan(np.radians(angles)), np.ones(30)])
    spots = project(model, t / np.linalg.norm(t, axis=1, keepdims=True))
    assert len(read_sun_measurements(write(np.column_stack([angles, spots])), model).spots_px) == 30


def test_a_wrong_pitch_is_noticed(write, model, rows):
    other = replace(model, sensor=replace(model.sensor, pixel_pitch_m=5e-6))
    with pytest.raises(relnav.InputError, match=r"spots move 0.265 times as far as the model's hole height"):
        read_sun_measurements(write(rows), other)
