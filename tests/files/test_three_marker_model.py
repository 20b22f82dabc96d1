"""The marker models: values in SI, the geometry that their names promise, and errors that give the fix."""

import numpy as np
import pytest

import relnav
from relnav.files.model_folders import find_model


@pytest.fixture
def changed(tmp_path):
    """changed(old, new) -> path of a copy of the model with one text replaced."""

    def write(old, new):
        text = find_model("three_marker_vision").read_text()
        assert text.count(old) == 1
        path = tmp_path / "model.toml"
        path.write_text(text.replace(old, new))
        return path

    return write


def test_layouts():
    """Camera axes at the nominal attitude: T3's third marker stands 0.3 m toward the camera, on the axis."""
    raised, flat = (relnav.load_model(name) for name in ("three_marker_vision", "three_marker_vision_flat"))
    turned = raised.markers.points_m @ raised.view.dcm_cam_from_target.T
    np.testing.assert_allclose(turned, [[-0.3, 0.3, 0.0], [0.3, 0.3, 0.0], [0.0, 0.0, -0.3]], atol=1e-12)
    turned = flat.markers.points_m @ flat.view.dcm_cam_from_target.T
    np.testing.assert_allclose(turned[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 0.3, rtol=1e-12)
    assert raised.camera == flat.camera
    assert raised.view.attitude_sigma_rad == pytest.approx(np.radians(5.0), rel=1e-15)


def test_claims_are_complete():
    for name, expected in (("three_marker_vision", "met"), ("three_marker_vision_flat", "not met")):
        claims = {claim.quantity: claim for claim in relnav.load_published(name).claims}
        assert set(claims) == {
            "error growth with range",
            "iteration that reaches the truth",
            "poses of one image",
            "error of scaled orthography close in",
            "filtered over raw attitude error",
        }
        assert claims["error growth with range"].expected == expected


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("[1407.0, 1407.0]", "[1407.0, 0.0]", r"camera.focal_length_px: .*greater than 0"),
        ("[1024, 1024]", "[1024.5, 1024]", r"camera.image_size_px: .*integer"),
        (
            "focal_length_px =",
            "focal_length_mm =",
            r"camera.focal_length_mm: unknown key; did you mean 'focal_length_px'",
        ),
        ("[0.3, 0.0, 0.0]]", "[0.3, 0.0]]", r"markers.positions_m"),
        (
            "[[0.0, 0.3, 0.3], [0.0, -0.3, 0.3], [0.3, 0.0, 0.0]]",
            "[[0.0, 0.3, 0.3], [0.0, -0.3, 0.3]]",
            r"markers: positions_m holds three markers or more; got 2",
        ),
        (
            "[[0.0, 0.3, 0.3], [0.0, -0.3, 0.3], [0.3, 0.0, 0.0]]",
            "[[0.0, 0.3, 0.3], [0.0, -0.3, 0.3], [0.0, 0.0, 0.3]]",
            r"markers: positions_m: the markers stand on one line; move one of them off it",
        ),
        ("[0.5, -0.5, -0.5, -0.5]", "[1.0, 1.0, 0.0, 0.0]", r"view: a rotation quaternion .* has norm 1"),
        ("value = 5.0", "value = 200.0", r"view.attitude_sigma_deg: .*less than or equal to 3.14"),
        ("[0.0, 0.0, 0.0, 0.0, 0.0]", "[0.0, 0.0, 0.0, 0.0]", r"camera.distortion: 5 values are expected"),
    ],
)
def test_wrong_values(changed, old, new, text):
    with pytest.raises(relnav.ModelError, match=r"model.toml:\d+: " + text):
        relnav.load_model(changed(old, new))


def test_a_filter_says_what_does_not_fly():
    with pytest.raises(relnav.ModelError, match=r"a relative navigation mission is expected .* a ApsSunModel"):
        relnav.filter_log("x.csv", "aps_sun", method="spots")
