"""A focal length that is known to a tolerance: frames within it are solved, beyond it refused with the reason."""

import dataclasses
import re

import numpy as np
import pytest

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.dual_field.solution import StarStatus
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

TOLERANCE = 1e-3
REST = np.zeros(3)


def told(sensor, sigma):
    return dataclasses.replace(sensor, camera=dataclasses.replace(sensor.camera, focal_length_relative_sigma=sigma))


def longer(sensor, part):
    camera = sensor.camera
    return dataclasses.replace(
        sensor, camera=dataclasses.replace(camera, focal_length_px=camera.focal_length_px * (1.0 + part))
    )


def frame_of(sensor, part, rng, **conditions):
    """A frame of a sensor whose lens is longer by a part than its model says, and whose fold is off as it states."""
    simulator = StarFieldSimulator(longer(sensor, part), SkyConditions(**conditions))
    simulator.mount(rng)
    return simulator.frame(rng, velocity_km_s=REST)


def solved(frame, model, **given):
    return relnav.dual_field.measure(frame.spots_px, model, magnitude=frame.magnitude, velocity_km_s=REST, **given)


@pytest.mark.parametrize("kind", ["mirror", "rotation", "none"])
def test_lenses_within_the_tolerance(mounted_sensor, error_rad, kind):
    """Of 80 lenses nine of ten frames and more are solved; NEES within its 99.9 % bounds; the focal length is found."""
    sensor = dataclasses.replace(mounted_sensor, fold=dataclasses.replace(mounted_sensor.fold, kind=kind))
    rng, model, nees, off = np.random.default_rng(1), told(sensor, TOLERANCE), [], []
    for part in TOLERANCE * rng.normal(size=80):
        frame = frame_of(sensor, part, rng)
        solution = solved(frame, model)
        if solution.ok:
            error = error_rad(solution, frame)
            nees.append(error @ np.linalg.solve(solution.covariance, error))
            off.append(solution.focal_length_px / sensor.camera.focal_length_px - 1.0 - part)
    assert len(nees) >= 72
    low, high = chi_square_interval(3 * len(nees), 0.999)
    assert low < np.mean(nees) / 3.0 < high
    assert np.median(np.abs(off)) < 0.05 * TOLERANCE


def test_a_lens_that_is_exact_is_solved_as_before(mounted_sensor):
    """With and without a tolerance: the same stars, and sigmas that differ by a tenth at most, none of them smaller."""
    rng = np.random.default_rng(2)
    for _ in range(10):
        frame = frame_of(mounted_sensor, 0.0, rng)
        one, other = solved(frame, mounted_sensor), solved(frame, told(mounted_sensor, TOLERANCE))
        assert one.ok
        np.testing.assert_array_equal(one.hip, other.hip)
        assert np.all(other.sigma_rad >= 0.999 * one.sigma_rad)
        assert np.all(other.sigma_rad < 1.1 * one.sigma_rad)


def test_false_spots_have_no_attitude(mounted_sensor):
    """Of 60 frames of 30 false spots none: as without a tolerance, whose bound on chance is kept."""
    model, rng = told(mounted_sensor, TOLERANCE), np.random.default_rng(3)
    simulator = StarFieldSimulator(mounted_sensor, SkyConditions())
    for _ in range(60):
        spots, magnitude = simulator.false_frame(rng, 30)
        assert not relnav.dual_field.measure(spots, model, magnitude=magnitude, velocity_km_s=REST).ok


@pytest.mark.parametrize("part", [0.002, -0.002])
def test_without_a_tolerance_the_reason_names_the_focal_length(mounted_sensor, part):
    """Twenty frames of a lens 0.2 % off: none solved, two in three with the right focal length in the reason."""
    rng, named = np.random.default_rng(4), 0
    for _ in range(20):
        solution = solved(frame_of(mounted_sensor, part, rng), mounted_sensor)
        assert not solution.ok
        read = re.search(r"with a focal length of (\S+) px, (\S+) % (longer|shorter) than the model's", solution.reason)
        if read:
            named += 1
            assert solution.status == StarStatus.NO_MATCH
            assert float(read[1]) / mounted_sensor.camera.focal_length_px - 1.0 == pytest.approx(part, rel=0.1)
            assert float(read[2]) == pytest.approx(0.2, rel=0.1)
            assert read[3] == ("longer" if part > 0.0 else "shorter")
        assert "focal length" in solution.reason
    assert named >= 14


def test_another_noise_is_not_taken_for_another_focal_length(mounted_sensor):
    """Spots five times as noisy as the model says: refused, and no focal length is named."""
    noisy = dataclasses.replace(mounted_sensor, camera=dataclasses.replace(mounted_sensor.camera, spot_noise_px=0.35))
    rng = np.random.default_rng(5)
    reasons = [solved(frame_of(noisy, 0.0, rng), mounted_sensor).reason for _ in range(20)]
    assert all(reasons)
    assert not any("with a focal length of" in reason for reason in reasons)


def test_beyond_the_tolerance(mounted_sensor):
    """A lens four sigma off is refused, by tracking too, and the reason names the focal length."""
    rng, model, reasons = np.random.default_rng(6), told(mounted_sensor, 5e-4), []
    for _ in range(10):
        frame = frame_of(mounted_sensor, 0.002, rng)
        solution = solved(frame, model)
        assert not solution.ok
        assert "focal length" in solution.reason
        near = relnav.dual_field.track(
            frame.spots_px, model, frame.dcm_cam_from_icrs, 5e-5, magnitude=frame.magnitude, velocity_km_s=REST
        )
        assert not near.ok
        reasons.append(near.reason)
    assert sum("farther off than focal_length_relative_sigma states" in reason for reason in reasons) >= 5


def test_tracking_within_the_tolerance(mounted_sensor, error_rad):
    """Forty lenses, tracked from a prior 10 arcsec off: all solved, NEES within its 99.9 % bounds."""
    rng, model, nees = np.random.default_rng(7), told(mounted_sensor, TOLERANCE), []
    for part in TOLERANCE * rng.normal(size=40):
        frame = frame_of(mounted_sensor, part, rng)
        phi = 5e-5 * rng.normal(size=3)
        turn = dcm_from_quaternion(np.append(0.5 * phi, 1.0) / np.sqrt(1.0 + 0.25 * phi @ phi))
        solution = relnav.dual_field.track(
            frame.spots_px, model, turn @ frame.dcm_cam_from_icrs, 5e-5, magnitude=frame.magnitude, velocity_km_s=REST
        )
        if solution.ok:
            error = error_rad(solution, frame)
            nees.append(error @ np.linalg.solve(solution.covariance, error))
    assert len(nees) >= 38
    low, high = chi_square_interval(3 * len(nees), 0.999)
    assert low < np.mean(nees) / 3.0 < high


def test_which_way_the_rotation_of_a_fold_turns(mounted_sensor):
    """The key's R takes a ray u of the detector to its direction s on the sky, s = R u, written out here in numbers.

    R = 90 deg about +y and then 30 deg about +z: the detector's middle shows the sky at (cos 30, sin 30, 0).
    """
    c, s = np.cos(np.pi / 6.0), np.sin(np.pi / 6.0)
    R = np.array([[0.0, -s, c], [0.0, c, s], [-1.0, 0.0, 0.0]])
    half = 0.5 * np.sqrt(1.0 + np.trace(R))
    q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4.0 * half)
    fold = dataclasses.replace(mounted_sensor.fold, kind="rotation", rotation=(*q.tolist(), float(half)))
    model = dataclasses.replace(mounted_sensor, fold=fold)
    np.testing.assert_allclose(model.fold.matrix @ [0.0, 0.0, 1.0], [c, s, 0.0], atol=1e-12)
    focal, rng = mounted_sensor.camera.focal_length_px, np.random.default_rng(8)
    stars = mounted_sensor.catalogue.directions(mounted_sensor.identification.epoch_jyear)
    magnitude = np.asarray(mounted_sensor.catalogue.hp_mag, dtype=float)
    bright = magnitude < 5.75
    A = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    A *= np.sign(np.linalg.det(A))
    spots, brightness, field = [], [], []
    for number, turn in enumerate((np.eye(3), R)):
        u = stars[bright] @ A.T @ turn  # u = R^T s, row by row
        inside = u[:, 2] > np.cos(np.radians(7.0))
        spots.append(focal * u[inside, :2] / u[inside, 2:])
        brightness.append(magnitude[bright][inside])
        field += [number] * int(inside.sum())
    solution = relnav.dual_field.measure(
        np.concatenate(spots), model, magnitude=np.concatenate(brightness), velocity_km_s=REST
    )
    assert solution.ok
    matched = solution.hip > 0
    np.testing.assert_array_equal(solution.field[matched], np.array(field)[matched])
    assert np.abs(solution.dcm_cam_from_icrs - A).max() < 1e-5
