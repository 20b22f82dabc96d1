"""`relnav models`: the list, and one model with its values, their sources and its paper's figures."""

import json

import pytest

import relnav


def test_the_list(run):
    code, out, err = run("models")
    assert (code, err) == (0, "")
    for name in relnav.list_models():
        assert any(line.startswith(f"{name} ") for line in out.splitlines())


@pytest.mark.parametrize("name", relnav.list_models())
def test_one_model_with_its_sources(run, name):
    code, out, err = run("models", name)
    assert (code, err) == (0, "")
    assert "  sensor." in out or "  camera." in out
    assert ("published " in out) == bool(relnav.load_published(name).claims)
    assert "unstated: " not in out
    if name.startswith("three_beacon_psd"):
        assert "sensor.focal_length_mm" in out
        assert "= 50.0" in out
        assert "assumed: the paper gives none" in out
        assert "paper: Table 1, active area" in out
        assert "published range: 0.02 m" in out


def test_as_json(run, tmp_path):
    path = tmp_path / "model.json"
    assert run("models", "three_beacon_psd", "--json", path, "--quiet") == (0, "", "")
    shown = json.loads(path.read_text())
    assert shown["values"]["sensor.focal_length_mm"]["value"] == 50.0
    assert shown["values"]["sensor.focal_length_mm"]["source"].startswith("assumed: ")
    assert [claim["quantity"] for claim in shown["published"]] == ["range", "azimuth", "elevation"]


def test_the_list_as_json(run, tmp_path):
    path = tmp_path / "models.json"
    assert run("models", "--json", path, "--quiet") == (0, "", "")
    assert list(json.loads(path.read_text())["models"]) == relnav.list_models()


@pytest.mark.parametrize("arguments", [[], ["models"], ["filter"]])
@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_shows_an_example(run, arguments, flag):
    code, out, err = run(*arguments, flag)
    assert (code, err) == (0, "")
    assert "Example: relnav " in out


def test_every_command_has_help_with_an_example(run):
    from relnav.cli import COMMANDS

    listed = run("--help")[1]
    for name in COMMANDS:
        assert f"  {name} " in listed
        code, out, _ = run(name, "--help")
        assert code == 0
        assert f"Example: relnav {name} " in out


def test_version(run):
    from importlib.metadata import version

    code, out, _ = run("--version")
    assert code == 0
    assert version("relnav") in out


def test_without_a_command_the_help_is_shown(run):
    code, out, err = run()
    assert code == 2
    assert "Usage: relnav" in out + err


def test_a_schema_for_editors(run, tmp_path):
    out = tmp_path / "beacons.schema.json"
    code, said, _ = run("models", "three_beacon_psd", "--schema", out)
    assert code == 0
    assert f"#:schema {out}" in said
    schema = json.loads(out.read_text())
    assert schema["properties"]["sensor_type"] == {"const": "three_beacon"}
    assert "focal_length_mm" in schema["properties"]["sensor"]["properties"]
    assert run("models", "--schema", out)[0] == 2
