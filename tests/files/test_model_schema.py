"""The JSON schema of model files: every shipped file keeps it, and what the loader refuses it marks."""

import tomllib

import pytest

from relnav.files.model_folders import list_models, models_root
from relnav.files.model_schema import model_schema
from relnav.files.models import load_model

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")


def parsed(name):
    return tomllib.loads((models_root() / name / "model.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", list_models())
def test_shipped_models_keep_it(name):
    jsonschema.Draft7Validator(model_schema(load_model(name))).validate(parsed(name))


CHANGES = {
    "an unknown key": ("sensor", "focal_lenght_mm", 50.0),
    "a unit that does not fit": ("sensor", "focal_length_s", 50.0),
    "a text for a number": ("sensor", "focal_length_mm", "50"),
    "a value below zero": ("sensor", "focal_length_mm", -50.0),
    "a value without its reason": ("sensor", "focal_length_mm", {"value": 50.0}),
    "an unknown choice": ("attitude", "mode", "held"),
    "two components": ("docking", "port_position_m", [0.0, 0.0]),
}


@pytest.mark.parametrize("name", CHANGES)
def test_mistakes_are_marked(name):
    section, key, value = CHANGES[name]
    table = parsed("three_beacon_psd")
    table[section][key] = value
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft7Validator(model_schema(load_model("three_beacon_psd"))).validate(table)


def test_keys_are_described_in_every_unit():
    orbit = model_schema(load_model("three_beacon_psd"))["properties"]["process_noise"]["properties"]
    assert "1-sigma relative error of the size" in orbit["control_direction_sigma_deg"]["description"]
    assert {"control_correlation_time_s", "control_correlation_time_ms"} <= set(orbit)
