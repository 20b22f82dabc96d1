"""A calibration as a file: read as written, named by a model, and refused with the reason."""

import re

import numpy as np
import pytest

import relnav
from relnav.files.psd_calibration import read_calibration, write_calibration
from relnav.files.psd_grid import read_grid
from relnav.sensors.three_beacon.calibrate import calibrate

SECTION = "[tolerances]\nfocal_length_relative_sigma"


@pytest.fixture(scope="module")
def report():
    rng = np.random.default_rng(1)
    measured = rng.uniform(-3e-3, 3e-3, (100, 2))
    true = measured + 1e-4 * (measured / 3e-3) ** 2 + rng.normal(size=(100, 2)) * 5e-6
    return calibrate(true, measured)


def named(text):
    return (SECTION, f"[calibration]\n{text}\n\n{SECTION}")


def test_it_comes_back_as_written(report, tmp_path):
    write_calibration(report, tmp_path / "c.toml", "grid.csv")
    got, c = read_calibration(tmp_path / "c.toml"), report.calibration
    spots = np.random.default_rng(2).uniform(-4e-3, 4e-3, (50, 2))
    np.testing.assert_allclose(got.correct(spots), c.correct(spots), rtol=0.0, atol=1e-17)
    np.testing.assert_allclose(got.corrected(spots)[1], c.corrected(spots)[1], rtol=1e-12)


def test_a_model_names_it_and_everything_uses_it(report, write_model):
    path = write_model(named('file = "c.toml"'))
    write_calibration(report, path.with_name("c.toml"), "grid.csv")
    model = relnav.load_model(path)
    assert model.calibration.order == report.calibration.order
    assert model.provenance["calibration.file"] == "unstated"
    assert model.spot_sigma_m == pytest.approx(np.hypot(1e-5, report.calibration.residual_sigma_m), rel=1e-12)
    spots = np.array([[-2.3e-3, 0.1e-3], [2.3e-3, 0.0], [0.0, 0.2e-3]])
    plain = relnav.load_model("three_beacon_psd")
    raw, corrected = relnav.three_beacon.measure(spots, model), model.calibration.correct(spots)
    assert raw.range_m == relnav.three_beacon.measure(corrected, plain).range_m
    assert raw.range_m != relnav.three_beacon.measure(spots, plain).range_m
    steps = [relnav.Navigator(model, method="spots"), relnav.Navigator(plain, method="spots")]
    for k in range(3):
        records = [steps[0].step(0.1 * k, spots), steps[1].step(0.1 * k, corrected)]
    np.testing.assert_allclose(records[0].state, records[1].state, rtol=1e-3)
    many = relnav.filter_epochs(model, np.arange(3) * 0.1, np.tile(spots, (3, 1, 1)), method="spots")
    np.testing.assert_array_equal(many.state[-1], records[0].state)


def test_with_a_source(report, write_model):
    path = write_model(named('file = { value = "c.toml", source = "derived", why = "bench of May" }'))
    write_calibration(report, path.with_name("c.toml"), "grid.csv")
    assert relnav.load_model(path).provenance["calibration.file"] == "derived: bench of May"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('file = "none.toml"', "calibration.file: .*none.toml: cannot be read: No such file"),
        ("file = 3", r'calibration: file = "..." is expected \(from `relnav calibrate psd`\), and no other key'),
        ('order = 3\nfile = "a.toml"', 'calibration: file = "..." is expected'),
        ('file = "model.toml"', r"calibration.file: .*unknown section; a calibration file holds \[calibration\]"),
    ],
)
def test_a_model_that_names_something_else(write_model, text, message):
    with pytest.raises(relnav.ModelError, match=message):
        relnav.load_model(write_model(named(text)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("order = 4", "order = 2", "correction_x_m has 6 coefficients for order 2; got 15"),
        ("order = 4", "order = 1000000", "correction_x_m has 500001500001 coefficients for order 1000000; got 15"),
        ("correction_x_um = [", "correction_x_um = [nan, ", r"a finite number is expected; got \[nan, .{70} \.\.\.$"),
        ("points = 100", "", "'points' is missing"),
        ("residual_sigma_um = ", "residual_sigma_um = -", "residual_sigma_um: .*greater than or equal to 0"),
        ("correction_y_um = [", "correction_y_um = [0.0, 4e3] #", "correction_y_m has 15 coefficients .* got 2"),
        (
            "correction_x_um = [",
            None,
            r"calibration: the correction diverges at \(.*\) mm: it changes by 3.88e\+03 times",
        ),
        ("[calibration]", "[correction]", r"a section \[calibration\] is expected, as `relnav calibrate psd` writes"),
    ],
)
def test_a_file_that_is_wrong(report, tmp_path, old, new, message):
    assert report.calibration.order == 4
    path = tmp_path / "c.toml"
    write_calibration(report, path, "grid.csv")
    text = path.read_text()
    if new is None:  # the last coefficient is that of v^4: three metres of it
        at = text.index(old)
        end = text.index("]", at)
        text = text[: text.rindex(",", at, end)] + ", 3e6" + text[end:]
    path.write_text(text.replace(old, old if new is None else new))
    with pytest.raises(relnav.ModelError, match=message):
        read_calibration(path)


GRID = ["true_x_um,true_y_um,spot_x_mm,spot_y_um", "0,0,0.01,5", "# remark", "1000,0,1.02,-4", "0,1000,,"]


def test_a_grid_in_mixed_units(write_log):
    true, measured, lines = read_grid(write_log("\n".join(GRID)))
    assert lines == [2, 4, 5]
    np.testing.assert_allclose(true, [[0, 0], [1e-3, 0], [0, 1e-3]])
    np.testing.assert_allclose(measured, [[1e-5, 5e-6], [1.02e-3, -4e-6], [np.nan, np.nan]])


@pytest.mark.parametrize(
    ("line", "text", "message"),
    [
        (0, "true_x_um,true_y_um,spot_x,spot_y_um", ":1: one column 'spot_x_um' (or another length unit) is expected"),
        (0, "true_x_um,true_y_um,spot_x_deg,spot_y_um", ":1: column 'spot_x_deg': unit 'deg' does not fit"),
        (1, "0,0,0.01", ":2: 4 cells are expected as in the header; got 3"),
        (3, "1000,0,x,-4", ":4: column 'spot_x_mm': 'x' is not a number"),
        (3, ",0,1,-4", ":4: column 'true_x_um' is empty or no finite number; only a spot may be missing"),
    ],
)
def test_a_wrong_grid(write_log, line, text, message):
    lines = list(GRID)
    lines[line] = text
    path = write_log("\n".join(lines))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}{message}")):
        read_grid(path)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_exchanged_columns(write_log, angle):
    """A lattice where the spots should be; a turned one is none along the axes, and nothing can be said."""
    line = np.linspace(-3000.0, 3000.0, 7)
    true = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    true = true @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    spots = true + np.random.default_rng(1).normal(size=true.shape) * 20.0

    def written(header, first, second):
        rows = [",".join(f"{cell:.4f}" for cell in row) for row in np.hstack([first, second])]
        return write_log("\n".join([header, *rows]))

    read_grid(written("true_x_um,true_y_um,spot_x_um,spot_y_um", true, spots))
    read_grid(written("true_x_um,true_y_um,spot_x_um,spot_y_um", true, true))
    exchanged = written("spot_x_um,spot_y_um,true_x_um,true_y_um", true, spots)
    if angle == 0.0:
        with pytest.raises(relnav.LogError, match="columns 'true' and 'spot' are exchanged; true_x, true_y are where"):
            read_grid(exchanged)
    else:
        read_grid(exchanged)


def test_an_empty_grid(write_log):
    with pytest.raises(relnav.LogError, match="the file is empty; a header line and one row"):
        read_grid(write_log("# nothing\n"))
