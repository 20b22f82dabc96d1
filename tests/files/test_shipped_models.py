"""The shipped models: complete, with a source for every value, and with the geometry that their names promise."""

import dataclasses
import tomllib

import numpy as np
import pytest

import relnav
from relnav.files.model_folders import find_model, models_root

NAMES = ["three_beacon_psd", "three_beacon_psd_rbar"]


def test_both_are_listed():
    assert set(NAMES) <= set(relnav.list_models())


@pytest.mark.parametrize("name", relnav.list_models())
def test_every_value_has_its_source(name):
    table = tomllib.loads(find_model(name).read_text(encoding="utf-8"))
    model = relnav.load_model(name)
    if name == "rendezvous_demo":
        table |= {f"sensor.{sensor}": entries for sensor, entries in table.pop("sensor").items()}
    keys = [f"{section}.{key}" for section, entries in table.items() if isinstance(entries, dict) for key in entries]
    assert len(keys) >= (19 if name in NAMES else 10)
    for key in keys:
        source, _, why = model.provenance[key].partition(": ")
        assert source in ("paper", "assumed", "derived"), key
        assert len(why) > 10, key


@pytest.mark.parametrize("name", NAMES)
def test_no_value_is_left_to_a_default(name):
    """What a shipped mission uses stands in its file."""
    table = tomllib.loads(find_model(name).read_text(encoding="utf-8"))
    model = relnav.load_model(name)
    for section in dataclasses.fields(model):
        value = getattr(model, section.name)
        if dataclasses.is_dataclass(value):
            used = [field.name for field in dataclasses.fields(value) if getattr(value, field.name) not in ((), None)]
            assert len(table[section.name]) == len(used), section.name


@pytest.mark.parametrize("name", NAMES)
def test_published_claims_are_complete(name):
    claims = {claim.quantity: claim for claim in relnav.load_published(name).claims}
    assert {quantity: (claim.value, claim.unit) for quantity, claim in claims.items()} == {
        "range": (0.02, "m"),
        "azimuth": (0.176, "deg"),
        "elevation": (0.182, "deg"),
    }
    for claim in claims.values():
        for field in dataclasses.fields(claim):
            assert getattr(claim, field.name) not in ("", None), (claim.quantity, field.name)
        assert claim.expected in ("met", "not met")


@pytest.mark.parametrize("name", NAMES)
def test_claims_can_be_asked_for_by_model(name):
    assert relnav.load_published(relnav.load_model(name)) == relnav.load_published(name)


@pytest.mark.parametrize("name", NAMES)
def test_every_exception_to_a_claim_gives_its_reason(name):
    for entry in relnav.load_published(name).exceptions:
        assert entry.quantity in ("all", "range", "azimuth", "elevation")
        assert len(entry.reason) > 10


@pytest.mark.parametrize(("name", "columns"), [(NAMES[0], np.eye(3)), (NAMES[1], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])])
def test_docking_frames(name, columns):
    """V-bar: identity. R-bar: x_dock = +z, y_dock = +y, z_dock = -x of lvlh_ccsds."""
    np.testing.assert_allclose(relnav.load_model(name).dcm_dock_from_lvlh, columns, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_camera_looks_along_minus_x_dock(name):
    """Cam x = -y_dock, cam y = +z_dock, cam z = -x_dock."""
    model = relnav.load_model(name)
    turn = model.dcm_cam_from_lvlh @ model.dcm_dock_from_lvlh.T
    np.testing.assert_allclose(turn, [[0, -1, 0], [0, 0, 1], [-1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_values_in_si(name):
    model = relnav.load_model(name)
    sensor = model.sensor
    assert (sensor.focal_length_m, sensor.detector_size_m, sensor.spot_noise_m) == (0.05, (0.008, 0.008), 1e-5)
    assert sensor.beacon_c_distance_m == pytest.approx(np.sqrt(3.0) * sensor.beacon_half_spacing_m, rel=1e-15)
    assert model.orbit.mean_motion_rad_s == pytest.approx(np.sqrt(3.986004418e14 / 6778137.0**3), rel=1e-12)
    assert model.process_noise.control_direction_sigma_rad == pytest.approx(np.radians(0.5), rel=1e-15)
    assert model.process_noise.acceleration_noise_density_m2_s3 == 1e-10
    assert model.name == name


def test_the_process_noise_is_the_same_for_every_log():
    vbar, rbar = (relnav.load_model(name) for name in NAMES)
    assert vbar.process_noise == rbar.process_noise
    assert vbar.filter == rbar.filter
    assert vbar.sensor == rbar.sensor


def test_a_model_is_found_by_name_folder_and_file():
    folder = models_root() / NAMES[0]
    by_name = relnav.load_model(NAMES[0])
    assert relnav.load_model(folder) == by_name
    assert relnav.load_model(str(folder)) == by_name
    assert relnav.load_model(folder / "model.toml") == by_name


def test_a_model_without_published_figures_has_no_claims(write_model):
    assert relnav.load_published(write_model()).claims == ()
