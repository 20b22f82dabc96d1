"""Star sensors and vehicles with a slip of unit: refused with the likely reason, at the line."""

import pytest

import relnav
from relnav.files.model_folders import models_root

SLIPS = {
    "focal length in mm": ("dual_field_star", "focal_length_px", "62.5", "millimetres? divide by the pixel's size"),
    "noise of the detector": ("dual_field_star", "spot_noise_px", "4096.0", "noise of 4096 px on 2048 px says nothing"),
    "deg/s for rad/s": ("rendezvous_demo", "mean_motion_rad_s", "0.0648", "write mean_motion_deg_s"),
}


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_of_unit(tmp_path, name):
    model, key, value, text = SLIPS[name]
    lines = (models_root() / model / "model.toml").read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith(f"{key} ="))
    lines[at] = f"{key} = {value}"
    path = tmp_path / "model.toml"
    path.write_text("\n".join(lines))
    with pytest.raises(relnav.ModelError, match=r"model\.toml") as caught:
        relnav.load_model(path)
    assert text in str(caught.value)
    assert f"model.toml:{at + 1}:" in str(caught.value)


@pytest.mark.parametrize("key", ["noise_rad", "mount_sigma_rad"])
def test_a_mounting_in_another_unit(key):
    value = [10.0, 10.0, 60.0] if key == "noise_rad" else 0.5
    with pytest.raises(relnav.ModelError, match=rf"sensor\.star\.{key}.*arcsec, mrad or deg"):
        relnav.load_model("rendezvous_demo", {f"sensor.star.{key}": value})


def test_what_is_shipped_is_plausible():
    for name in relnav.list_models():
        relnav.load_model(name)
