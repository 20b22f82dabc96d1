"""The shipped vehicle file, and what is said of one that cannot be used: file, line, key, what to write."""

import re

import numpy as np
import pytest

import relnav
from relnav.files.model_folders import find_model

NAME = "rendezvous_demo"
MARKERS = 'model = { value = "three_marker_vision"'

# name: (text in the file, what stands there instead, key, rest of the message)
LEVER = "lever_sigma_mm = { value = 0.3"
FOCAL = 'focal_role = { value = "estimated"'
POSITION = "position_m = { value = [0.9, -0.25, 0.0]"
FIRST = "first_s = { value = 0.03"
CASES = {
    "a rate of zero": ("rate_hz = { value = 5.0", "rate_hz = { value = 0.0", "sensor.camera.rate_hz", "greater than 0"),
    "misspelt": (
        LEVER,
        LEVER.replace("sigma", "sigm"),
        "sensor.camera.lever_sigm_mm",
        "did you mean 'lever_sigma_mm'?",
    ),
    "another unit": (
        "random_walk_deg_sqrt_h",
        "random_walk_deg_s",
        "gyro.random_walk_deg_s",
        "write one of random_walk_rad_sqrt_s",
    ),
    "a role": (
        FOCAL,
        FOCAL.replace("estimated", "ignored"),
        "sensor.camera.focal_role",
        "'estimated' or 'considered'; got 'ignored'",
    ),
    "no such model": (
        MARKERS,
        MARKERS.replace("vision", "visoin"),
        "sensor.camera.model",
        "no model 'three_marker_visoin'",
    ),
    "thrusters that give nothing": (
        "largest_m_s2 = { value = 0.02",
        "largest_m_s2 = { value = 0.0",
        "thrust.largest_m_s2",
        "greater than 0",
    ),
    "a time that is none": ("lasts_s = { value = 10.0", "lasts_s = { value = -1.0", "thrust.lasts_s", "greater than 0"),
    "a section": ("[hand_over]", "[handover]", "handover", "did you mean [hand_over]?"),
}
LATE = {
    "a clock": ("2026-03-20T12:00:00Z", "yesterday", "epoch_utc is a date with its zone"),
    "a star sensor with a lens": (
        FIRST,
        f"position_m = [1.0, 0.0, 0.0]\n{FIRST}",
        "sensor.star.position_m: model dual_field_star sees no lights",
    ),
    "a camera that is nowhere": (POSITION, "#", "sensor.camera: model three_marker_vision sees lights; position_m"),
    "a star sensor without noise": ("noise_rad = { value", "#", "sensor.star.noise_rad is needed"),
    "no attitude": (
        "q_sensor_from_chaser = { value = [0.0, 0.0, 0.0, 1.0]",
        "q_sensor_from_chaser = { value = [0.0, 0.0, 0.0, 2.0]",
        "sensor.star.q_sensor_from_chaser: a rotation quaternion (x, y, z, w) has norm 1",
    ),
    "a taken name": ("[sensor.camera]", "[sensor.gyro]", "sensor.gyro: this name is taken"),
    "a star camera with lights": (MARKERS, MARKERS.replace("three_marker_vision", "ground_camera"), "sees no lights"),
}


@pytest.fixture
def write(tmp_path):
    text = find_model(NAME).read_text(encoding="utf-8")

    def change(old, new):
        assert old in text
        path = tmp_path / "model.toml"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return path

    return change


def test_what_it_holds():
    vehicle = relnav.load_model(NAME)
    assert list(vehicle.sensor) == ["camera", "psd", "star", "sun_aps", "sun_birefringent"]
    assert [vehicle.kind(name) for name in vehicle.sensor] == ["points", "points", "star", "sun", "sun"]
    assert vehicle.gyro.random_walk_rad_sqrt_s == pytest.approx(np.radians(0.01) / 60.0, rel=1e-12)
    assert vehicle.sensor["camera"].mount_sigma_rad == 1e-4
    assert vehicle.points_m("psd").shape == (6, 3)
    assert vehicle.models["star"].name == "dual_field_star"
    np.testing.assert_allclose(vehicle.start_position_m, [32.7, 0.0, 0.0], atol=1e-12)
    assert vehicle.provenance["sensor.camera.rate_hz"].startswith("assumed: ")


def test_both_point_at_each_other():
    """At a metre both sensors of lights have the lights before them, centred on the line of sight."""
    vehicle = relnav.load_model(NAME)
    chaser = vehicle.start_position_m - [29.0, 0.0, 0.0]
    for name in ("camera", "psd"):
        mounted = vehicle.sensor[name]
        lens = chaser + vehicle.chaser.dcm_chaser_from_lvlh.T @ mounted.position_m
        seen = (vehicle.points_m(name) - lens) @ (
            mounted.dcm_sensor_from_chaser @ vehicle.chaser.dcm_chaser_from_lvlh
        ).T
        assert (seen[:, 2] > 0.9).all()
        assert abs((seen[:, 0] / seen[:, 2])[:2].mean()) < 0.01, name


def test_the_sun_is_in_view():
    from relnav.vehicle.navigator import VehicleNavigator

    nav = VehicleNavigator(relnav.load_model(NAME))
    for name in ("sun_aps", "sun_birefringent"):
        sensor = nav._filters.sensors[name]
        for t in (0.0, 200.0, 400.0):
            C_BI = nav.vehicle.chaser.dcm_chaser_from_lvlh @ nav._filters.frame.dcm_lvlh_from_inertial(t)
            direction = nav.vehicle.sensor[name].dcm_sensor_from_chaser @ C_BI @ sensor.sun(t)
            assert direction[2] > np.cos(np.radians(50.0))


@pytest.mark.parametrize("name", CASES)
def test_a_wrong_value(write, name):
    old, new, key, text = CASES[name]
    path = write(old, new)
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(path)
    message = str(caught.value)
    place = re.search(rf"model\.toml:(\d+): {re.escape(key)}: ", message)
    assert place, message
    line = path.read_text().splitlines()[int(place[1]) - 1]
    assert key.rpartition(".")[2] in line, line
    assert text in message


@pytest.mark.parametrize("name", LATE)
def test_what_does_not_fit_together(write, name):
    old, new, text = LATE[name]
    path = write(old, new)
    with pytest.raises(relnav.ModelError, match=re.escape(text)):
        relnav.load_model(path)


def test_a_sensor_that_is_no_section(write):
    path = write("[sensor.camera]", "[sensor]\ncamera = 3\n[sensor.other]")
    with pytest.raises(relnav.ModelError, match=re.escape("written [sensor.NAME]")):
        relnav.load_model(path)


def test_a_vehicle_without_sensors(tmp_path):
    text = find_model(NAME).read_text(encoding="utf-8")
    assert not re.search(r"^\[(?!sensor\.)", text[text.index("[sensor.") :], re.MULTILINE), "sensors stand last"
    path = tmp_path / "model.toml"
    path.write_text(text[: text.index("[sensor.")], encoding="utf-8")
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(path)
    assert str(caught.value) == f"{path}: a vehicle has sensors: write one section [sensor.NAME] for each"


def test_a_vehicle_without_a_section(tmp_path):
    """One sentence, with the keys that have no default."""
    text = find_model(NAME).read_text(encoding="utf-8")
    path = tmp_path / "model.toml"
    path.write_text(re.sub(r"\[gyro\].*?(?=\n\[)", "", text, count=1, flags=re.DOTALL), encoding="utf-8")
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(path)
    assert str(caught.value).startswith(f"{path}:1: gyro: the section is missing; write [gyro] with rate_hz, ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("itself", [".", "model.toml", "rendezvous_demo"])
def test_a_vehicle_is_no_sensor(write, itself):
    """One that named itself was loaded again and again, without end."""
    path = write(MARKERS, MARKERS.replace("three_marker_vision", itself))
    with pytest.raises(relnav.ModelError, match=f"a sensor's model is expected; '{re.escape(itself)}' is a vehicle's"):
        relnav.load_model(path)


def test_a_change_by_key():
    changed = relnav.load_model(NAME, changes={"sensor.camera.rate_hz": 2.0, "bias_sigma_rad_s": 1e-5})
    assert changed.sensor["camera"].rate_hz == 2.0
    assert changed.gyro.bias_sigma_rad_s == 1e-5


def test_a_model_of_your_own_beside_the_file(write, tmp_path):
    own = find_model("three_marker_vision").read_text(encoding="utf-8")
    noise = "spot_noise_px = { value = 0.1"
    assert own.count(noise) == 1
    (tmp_path / "sharp.toml").write_text(own.replace(noise, noise.replace("0.1", "0.05")), encoding="utf-8")
    vehicle = relnav.load_model(write(MARKERS, MARKERS.replace("three_marker_vision", "sharp.toml")))
    assert vehicle.models["camera"].camera.spot_noise_px == 0.05
