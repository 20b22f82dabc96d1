"""Frames that are not what the model says: refused, or solved within their covariance; one field alone is none."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.dual_field_edges import KINDS, fly_edges
from relnav.geometry.rotation_vector import attitude_error, turned
from relnav.sensors.dual_field.attitude_fit import join
from relnav.sensors.dual_field.fold import mirror_fold
from relnav.sensors.dual_field.optics import project
from relnav.sensors.dual_field.sensor import Fold
from relnav.sensors.dual_field.solution import StarStatus
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_attitude

REST = (0.0, 0.0, 0.0)
ARCSEC = np.radians(1.0 / 3600.0)
measure = relnav.dual_field.measure


def tilted(arcsec):
    """The nominal mirror tilted in the plane of normal and boresight: the fields come apart by twice as much."""
    tilt = np.pi / 4 + arcsec * ARCSEC
    return mirror_fold((np.sin(tilt), 0.0, -np.cos(tilt)))


def test_no_frame_is_solved_far_off(mounted_sensor):
    """A tenth of `benchmarks/star_sensor.py edges --full`; what can be solved is."""
    result = fly_edges(mounted_sensor, 1000, 5)
    assert set(result) == set(KINDS)
    assert {kind: row["far"] for kind, row in result.items()} == dict.fromkeys(result, 0)
    assert result["mirrored"]["solved"] == result["noisy"]["solved"] == 0
    assert result["as stated"]["solved"] >= 0.95 * result["as stated"]["frames"]
    assert result["off axis"]["solved"] >= 0.9 * result["off axis"]["frames"]
    assert 0 < result["turned"]["solved"] < 0.6 * result["turned"]["frames"]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turn_deg", [0.1, 1.0, 30.0, 90.0])
def test_a_detector_turned_against_its_mirror(mounted_sensor, turn_deg, mirrored):
    """Either field is explained by itself, by attitudes that differ: none is given."""
    R = turned(np.eye(3), np.array([0.0, 0.0, np.radians(turn_deg)]))
    simulator = StarFieldSimulator(mounted_sensor, SkyConditions(), R @ mounted_sensor.fold.matrix @ R.T)
    rng = np.random.default_rng(8)
    for _ in range(20):
        frame = simulator.frame(rng)
        spots = frame.spots_px * ((-1.0, 1.0) if mirrored else (1.0, 1.0))
        solution = measure(spots, mounted_sensor, magnitude=frame.magnitude, velocity_km_s=REST)
        assert solution.status is StarStatus.AMBIGUOUS
        assert "is the image mirrored" in solution.reason
        assert np.isnan(solution.dcm_cam_from_icrs).all()
        assert solution.matches == 0


def test_one_field_alone_is_told_by_tracking(mounted_sensor):
    """Glare in one field: lost in space the frame is ambiguous, with a prior attitude it is solved."""
    simulator, rng = StarFieldSimulator(mounted_sensor, SkyConditions()), np.random.default_rng(10)
    for field in (0, 1, 0, 1):
        frame = simulator.frame(rng)
        seen = frame.field != 1 - field
        lost = measure(frame.spots_px[seen], mounted_sensor, magnitude=frame.magnitude[seen], velocity_km_s=REST)
        assert lost.status is StarStatus.AMBIGUOUS
        prior = turned(frame.dcm_cam_from_icrs, np.array([1e-4, -1e-4, 1e-4]))
        tracked = relnav.dual_field.track(
            frame.spots_px[seen],
            mounted_sensor,
            prior,
            2e-4,
            magnitude=frame.magnitude[seen],
            velocity_km_s=REST,
        )
        assert tracked.status is StarStatus.SINGLE_FIELD
        error = attitude_error(tracked.dcm_cam_from_icrs, frame.dcm_cam_from_icrs)
        assert error @ np.linalg.solve(tracked.covariance, error) < 25.0


def test_an_image_upside_down_is_that_of_another_attitude(mounted_sensor):
    """With the mirror's normal in the x-z plane no frame can tell: the spots are the same to the last digit."""
    A, M, flipped = random_attitude(np.random.default_rng(1)), mounted_sensor.fold.matrix, np.diag([1.0, -1.0, 1.0])
    v = random_attitude(np.random.default_rng(2))
    other = M @ flipped @ A
    for star in v:
        shown = [project((fold @ A @ star)[None], 1000.0)[0] for fold in (np.eye(3), M)]
        alike = [project((fold @ other @ star)[None], 1000.0)[0] for fold in (M, np.eye(3))]
        np.testing.assert_allclose(np.array(shown) * (1.0, -1.0), alike, rtol=1e-9)
    assert np.linalg.det(other) == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["mirror", "rotation"])
def test_a_fold_off_by_its_stated_error(mounted_sensor, kind):
    """Every frame that of another sensor: the mean NEES is 3, where a fold taken for exact gives hundreds."""
    sensor = dataclasses.replace(
        mounted_sensor, fold=dataclasses.replace(mounted_sensor.fold, kind=kind, error_rad=10.0 * ARCSEC)
    )
    exact = dataclasses.replace(sensor, fold=dataclasses.replace(sensor.fold, error_rad=0.0))
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(4)
    nees, taken_for_exact = [], []
    for _ in range(400):
        simulator.mount(rng)
        frame = simulator.frame(rng)
        for model, into in ((sensor, nees), (exact, taken_for_exact)):
            solution = measure(frame.spots_px, model, magnitude=frame.magnitude, velocity_km_s=REST)
            if solution.ok:
                e = attitude_error(solution.dcm_cam_from_icrs, frame.dcm_cam_from_icrs)
                into.append(e @ np.linalg.solve(solution.covariance, e))
    assert len(nees) >= 390
    assert np.mean(nees) == pytest.approx(3.0, abs=4.5 * np.sqrt(6.0 / len(nees)))
    assert np.mean(taken_for_exact) > 30.0


def test_fields_apart_by_eighteen_arcsec(mounted_sensor):
    simulator, rng, nees = (
        StarFieldSimulator(mounted_sensor, SkyConditions(), tilted(9.0)),
        np.random.default_rng(5),
        [],
    )
    for _ in range(200):
        frame = simulator.frame(rng)
        solution = measure(frame.spots_px, mounted_sensor, magnitude=frame.magnitude, velocity_km_s=REST)
        if solution.ok:
            e = attitude_error(solution.dcm_cam_from_icrs, frame.dcm_cam_from_icrs)
            nees.append(e @ np.linalg.solve(solution.covariance, e))
    assert len(nees) > 190
    assert np.mean(nees) == pytest.approx(3.0, abs=4.5 * np.sqrt(6.0 / len(nees)) + 0.5)


def test_a_fold_beyond_its_stated_error_is_told(mounted_sensor):
    """Four sigma: the stars of both fields still match, and say that the fold is off."""
    simulator, rng = StarFieldSimulator(mounted_sensor, SkyConditions(), tilted(40.0)), np.random.default_rng(6)
    for _ in range(20):
        frame = simulator.frame(rng)
        solution = measure(frame.spots_px, mounted_sensor, magnitude=frame.magnitude, velocity_km_s=REST)
        assert solution.status in (StarStatus.NO_MATCH, StarStatus.AMBIGUOUS)
        assert "relnav calibrate fold" in solution.reason


@pytest.mark.parametrize("noise_px", [0.2, 1.0, 3.0])
def test_spots_noisier_than_stated(mounted_sensor, noise_px):
    real = dataclasses.replace(
        mounted_sensor, camera=dataclasses.replace(mounted_sensor.camera, spot_noise_px=noise_px)
    )
    simulator, rng = StarFieldSimulator(real, SkyConditions()), np.random.default_rng(7)
    for _ in range(60):
        frame = simulator.frame(rng)
        solution = measure(frame.spots_px, mounted_sensor, magnitude=frame.magnitude, velocity_km_s=REST)
        assert not solution.ok


def test_the_two_attitudes_are_the_marginals_of_the_joint_fit():
    """`join` against the normal equations of (d, phi) written out."""
    rng = np.random.default_rng(3)
    root0, root1 = rng.normal(size=(2, 3, 3))
    F0, F1 = root0 @ root0.T, root1 @ root1.T
    g0, g1 = rng.normal(size=(2, 3))
    n = np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)
    prior = 0.3 * (np.eye(3) - np.outer(n, n))
    cov, d = np.empty((3, 3)), np.empty(3)
    assert join(F0, F1, g0, g1, prior, cov, d, np.empty((6, 3)))
    axes = np.linalg.svd(prior)[0][:, :2]  # phi = axes p, p with variance 0.3
    normal = np.block([[F0 + F1, F1 @ axes], [axes.T @ F1, axes.T @ F1 @ axes + np.eye(2) / 0.3]])
    joint = np.linalg.inv(normal)
    np.testing.assert_allclose(cov, joint[:3, :3], rtol=1e-9)
    np.testing.assert_allclose(d, (joint @ np.concatenate([g0 + g1, axes.T @ g1]))[:3], rtol=1e-9)


def test_covariance_of_a_mirrors_error():
    """A mirror turned by omega across its normal turns its rays by 2 omega."""
    fold = Fold("mirror", error_rad=1e-5)
    n = np.array(fold.mirror_normal)
    for omega in (np.array([0.0, 1.0, 0.0]), np.cross(n, [0.0, 1.0, 0.0])):
        R = turned(np.eye(3), 1e-5 * omega)
        np.testing.assert_allclose(R @ fold.matrix @ R.T, turned(np.eye(3), 2e-5 * omega) @ fold.matrix, atol=1e-15)
        assert omega @ fold.covariance @ omega == pytest.approx(4e-10)
    assert n @ fold.covariance @ n == pytest.approx(0.0, abs=1e-20)
    assert np.all(Fold("none").covariance == 0.0)
