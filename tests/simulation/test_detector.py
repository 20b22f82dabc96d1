"""The simulated detector: the right spots, the right noise, and faults as often as stated."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.mission import Attitude, Camera, Docking
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.sensors.three_beacon.psd import currents_of_counts, spots_of_currents
from relnav.simulation.detector import Faults, background_current_a, image, project_beacons
from relnav.simulation.raw import slot_counts

STATES = np.array([[10.0, 0.25, -0.15, 0, 0, 0], [6.5, -0.1, 0.2, 0, 0, 0], [4.2, 0.0, 0.1, 0, 0, 0]])
FACING = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])  # cam x = -y, y = +z, z = -x of lvlh_ccsds


def test_v_bar_spots(make_model, truth) -> None:
    spots = project_beacons(make_model(), STATES)
    for got, state in zip(spots, STATES, strict=True):
        np.testing.assert_allclose(got, truth.central(state[:3], FACING), rtol=0.0, atol=1e-17 + 1e-15 * truth.f)


def test_turned_port_tilted_camera_and_lever_arms(make_model, truth) -> None:
    """Every part of the model at once, against rotations of scipy."""
    dock = Rotation.from_euler("xyz", [0.3, -1.2, 0.4])
    cam = Rotation.from_matrix(FACING) * Rotation.from_euler("xyz", [0.02, 0.03, -0.04])
    mount = Rotation.from_euler("xyz", [0.5, 0.1, -0.7])
    port, lever = np.array([0.4, -0.3, 0.8]), np.array([0.2, 0.5, -0.1])
    model = make_model(
        docking=Docking(tuple(dock.as_quat()), tuple(port)),
        camera=Camera(tuple(lever), tuple(mount.as_quat())),
        attitude=Attitude("lvlh_hold", tuple(cam.as_quat())),
    )
    spots = project_beacons(model, STATES)
    chaser_to_lvlh = cam.inv() * mount  # chaser axes to camera, camera to lvlh
    for got, state in zip(spots, STATES, strict=True):
        eye = state[:3] + chaser_to_lvlh.apply(lever)
        beacons = port + dock.inv().apply(truth.beacons)
        expected = truth.central(eye, cam.as_matrix(), beacons=beacons)
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-15)


def test_a_beacon_behind_the_camera_has_no_spot(make_model) -> None:
    spots = project_beacons(make_model(), np.array([[0.3, 0.0, 0.0, 0, 0, 0], [-2.0, 0.0, 0.0, 0, 0, 0]]))
    np.testing.assert_array_equal(np.isnan(spots).any(axis=2), [[False, False, True], [True, True, True]])


def test_noise(make_model, sensor) -> None:
    model, n = make_model(), 20_000
    state = np.tile(STATES[1], (n, 1))
    noise = image(model, state, Faults(), np.random.default_rng(1)) - project_beacons(model, state)
    assert np.isfinite(noise).all()
    flat = noise.reshape(n, 6)
    np.testing.assert_allclose(flat.std(axis=0), sensor.spot_noise_m, rtol=0.03)
    assert (np.abs(flat.mean(axis=0)) < 4.0 * sensor.spot_noise_m / math.sqrt(n)).all()
    np.testing.assert_allclose(np.corrcoef(flat.T), np.eye(6), rtol=0.0, atol=0.04)


def test_no_spot_beside_the_detector(make_model) -> None:
    """On axis at 3.75 m A and B stand on the rim, and noise decides; C stays."""
    state = np.tile([3.75, 0.0, 0.0, 0, 0, 0], (2000, 1))
    spots = image(make_model(), state, Faults(), np.random.default_rng(2))
    seen = np.isfinite(spots).all(axis=2)
    assert 0.4 < seen[:, 0].mean() < 0.6
    assert 0.4 < seen[:, 1].mean() < 0.6
    assert seen[:, 2].all()
    assert np.nanmax(np.abs(spots)) <= 4e-3
    np.testing.assert_array_equal(np.isnan(spots).any(axis=2), np.isnan(spots).all(axis=2))


@pytest.mark.parametrize("dropout", [0.0, 0.1, 0.5])
def test_dropouts_as_often_as_stated_and_independent(make_model, dropout: float) -> None:
    n = 20_000
    spots = image(make_model(), np.tile(STATES[1], (n, 1)), Faults(dropout=dropout), np.random.default_rng(3))
    lost = np.isnan(spots).all(axis=2)
    tolerance = 4.0 * math.sqrt(dropout * (1.0 - dropout) / n)
    np.testing.assert_allclose(lost.mean(axis=0), dropout, rtol=0.0, atol=tolerance)
    assert lost.all(axis=1).mean() == pytest.approx(dropout**3, abs=0.02)


@pytest.mark.parametrize("outliers", [0.05, 0.3])
def test_outliers_as_often_as_stated_all_over_the_detector(make_model, sensor, outliers: float) -> None:
    n = 20_000
    state = np.tile(STATES[1], (n, 1))
    spots = image(make_model(), state, Faults(outliers=outliers), np.random.default_rng(4))
    error = np.abs(spots - project_beacons(make_model(), state)).max(axis=2)
    wrong = error > 6.0 * sensor.spot_noise_m
    # One glint in 4400 falls within 6 sigma of the true spot.
    np.testing.assert_allclose(wrong.mean(axis=0), outliers, rtol=0.0, atol=4.0 * math.sqrt(outliers / n) + 3e-4)
    glints = spots[wrong]
    assert np.isfinite(glints).all()
    np.testing.assert_allclose(glints.std(axis=0), 4e-3 / math.sqrt(3.0), rtol=0.05)
    np.testing.assert_allclose(glints.mean(axis=0), 0.0, atol=2e-4)


@pytest.mark.parametrize("name", ["dropout", "outliers"])
@pytest.mark.parametrize("value", [-0.1, 1.0, 2.0, math.nan])
def test_impossible_faults(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} is a probability, 0 <= {name} < 1; got"):
        Faults(**{name: value})


def test_noise_by_received_power() -> None:
    """Quiet close in, loud far out, and as loud as stated; the triangle's C is nearer, so quieter."""
    import relnav
    from relnav.simulation.detector import spot_sigmas

    model, n = relnav.load_model("three_beacon_psd"), 20_000
    sigma = spot_sigmas(model, STATES)
    assert (np.diff(sigma[:, 0, 0]) < 0.0).all()  # STATES come closer
    assert (sigma[:, 2] < sigma[:, 0]).all()
    assert 10e-6 < sigma[1, 0, 0] < 11.5e-6  # 6.5 m, 3.5 deg off the beacon's boresight
    state = np.tile(STATES[1], (n, 1))
    drawn = image(model, state, Faults(), np.random.default_rng(7), spot_sigmas(model, state))
    noise = drawn - project_beacons(model, state)
    np.testing.assert_allclose(noise.std(axis=0), sigma[1], rtol=0.03)


def test_without_a_detector_the_noise_is_the_sensors(make_model, sensor) -> None:
    from relnav.simulation.detector import photocurrents, spot_sigmas

    np.testing.assert_array_equal(spot_sigmas(make_model(), STATES), np.full((3, 3, 2), sensor.spot_noise_m))
    with pytest.raises(ValueError, match=r"has no \[detector\] and \[light\]"):
        photocurrents(make_model(), STATES)


def test_attitude_of_each_row(make_model) -> None:
    """A camera that turns right moves spots left: f tan(angle) in the middle."""
    angle = np.array([0.0, 0.01, -0.02])
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros(3), np.ones(3)
    turn = np.stack([c, zero, -s, zero, one, zero, s, zero, c], axis=-1).reshape(3, 3, 3)
    spots = project_beacons(make_model(), np.tile([6.0, 0, 0, 0, 0, 0], (3, 1)), turn @ FACING)
    np.testing.assert_allclose(spots[:, 2, 0], -0.05 * np.tan(angle), atol=1e-15)


@pytest.mark.parametrize("raw", [False, True], ids=["spots", "raw"])
def test_a_calibrated_models_detector_is_the_one_that_was_calibrated(raw):
    """Spots are where the correction takes back to the truth, but for noise and an error that lasts over a log."""
    box, sigma = (4e-3, 4e-3), 2e-5
    bent = (2e-4, 0.0, 1e-4, 1e-4, 0.0, -5e-5)
    calibration = Calibration(2, (0.0, 0.0), box, bent, bent[::-1], sigma, 0.1, 225, 1e-5)
    model = dataclasses.replace(relnav.load_model("three_beacon_psd"), calibration=calibration)
    state, beacon = np.tile([6.0, 0.0, 0.0, 0.0, 0.0, 0.0], (300, 1)), np.arange(300) % 3
    left = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        if raw:
            currents = currents_of_counts(model.detector, slot_counts(model, state, beacon, rng))
            seen, _ = spots_of_currents(model.sensor.detector_size_m, currents - background_current_a(model))
            seen = np.stack([seen[beacon == k] for k in range(3)], axis=1)
        else:
            seen = image(model, state, Faults(), rng)
        left.append((calibration.correct(seen) - project_beacons(model, state)[: len(seen)]).mean(axis=0))
    np.testing.assert_allclose(np.mean(left, axis=0), 0.0, atol=4.0 * sigma / 40**0.5)
    assert np.std(left) == pytest.approx(sigma, rel=0.2)
