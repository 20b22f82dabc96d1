"""Calibration files: the same after reading back, refused when damaged, and honest about the field they cover."""

import json
import os

import numpy as np
import pytest

import relnav
from relnav.accuracy.aps_sun import field_grid, noisy_spots
from relnav.files.sun_calibration import calibrate_sun, load_sun_calibration, write_sun_calibration
from relnav.geometry.projection_angles import direction_from_gimbal
from relnav.sensors.aps_sun.rays import project


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("aps_sun")


@pytest.fixture(scope="module")
def table(model, tmp_path_factory):
    """table(side, scale, header, angles) -> path of a file of measurements with the model's noise."""

    def of(side, scale=1.0, names=("alpha", "beta")):
        angles = scale * field_grid(model, side)
        rng = np.random.default_rng(4)
        if names == ("alpha", "beta"):
            spots = noisy_spots(model, angles, rng)
        else:
            spots = project(model, direction_from_gimbal(angles[:, 1], angles[:, 0]))
        path = tmp_path_factory.mktemp("table") / "bench.csv"
        lines = [f"{names[0]}_deg,{names[1]}_deg,spot_x_px,spot_y_px"]
        lines += [f"{a:.9f},{b:.9f},{x:.6f},{y:.6f}" for (a, b), (x, y) in zip(np.degrees(angles), spots, strict=True)]
        path.write_text("\n".join(lines) + "\n")
        return path

    return of


@pytest.mark.parametrize(("side", "method"), [(7, "auto"), (121, "patent")])
def test_read_back_it_is_the_same(model, table, tmp_path, side, method):
    report = calibrate_sun(table(side), model, method=method)
    write_sun_calibration(report, tmp_path / "sun.json")
    back, made = relnav.load_sun_calibration(tmp_path / "sun.json"), report.result.calibration
    assert back.method == made.method
    assert back.calibration_noise_px == made.calibration_noise_px
    for spot in ((512.0, 509.0), (300.0, 700.0), (5.0, 5.0)):
        a, b = (relnav.aps_sun.measure(spot, model, calibration=c) for c in (made, back))
        assert a.status is b.status
        np.testing.assert_array_equal(a.direction, b.direction)
        np.testing.assert_array_equal(a.covariance, b.covariance)


def test_figures(model, table):
    report = calibrate_sun(table(7), model).to_dict()
    assert report["points"] == 49
    assert 7.0 < report["error_before_max_deg"] < 8.5
    assert report["error_after_3rms_deg"] < 0.03
    assert report["parameters"]["hole_height_m"]["value"] == pytest.approx(3.5e-3, abs=5e-6)
    assert set(report["held_out_rms_px"]) >= {"no spline", "stiffness 1"}


def test_the_field_is_what_the_points_reach(model, table):
    report = calibrate_sun(table(7, 0.5), model)
    assert np.degrees(report.result.calibration.field_half_angle_rad) == pytest.approx(30.0, abs=1e-6)
    beyond = project(model, np.array([np.sin(0.7), 0.0, np.cos(0.7)]))
    seen = relnav.aps_sun.measure(beyond, model, calibration=report.result.calibration)
    assert seen.status is relnav.Status.OUTSIDE_FIELD


def test_gimbal_angles_by_their_own_names(model, table):
    report = calibrate_sun(table(9, 0.7, ("inner", "outer")), model)
    assert report.measurements.gimbal
    assert report.to_dict()["spot_residual_rms_px"] < 0.01


def test_gimbal_angles_under_the_wrong_name_are_found_out(model, table):
    """Up to 6 deg of misfit at the corners: the fit says which names are right."""
    path = table(9, 0.7, ("inner", "outer"))
    path.write_text(path.read_text().replace("inner_deg,outer_deg", "alpha_deg,beta_deg"))
    with pytest.raises(relnav.InputError, match=r"gimbal angles 0\.0\d px; rename beta to outer and alpha to inner"):
        calibrate_sun(path, model)


def test_the_patent_needs_its_grid(model, table):
    with pytest.raises(
        relnav.InputError, match=r"bench.csv: the patent's table needs every whole degree .* lacks 14592"
    ):
        calibrate_sun(table(7), model, method="patent")
    with pytest.raises(relnav.InputError, match="leave out --incomplete"):
        calibrate_sun(table(7), model, method="patent", incomplete=True)


def test_too_small_a_field(model, table):
    with pytest.raises(relnav.InputError, match=r"the points reach 3\.0 deg on the shortest side"):
        calibrate_sun(table(5, 0.05), model)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda c: c.pop("format"), "'format' must be"),
        (lambda c: c.pop("table"), "'table' is missing"),
        (lambda c: c.pop("spot_noise_px"), "'spot_noise_px' is missing"),
        (lambda c: c.update(spot_noise_px=-1.0), "spot_noise_px, calibration_noise_px are"),
        (lambda c: c.update(spot_noise_px="many"), "could not convert"),
        (lambda c: c["table"]["tangents"].pop(), "do not fit nodes"),
        (lambda c: c["table"]["tangents"][3][3].__setitem__(0, None), "not a finite number"),
        (lambda c: c["table"]["x_px"].__setitem__(2, 300.0), "evenly spaced"),
        (lambda c: c.update(table=5), "make the file anew"),
    ],
)
def test_damaged_files(model, table, tmp_path, change, text):
    path = tmp_path / "sun.json"
    write_sun_calibration(calibrate_sun(table(5), model, method="rays"), path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(relnav.InputError, match=f"sun.json: .*{text}"):
        load_sun_calibration(path)


@pytest.mark.parametrize(
    ("old", "new"), [('"limit_deg": ', '"limit_deg": Infinity, "was": '), ('"h_px": ', f'"h_px": {"9" * 400}, "was": ')]
)
def test_numbers_beyond_all_bounds(model, table, tmp_path, old, new):
    """Each ended in an OverflowError."""
    path = tmp_path / "sun.json"
    write_sun_calibration(calibrate_sun(table(121), model, method="patent"), path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(relnav.InputError, match=r"sun\.json: .*make the file anew"):
        load_sun_calibration(path)


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no /dev/zero on this system")
def test_a_file_without_end():
    with pytest.raises(relnav.InputError, match="larger than 50 MB, so not a calibration file"):
        load_sun_calibration("/dev/zero")


def test_no_calibration_file(tmp_path):
    with pytest.raises(relnav.InputError, match="cannot be read: No such file"):
        load_sun_calibration(tmp_path / "none.json")
    (tmp_path / "text.json").write_text("alpha_deg,beta_deg")
    with pytest.raises(relnav.InputError, match=r"text\.json: not readable as JSON"):
        load_sun_calibration(tmp_path / "text.json")
    (tmp_path / "nested.json").write_text("[" * 60_000)
    with pytest.raises(relnav.InputError, match=r"nested\.json: not readable as JSON"):
        load_sun_calibration(tmp_path / "nested.json")
    (tmp_path / "list.json").write_text("[1, 2]")
    with pytest.raises(relnav.InputError, match="'format' must be"):
        load_sun_calibration(tmp_path / "list.json")
