"""A model that cannot be used is refused with file, line, key, what came, what is expected and what to write."""

import re

import pytest

import relnav

FOCAL = 'focal_length_mm = { value = 50.0, source = "assumed"'
ECCENTRICITY = 'eccentricity = { value = 0.0, source = "assumed"'

# name: (text in the shipped file, what stands there instead, key in the message, rest of the message)
CASES = {
    "f = 0": (FOCAL, FOCAL.replace("50.0", "0.0"), "focal_length_mm", "greater than 0; got 0.0"),
    "f < 0": (FOCAL, FOCAL.replace("50.0", "-50.0"), "focal_length_mm", "greater than 0; got -50.0"),
    "f text": (FOCAL, FOCAL.replace("50.0", '"50 mm"'), "focal_length_mm", "valid number; got '50 mm'"),
    "f true": (FOCAL, FOCAL.replace("50.0", "true"), "focal_length_mm", "valid number; got True"),
    "f NaN": (FOCAL, FOCAL.replace("50.0", "nan"), "focal_length_mm", "a finite number is expected; got nan"),
    "f infinite": (FOCAL, FOCAL.replace("50.0", "inf"), "focal_length_mm", "a finite number is expected; got inf"),
    "misspelt": (FOCAL, FOCAL.replace("focal_", "foccal_"), "foccal_length_mm", "did you mean 'focal_length_mm'?"),
    "unit of another kind": (
        FOCAL,
        FOCAL.replace("_mm", "_deg"),
        "focal_length_deg",
        "unit 'deg' does not fit; write one of focal_length_um, focal_length_mm, focal_length_cm, focal_length_m",
    ),
    "no unit": (FOCAL, FOCAL.replace("_mm", ""), "focal_length", "the unit is missing from the key; write one of"),
    "unknown unit": (FOCAL, FOCAL.replace("_mm", "_inch"), "focal_length_inch", "did you mean 'focal_length_m'?"),
    "quite another key": (FOCAL, "colour = 3\n" + FOCAL, "colour", "unknown key; known keys are focal_length_m, "),
    "given twice": (
        FOCAL,
        "focal_length_m = 0.05\n" + FOCAL,
        "focal_length_mm",
        "the same quantity is given as 'focal_length_m' too; keep one",
    ),
    "no source": (FOCAL, FOCAL.replace("source =", "origin ="), "focal_length_mm", 'source = "paper|'),
    "unknown source": (FOCAL, FOCAL.replace("assumed", "guessed"), "focal_length_mm", "a value with its source is"),
    "three sizes": ("value = [8.0, 8.0]", "value = [8.0, 8.0, 8.0]", "detector_size_mm", "2 values are expected"),
    "one size": ("value = [8.0, 8.0]", "value = [8.0]", "detector_size_mm", "2 values are expected; got [8.0]"),
    "size zero": ("value = [8.0, 8.0]", "value = [8.0, 0.0]", "detector_size_mm", "greater than 0"),
    "projection": ('value = "perspective"', 'value = "central"', "projection", "'perspective' or 'parallel'"),
    "mode": ('value = "lvlh_hold"', 'value = "free"', "mode", "'lvlh_hold' or 'unknown'; got 'free'"),
    "open orbit": (ECCENTRICITY, ECCENTRICITY.replace("0.0", "1.0"), "eccentricity", "less than 1; got 1.0"),
    "probability 1": ("value = 0.9999", "value = 1.0", "gate_probability", "less than 1; got 1.0"),
    "half an epoch": ("value = 3, source", "value = 2.5, source", "restart_after_epochs", "integer; got 2.5"),
    "no patience": ("value = 3, source", "value = 0, source", "restart_after_epochs", "greater than or equal to 1"),
    "negative noise": ("value = 1e-10", "value = -1e-10", "acceleration_noise_density_m2_s3", "equal to 0; got -1e-10"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_wrong_value(write_model, name):
    old, new, key, text = CASES[name]
    path = write_model((old, new))
    number = next(k for k, line in enumerate(path.read_text().splitlines(), start=1) if line.startswith(f"{key} ="))
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(path)
    message = str(caught.value)
    assert re.match(rf"{re.escape(str(path))}:{number}: [a-z_]+\.{key}: ", message), message
    assert text in message
    assert "\n" not in message, "one mistake is one line"


def test_a_quaternion_that_is_none(write_model):
    path = write_model(("value = [0.5, -0.5, -0.5, -0.5]", "value = [1.0, 1.0, 0.0, 0.0]"))
    with pytest.raises(relnav.ModelError, match=r":\d+: attitude: q_cam_from_lvlh is a unit quaternion.*norm is 1.414"):
        relnav.load_model(path)


def test_a_missing_value_is_named_with_its_section(write_model, line_of):
    path = write_model(("focal_length_mm = {", "# focal_length_mm = {"))
    section = line_of("[sensor]")
    with pytest.raises(relnav.ModelError, match=rf":{section}: sensor: 'focal_length_m' is missing"):
        relnav.load_model(path)


def test_a_missing_section(write_model):
    path = write_model(("[orbit]", "[orbits]"))
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(path)
    assert "orbits: unknown section; did you mean [orbit]?" in str(caught.value)
    assert "'mean_motion_rad_s' is missing" in str(caught.value)


def test_all_mistakes_are_told_at_once(write_model):
    path = write_model((FOCAL, FOCAL.replace("50.0", "0.0")), (ECCENTRICITY, ECCENTRICITY.replace("0.0", "2.0")))
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(path)
    first, second = str(caught.value).splitlines()
    assert "focal_length_mm" in first
    assert "eccentricity" in second


def test_a_lever_arm_needs_an_attitude(write_model):
    path = write_model(
        ('value = "lvlh_hold"', 'value = "unknown"'),
        (
            'position_m = { value = [0.0, 0.0, 0.0], source = "assumed", why = "lens',
            'position_m = { value = [1.0, 0.0, 0.0], source = "assumed", why = "lens',
        ),
    )
    with pytest.raises(relnav.ModelError, match=r"model.toml: camera.position_m must be zero with attitude mode"):
        relnav.load_model(path)


def test_an_unknown_sensor_type(write_model):
    path = write_model(('sensor_type = "three_beacon"', 'sensor_type = "sextant"'))
    with pytest.raises(relnav.ModelError, match=r":5: sensor_type: one of three_beacon.* is expected; got 'sextant'"):
        relnav.load_model(path)


def test_a_section_that_is_a_value(write_model):
    path = write_model(("[orbit]\n", "[spare]\n"), ("title =", "orbit = 3\ntitle ="))
    with pytest.raises(relnav.ModelError, match=r"orbit: a table is expected, written \[orbit\]; got 3"):
        relnav.load_model(path)


def test_not_toml(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text("[sensor\nfocal_length_mm = 50\n")
    with pytest.raises(relnav.ModelError, match=r"model.toml: not valid TOML: .*line 1"):
        relnav.load_model(path)


def test_not_text(tmp_path):
    path = tmp_path / "model.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(relnav.ModelError, match="not a text file in UTF-8"):
        relnav.load_model(path)


def test_an_empty_file(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text("")
    with pytest.raises(relnav.ModelError, match=r"sensor_type: one of three_beacon.* is expected; got None"):
        relnav.load_model(path)


def test_an_unknown_name():
    with pytest.raises(relnav.UsageError, match=r"no model 'three_beacon_pds'.*did you mean 'three_beacon_psd'?"):
        relnav.load_model("three_beacon_pds")
    with pytest.raises(relnav.ModelError, match=r"no model 'x'.*shipped models are .*three_beacon_psd"):
        relnav.load_model("x")


def test_an_unknown_section_of_claims(write_model):
    path = write_model()
    path.with_name("published.toml").write_text('[[clame]]\nquantity = "range"\n')
    with pytest.raises(relnav.ModelError, match=r"clame: unknown section; known sections are \[\[claim\]\]"):
        relnav.load_published(path)


@pytest.mark.parametrize("name", ["claim", "exception"])
@pytest.mark.parametrize("value", ["3", "{}"])
def test_claims_that_are_no_list(write_model, name, value):
    path = write_model()
    path.with_name("published.toml").write_text(f"{name} = {value}\n")
    with pytest.raises(relnav.ModelError, match=rf"{name}: \[\[{name}\]\] is expected, one for each; got"):
        relnav.load_published(path)


def test_an_incomplete_claim_does_not_load(write_model):
    path = write_model()
    claims = path.with_name("published.toml")
    claims.write_text('[[claim]]\nquantity = "range"\nvalue = 0.02\nunit = "m"\nexpected = "met"\n')
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_published(path)
    for missing in ("statistic", "condition", "page", "reason"):
        assert f"'{missing}' is missing" in str(caught.value)
    assert str(claims) in str(caught.value)


def test_a_claim_in_another_unit_does_not_load(write_model):
    path = write_model()
    rest = "".join(f'{key} = "s"\n' for key in ("statistic", "condition", "page", "reason"))
    text = f'[[claim]]\nquantity = "range"\nvalue = 2\nunit = "cm"\nexpected = "met"\n{rest}'
    path.with_name("published.toml").write_text(text)
    with pytest.raises(relnav.ModelError, match=r"unit: input should be 'm', 'rad', .*; got 'cm'"):
        relnav.load_published(path)
