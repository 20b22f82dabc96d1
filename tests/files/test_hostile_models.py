"""Model files that are hostile, absurd or a slip of unit: one short sentence each, at once."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.errors import ModelError
from relnav.files.model_folders import sensor_type
from relnav.files.models import load_model, model_values
from relnav.simulation.orbits import EARTH_RADIUS_M

HOSTILE = {
    "type is an array": "sensor_type = []",
    "type is a table": "sensor_type = {a = 1}",
    "nested arrays": "a = " + "[" * 20_000 + "]" * 20_000,
    "nested a little": 'sensor_type = "three_beacon"\n[sensor]\nfocal_length_mm = ' + "[" * 60 + "]" * 60,
    "a number of 5000 digits": "sensor_type = " + "9" * 5000,
    "the same in hexadecimal": 'sensor_type = "three_beacon"\n[sensor]\nfocal_length_mm = 0x' + "f" * 5000,
    "20000 keys": 'sensor_type = "three_beacon"\n[sensor]\n'
    + "".join(f"focal_lngth_{k}_mm = 1\n" for k in range(8000)),
    "20000 sections": 'sensor_type = "three_beacon"\n' + "".join(f"[senso{k}]\n" for k in range(8000)),
    "a dotted key without end": ".".join("a" * 50_000) + " = 1",
    "longer than any model": "# " + "x" * 300_000,
    "control characters": 'sensor_type = "\\u001b[31m\\nrelnav: all is well"',
    "control characters in a key": '"\\u001b[31m" = 1\nsensor_type = "three_beacon"',
    "huge whole numbers": 'sensor_type = "three_beacon"\n[orbit]\nmean_motion_deg_s = 1' + "0" * 400,
    "not text": b"\xff\xfe\x00",
    "null character": "sensor_type = 'three_beacon'\n\x00",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_its_type_is_read_without_the_rest(tmp_path, name):
    """Before anything is loaded: a nested file ended in an internal error of the command here."""
    path = tmp_path / "model.toml"
    path.write_bytes(HOSTILE[name] if isinstance(HOSTILE[name], bytes) else HOSTILE[name].encode())
    assert sensor_type(path) in ("", "three_beacon")


@pytest.mark.parametrize("name", HOSTILE)
def test_one_sentence_at_once(tmp_path, name):
    path = tmp_path / "model.toml"
    path.write_bytes(HOSTILE[name] if isinstance(HOSTILE[name], bytes) else HOSTILE[name].encode())
    begin = time.process_time()
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(path)
    message = str(caught.value)
    assert time.process_time() - begin < 5.0
    assert len(message) < 30_000
    assert message.count("\n") <= 21
    assert all(line.startswith(str(path)) and line.isprintable() for line in message.splitlines())


MEAN_MOTION = "mean_motion_rad_s = { value = 0.0011313666536110223,"
NOISE = "spot_noise_um = { value = 10.0,"
FOCAL = "focal_length_mm = { value = 50.0,"
LOOK = "q_cam_from_lvlh = { value = [0.5, -0.5, -0.5, -0.5],"
SLIPS = {
    "deg/s for rad/s": (MEAN_MOTION, "mean_motion_rad_s = { value = 0.0648,", "write mean_motion_deg_s"),
    "revolutions a day": (MEAN_MOTION, "mean_motion_rad_s = { value = 15.54,", "revolutions a day"),
    "above any orbit": (MEAN_MOTION, "mean_motion_rad_s = { value = 1e300,", "above any orbit's of the Earth"),
    "noise in mm": (NOISE, "spot_noise_mm = { value = 10.0,", "noise of 0.01 m on a detector of 0.008 m says nothing"),
    "focal length in m": (FOCAL, "focal_length_m = { value = 50.0,", "are both units right?"),
    "focal length in um": (FOCAL, "focal_length_um = { value = 50.0,", "are both units right?"),
    "a port at the Moon": (
        "port_position_m = { value = [0.0, 0.0, 0.0],",
        "port_position_km = { value = [4e5, 0, 0],",
        "4e+08 m",
    ),
    "a lever arm in the wrong unit": (
        "[camera]\nposition_m = { value = [0.0, 0.0, 0.0],",
        "[camera]\nposition_km = { value = [0, 0, -2.5],",
        "up to 1000 m is credible",
    ),
    "beacons in km": ("beacon_half_spacing_m = { value = 0.3,", "beacon_half_spacing_km = { value = 3.0,", "3000 m"),
    "a detector of 8 km": (
        "detector_size_mm = { value = [8.0, 8.0],",
        "detector_size_mm = { value = [8.0, 8e6],",
        "8000 m",
    ),
    "an attitude of 720 deg": ("sigma_deg = { value = 0.15,", "sigma_deg = { value = 720.0,", "up to 3.142 rad"),
    "a start at a shell's speed": (
        "initial_velocity_sigma_m_s = { value = 0.1,",
        "initial_velocity_sigma_m_s = { value = 2000.0,",
        "up to 1000 m/s is credible",
    ),
    "an image a day late": ("longest_delay_s = { value = 0.0,", "longest_delay_s = { value = 86400.0,", "up to 3600 s"),
    "a drive of noise": (
        "acceleration_noise_density_m2_s3 = { value = 1e-10,",
        "acceleration_noise_density_m2_s3 = { value = 1e6,",
        "up to 100 m^2/s^3 is credible",
    ),
    "looks away": (LOOK, "q_cam_from_lvlh = { value = [0.0, 0.0, 0.0, 1.0],", ""),
    "scalar first": (LOOK, "q_cam_from_lvlh = { value = [-0.5, 0.5, -0.5, -0.5],", "scalar first: write x, y, z, w"),
}


@pytest.mark.parametrize("name", SLIPS)
def test_what_no_mission_has(write_model, name):
    old, new, text = SLIPS[name]
    with pytest.raises(relnav.ModelError) as caught:
        relnav.load_model(write_model((old, new)))
    if name == "looks away":
        text = "the camera looks away from the target"
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("model", "changes", "text"),
    [
        ("three_beacon_psd", {"attitude.noise_deg": 170.0}, "up to 0.2 rad is credible"),
        ("three_beacon_psd", {"camera_mounting_sigma_deg": 300.0}, "up to 0.2 rad is credible"),
        ("three_beacon_psd", {"beacon_mounting_sigma_deg": 300.0}, "up to 0.2 rad is credible"),
        ("three_beacon_psd", {"beacon_placement_sigma_m": 5.0}, "up to 0.3 m is credible"),
        ("three_beacon_psd", {"focal_length_relative_sigma": 3.0}, "up to 0.2 of it is credible"),
        ("three_beacon_psd", {"extra_beacons_m": [[0.0, 0.3, 0.0]]}, "two beacons stand at"),
        ("three_marker_vision", {"principal_point_px": [9000.0, 500.0]}, "along x lies outside the image"),
        ("three_marker_vision", {"principal_point_px": [500.0, -4000.0]}, "along y lies outside the image"),
        (
            "three_marker_vision",
            {"positions_m": [[0.0, 0.3, 0.3], [0.0, -0.3, 0.3], [0.3, 0.0, 0.0], [0.0, 0.3, 0.3]]},
            "two markers stand at",
        ),
        (
            "three_marker_vision",
            {"inertia_kg_m2": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 5.0]]},
            "none exceeds the sum of the others",
        ),
    ],
)
def test_what_no_sensor_has(model, changes, text):
    with pytest.raises(relnav.ModelError, match=text) as caught:
        relnav.load_model(model, changes)
    assert "\n" not in str(caught.value)


def test_unusual_missions_are_flown(write_model):
    """A lens of 3 m on 8 mm, an orbit at 150 km, a camera 80 deg off: odd, but possible."""
    relnav.load_model(write_model((FOCAL, "focal_length_m = { value = 3.0,")))
    relnav.load_model(write_model((MEAN_MOTION, "mean_motion_rad_s = { value = 0.0012,")))


def test_an_altitude_instead_of_a_mean_motion(write_model):
    path = write_model((MEAN_MOTION, "altitude_km = { value = 500.0,"))
    model = relnav.load_model(path)
    n = np.sqrt(MU_EARTH_M3_S2 / (EARTH_RADIUS_M + 500e3) ** 3)
    assert model.orbit.mean_motion_rad_s == pytest.approx(n, rel=1e-14)
    assert "altitude_km = 500" in model.provenance["orbit.mean_motion_rad_s"]


@pytest.mark.parametrize(
    ("new", "text"),
    [
        ("altitude_km = -7000.0 #", "perigee lies"),
        ("altitude_m = 400.0 #", "0.4 km high, in the air; km or m?"),
        ('altitude_km = "low" #', "altitude_km = 400.0"),
        ("altitude_deg = 400.0 #", "altitude_km = 400.0"),
        ("altitude = 400.0 #", "altitude_km = 400.0"),
        ("altitude_km = 400.0\nmean_motion_rad_s = 0.001 #", "say the same; keep one"),
    ],
)
def test_an_altitude_that_is_none(write_model, new, text):
    with pytest.raises(relnav.ModelError, match=text) as caught:
        relnav.load_model(write_model((MEAN_MOTION, new)))
    assert "\n" not in str(caught.value)


def test_an_eccentric_orbit_by_altitude(write_model):
    eccentric = ("eccentricity = { value = 0.0,", "eccentricity = { value = 0.1,")
    model = relnav.load_model(write_model((MEAN_MOTION, "altitude_km = { value = 1000.0,"), eccentric))
    assert model.orbit.eccentricity == 0.1
    with pytest.raises(relnav.ModelError, match="perigee lies 278 km below the ground"):
        relnav.load_model(write_model((MEAN_MOTION, "altitude_km = { value = 400.0,"), eccentric))


class TestCalibrationPaths:
    """A model from somebody else names a file: it reads no other folder, and no device."""

    CALIBRATION = "[calibration]\norder = 0\ncenter_um = [0.0, 0.0]\nhalf_width_um = [1.0, 1.0]\n"

    def load(self, write_model, name):
        path = write_model(("[tolerances]", f'[calibration]\nfile = "{name}"\n\n[tolerances]'))
        with pytest.raises(relnav.ModelError) as caught:
            relnav.load_model(path)
        return str(caught.value)

    def test_outside(self, write_model, tmp_path, monkeypatch):
        (tmp_path / "other.toml").write_text("secret = 1\n")
        message = self.load(write_model, "../other.toml")
        assert "lies outside the model's folder" in message
        assert "secret" not in message
        assert "lies outside" in self.load(write_model, tmp_path / "other.toml")
        monkeypatch.setenv("RELNAV_CALIBRATION_ANYWHERE", "1")
        assert "secret: unknown section" in self.load(write_model, "../other.toml")

    @pytest.mark.skipif(not hasattr(os, "symlink"), reason="no symbolic links on this system")
    def test_links(self, write_model, tmp_path):
        folder = Path(write_model()).parent
        (tmp_path / "other.toml").write_text("secret = 1\n")
        (folder / "c.toml").symlink_to(tmp_path / "other.toml")
        assert "lies outside" in self.load(write_model, "c.toml")
        (folder / "loop.toml").symlink_to(folder / "loop.toml")
        assert "\n" not in self.load(write_model, "loop.toml")

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
    def test_no_pipes_or_folders(self, write_model):
        folder = Path(write_model()).parent
        os.mkfifo(folder / "pipe")
        (folder / "sub").mkdir()
        assert "is no regular file" in self.load(write_model, "pipe")
        assert "is no regular file" in self.load(write_model, "sub")


class TestWhatMayBeLeftOut:
    """Process noise and initial velocity have defaults, which are shown with their reasons."""

    def test_it_is_what_the_shipped_model_says(self, write_model, shipped_text):
        lines = shipped_text.splitlines(keepends=True)
        noise = next(line for line in lines if line.startswith("acceleration_noise_density"))
        speed = next(line for line in lines if line.startswith("initial_velocity_sigma"))
        path = write_model((noise, ""), (speed, ""))
        model, shipped = load_model(path), load_model("three_beacon_psd")
        assert (model.process_noise, model.filter) == (shipped.process_noise, shipped.filter)
        assert "left out" in model.provenance["filter.initial_velocity_sigma_m_s"]
        assert model_values(model)["filter.initial_velocity_sigma_m_s"]["value"] == 0.1

    def test_another_unit_counts_as_given(self, write_model, shipped_text):
        speed = next(line for line in shipped_text.splitlines() if line.startswith("initial_velocity_sigma"))
        assert (
            load_model(write_model((speed, "initial_velocity_sigma_mm_s = 50.0"))).filter.initial_velocity_sigma_m_s
            == 0.05
        )

    def test_a_whole_section(self, write_model, shipped_text):
        begin, end = shipped_text.index("[filter]"), shipped_text.index("[detector]")
        assert load_model(write_model((shipped_text[begin:end], ""))).filter.initial_velocity_sigma_m_s == 0.1


def test_a_model_in_the_current_folder_has_a_name(write_model, monkeypatch):
    monkeypatch.chdir(write_model().parent)
    assert load_model("model.toml").name == load_model(".").name == "mine"


def test_a_long_file_is_not_called_a_long_number(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text("a = 1\n" * 40_000)
    with pytest.raises(ModelError, match=r"model\.toml: longer than 200000 characters") as error:
        load_model(path)
    assert "number" not in str(error.value)
