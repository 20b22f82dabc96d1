"""Every `measure` takes what a user has: what is masked or missing was not seen, and what is no number is refused."""

import dataclasses

import numpy as np
import pytest

import relnav


class NAType:
    """Stands for the class of pandas' NA, told by its name."""


def blob(rows):
    """An image of one round spot, counts."""
    y, x = np.indices((rows, rows)) - 0.5 * (rows - 1)
    return 20.0 + 400.0 * np.exp(-0.5 * (x * x + y * y) / 1.5**2)


def calls():
    """Name -> (function of the spots, good spots, name of the argument)."""
    beacons = relnav.load_model("three_beacon_psd")
    stars = relnav.load_model("dual_field_star")
    aps = relnav.load_model("aps_sun")
    crystal = relnav.load_model("birefringent_sun")
    markers = relnav.load_model("three_marker_vision")
    field = np.random.default_rng(1).uniform(-400.0, 400.0, (6, 2))
    rest = np.zeros(3)
    return {
        "three_beacon.measure": (
            lambda z: relnav.three_beacon.measure(z, beacons),
            np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]]),
            "spots_m",
        ),
        "dual_field.measure": (
            lambda z: relnav.dual_field.measure(z, stars, velocity_km_s=rest),
            field,
            "spots_px",
        ),
        "dual_field.track": (
            lambda z: relnav.dual_field.track(z, stars, np.eye(3), 1e-5, velocity_km_s=rest),
            field,
            "spots_px",
        ),
        "aps_sun.measure": (lambda z: relnav.aps_sun.measure(z, aps), np.array([520.0, 500.0]), "seen"),
        "birefringent_sun.measure": (
            lambda z: relnav.birefringent_sun.measure(z, crystal),
            np.array([[520.0, 511.0], [590.0, 511.0]]),
            "seen",
        ),
        "three_marker.measure": (
            lambda z: relnav.three_marker.measure(z, markers),
            np.array([[400.0, 600.0], [600.0, 600.0], [510.0, 500.0]]),
            "spots_px",
        ),
        "three_marker.measure_image": (
            lambda z: relnav.three_marker.measure_image(z, markers),
            np.pad(blob(24), 500, constant_values=20.0),
            "image_dn",
        ),
    }


CALLS = calls()
REFUSED = {
    "complex": lambda z: z + 1j,
    "datetime64": lambda z: np.zeros(z.shape, dtype="datetime64[ns]"),
    "timedelta64": lambda z: np.zeros(z.shape, dtype="timedelta64[s]"),
    "text": lambda z: z.astype(str),
    "too large an integer": lambda z: [10**400, *z.ravel().tolist()[1:]],
}


def same(one, other):
    """Whether two results hold the same numbers."""
    for field in dataclasses.fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


def test_no_measure_is_left_out():
    rooms = ("three_beacon", "dual_field", "aps_sun", "birefringent_sun", "three_marker")
    public = {f"{room}.{name}" for room in rooms for name in getattr(relnav, room).__all__}
    assert {name for name in public if name.split(".")[1].startswith(("measure", "track"))} == set(CALLS)


@pytest.mark.parametrize("name", [name for name in CALLS if name != "three_marker.measure_image"])
def test_a_masked_or_missing_spot_was_not_seen(name):
    function, spots, _ = CALLS[name]
    unseen = spots.copy()
    unseen.flat[0] = np.nan
    expected = function(unseen)
    mask = np.zeros(spots.shape, dtype=bool)
    mask.flat[0] = True
    same(function(np.ma.array(spots, mask=mask)), expected)
    given = spots.astype(object)
    given.flat[0] = None
    same(function(given.tolist()), expected)
    given.flat[0] = NAType()
    with pytest.raises(ValueError, match="got NA of pandas: give NaN for what was not seen"):
        function(given.tolist())


def test_a_masked_pixel_is_dead():
    function, image, _ = CALLS["three_marker.measure_image"]
    hot, mask = image.copy(), np.zeros(image.shape, dtype=bool)
    hot[3:6, 3:6], mask[3:6, 3:6] = 4000.0, True
    dead = np.where(mask, np.nan, hot)
    same(function(np.ma.array(hot, mask=mask)), function(dead))


@pytest.mark.parametrize("kind", REFUSED)
@pytest.mark.parametrize("name", CALLS)
def test_what_is_no_real_number_is_refused(name, kind):
    function, spots, argument = CALLS[name]
    with pytest.raises(ValueError, match=f"^{argument} "):
        function(REFUSED[kind](spots))


@pytest.mark.parametrize("name", CALLS)
def test_the_array_handed_in_is_not_changed(name):
    function, spots, _ = CALLS[name]
    given = spots.copy()
    function(given)
    np.testing.assert_array_equal(given, spots)


def test_other_arguments_are_numbers_too():
    masked = np.ma.array(np.eye(4), mask=np.eye(4) > 0.0)
    crystal = CALLS["birefringent_sun.measure"][1]
    model = relnav.load_model("birefringent_sun")
    for wrong in (masked * 1j, np.eye(4).astype(str)):
        with pytest.raises(ValueError, match="covariance_px2 holds real numbers"):
            relnav.birefringent_sun.measure(crystal, model, covariance_px2=wrong)
    stars, spots = relnav.load_model("dual_field_star"), CALLS["dual_field.measure"][1]
    for name, value in {
        "velocity_km_s": [1j, 0.0, 0.0],
        "magnitude": np.zeros(6, dtype="timedelta64[s]"),
        "epoch_jyear": np.datetime64("2026-01-01"),
    }.items():
        arguments = {"velocity_km_s": np.zeros(3)} | {name: value}
        with pytest.raises(ValueError, match=f"{name} holds real numbers"):
            relnav.dual_field.measure(spots, stars, **arguments)
