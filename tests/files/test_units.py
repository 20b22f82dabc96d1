"""Units in keys: any unit of the same kind may stand in a model or a log, and ten micrometres are 1e-05 m exactly."""

import math

import numpy as np
import pytest

import relnav
from relnav.files.logs import read_log
from relnav.files.units import UNITS, same_kind, split_unit, to_si

FOCAL = "focal_length_mm = { value = 50.0,"
LENGTHS = {"um": 50000.0, "mm": 50.0, "cm": 5.0, "m": 0.05, "km": 5e-5, "nm": 5e7}


@pytest.mark.parametrize("unit", same_kind("m"))
def test_a_model_in_any_length_unit(write_model, unit):
    path = write_model((FOCAL, f"focal_length_{unit} = {{ value = {LENGTHS[unit]!r},"))
    assert relnav.load_model(path).sensor.focal_length_m == pytest.approx(0.05, rel=1e-15)


@pytest.mark.parametrize(
    ("key", "value", "si"),
    [
        ("control_direction_sigma_rad", "0.5", 0.5),
        ("control_direction_sigma_mrad", "500.0", 0.5),
        ("control_direction_sigma_deg", "90.0", math.pi / 2),
        ("control_direction_sigma_arcsec", "3600.0", math.pi / 180),
    ],
)
def test_a_model_in_any_angle_unit(write_model, key, value, si):
    path = write_model(("control_direction_sigma_deg = { value = 0.5,", f"{key} = {{ value = {value},"))
    assert relnav.load_model(path).process_noise.control_direction_sigma_rad == pytest.approx(si, rel=1e-15)


def test_times_rates_and_speeds(write_model):
    path = write_model(
        ("control_correlation_time_s = { value = 30.0,", "control_correlation_time_min = { value = 0.5,"),
        ("initial_velocity_sigma_m_s = { value = 0.1,", "initial_velocity_sigma_mm_s = { value = 100,"),
        ("mean_motion_rad_s = { value = 0.0011313666536110223,", "mean_motion_deg_s = { value = 0.065,"),
    )
    model = relnav.load_model(path)
    assert model.process_noise.control_correlation_time_s == 30.0
    assert model.filter.initial_velocity_sigma_m_s == pytest.approx(0.1, rel=1e-15)
    assert model.orbit.mean_motion_rad_s == pytest.approx(math.radians(0.065), rel=1e-15)


def test_a_vector_is_scaled_in_every_component(write_model):
    path = write_model(
        ("detector_size_mm = { value = [8.0, 8.0],", "detector_size_cm = { value = [0.8, 0.6],"),
    )
    assert relnav.load_model(path).sensor.detector_size_m == pytest.approx((0.008, 0.006), rel=1e-15)


def test_a_bare_value_is_a_value_without_source(write_model, shipped_text):
    line = next(line for line in shipped_text.splitlines() if line.startswith("focal_length_mm"))
    model = relnav.load_model(write_model((line, "focal_length_mm = 50")))
    assert model.sensor.focal_length_m == 0.05
    assert model.provenance["sensor.focal_length_mm"] == "unstated"


@pytest.mark.parametrize("unit", same_kind("m"))
def test_a_log_in_any_length_unit(write_log, lines, unit):
    factor = UNITS[unit][1]
    rows = [f"{k},{-1.5e-3 / factor!r},0,{1.5e-3 / factor!r},0,0,{1e-5 / factor!r}" for k in range(2)]
    log = read_log(write_log("\n".join([lines[0].replace("_um", f"_{unit}"), *rows])))
    expected = [[-1.5e-3, 0.0], [1.5e-3, 0.0], [0.0, 1e-5]]
    np.testing.assert_allclose(log.spots_m[1], expected, rtol=1e-14)


def test_a_log_in_mixed_units(write_log):
    header = "t_min,spot_a_x_um,spot_a_y_mm,spot_b_x_m,spot_b_y_cm,spot_c_x_km,spot_c_y_um"
    log = read_log(write_log(f"{header}\n0.5,-1500,1.5,0.0015,0.15,0.0000015,-20\n"))
    np.testing.assert_allclose(log.spots_m[0], [[-1.5e-3, 1.5e-3], [1.5e-3] * 2, [1.5e-3, -2e-5]], rtol=1e-14)
    assert log.t_s.tolist() == [30.0]


def test_control_in_its_units(write_log, lines):
    header = lines[0] + ",accel_x_mm_s2,accel_y_m_s2,accel_z_mm_s2,delta_v_x_cm_s,delta_v_y_mm_s,delta_v_z_m_s"
    log = read_log(write_log("\n".join([header, lines[1] + ",1,2,3,4,5,6"])))
    np.testing.assert_allclose(log.acceleration_m_s2, [[0.001, 2.0, 0.003]], rtol=1e-15)
    np.testing.assert_allclose(log.delta_v_m_s, [[0.04, 0.005, 6.0]], rtol=1e-15)


@pytest.mark.parametrize("k", range(1, 100))
def test_decimal_micrometres_are_exact(k):
    assert to_si(float(k), 1e-6) == float(f"{k}e-6")


def test_the_longest_unit_wins():
    assert split_unit("accel_x_m_s2") == ("accel_x", "m_s2")
    assert split_unit("initial_velocity_sigma_mm_s") == ("initial_velocity_sigma", "mm_s")
    assert split_unit("acceleration_noise_density_m2_s3") == ("acceleration_noise_density", "m2_s3")
    assert split_unit("nothing") == ("nothing", "")


@pytest.mark.parametrize("unit", UNITS)
def test_every_unit_has_an_si_unit_of_its_kind(unit):
    si, factor = UNITS[unit]
    assert UNITS[si] == (si, 1.0)
    assert factor > 0.0
