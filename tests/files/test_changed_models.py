"""Values of a model replaced for one run, by key in any unit; and sections that may be left out."""

import math

import pytest

import relnav


def test_by_key_alone_and_by_section():
    for key in ("focal_length_mm", "sensor.focal_length_mm"):
        model = relnav.load_model("three_beacon_psd", {key: 80})
        assert model.sensor.focal_length_m == 0.08
        assert model.provenance["sensor.focal_length_mm"] == "assumed: set for this run"


def test_in_another_unit_than_the_files():
    assert relnav.load_model("three_beacon_psd", {"focal_length_cm": 8.0}).sensor.focal_length_m == 0.08


def test_words_and_vectors():
    model = relnav.load_model("three_beacon_psd", {"projection": "parallel", "detector_size_mm": [4.0, 4.0]})
    assert model.sensor.projection == "parallel"
    assert model.sensor.detector_size_m == (0.004, 0.004)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("focal_lenth_mm", "'focal_lenth_mm' cannot be set: no section has it; write section.key with its unit"),
        ("focal_length_deg", "'focal_length_deg' cannot be set: no section has it"),
        ("camera.focal_length_mm", "'camera.focal_length_mm' cannot be set: no section has it"),
    ],
)
def test_keys_that_are_none(key, message):
    with pytest.raises(relnav.UsageError, match=message):
        relnav.load_model("three_beacon_psd", {key: 1.0})


def test_impossible_values_are_the_models_errors():
    with pytest.raises(relnav.ModelError, match=r"sensor.focal_length_mm: .*greater than 0; got -1.0"):
        relnav.load_model("three_beacon_psd", {"focal_length_mm": -1.0})


def test_the_instruments_sections_may_be_left_out(write_model, shipped_text):
    start = shipped_text.index("\n[detector]")
    model = relnav.load_model(write_model((shipped_text[start:], "\n")))
    assert (model.detector, model.light, model.pulses, model.calibration, model.tolerances) == (None,) * 5
    assert model.spot_sigma_m == model.sensor.spot_noise_m


def test_a_guard_shorter_than_the_detector_settles(write_model):
    path = write_model(("guard_us = { value = 100.0", "guard_us = { value = 10.0"))
    with pytest.raises(relnav.ModelError, match=r"guard_s is five time constants of detector.bandwidth_hz or more"):
        relnav.load_model(path)


def test_where_the_target_is_at_clock_zero():
    assert relnav.load_model("three_beacon_psd").orbit.true_anomaly_rad == 0.0
    model = relnav.load_model("three_beacon_psd", {"eccentricity": 0.1, "true_anomaly_deg": 90.0})
    assert model.orbit.true_anomaly_rad == pytest.approx(0.5 * math.pi)
    with pytest.raises(relnav.ModelError, match="a finite number is expected"):
        relnav.load_model("three_beacon_psd", {"true_anomaly_deg": math.inf})
