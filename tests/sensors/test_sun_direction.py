"""A sun direction as an attitude observation: sign, Jacobian, full-rank noise, blind to turns about the sun."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.sensors.measurement import Status
from relnav.sensors.sun_direction import (
    Mounting,
    SunDirection,
    attitude_observation,
    direction_with_covariance,
    no_direction,
    tangent_basis,
)

SIGMA = 1e-4


@pytest.fixture
def case():
    """case(seed) -> attitude, sun (inertial), measured direction in body axes with noise."""

    def of(seed):
        rng = np.random.default_rng(seed)
        attitude = Rotation.random(rng=rng).as_matrix()
        sun = rng.normal(size=3)
        sun /= np.linalg.norm(sun)
        s = attitude @ sun
        across = np.eye(3) - np.outer(s, s)
        seen = s + SIGMA * across @ rng.normal(size=3)
        return attitude, sun, direction_with_covariance(seen / np.linalg.norm(seen), SIGMA**2 * across)

    return of


def test_the_innovation_is_what_the_jacobian_says(case, truth):
    """dcm_true = exp(-[e x]) dcm_predicted: for a small error e, innovation = jacobian e."""
    for seed in range(20):
        attitude, sun, _ = case(seed)
        exact = direction_with_covariance(attitude @ sun, np.zeros((3, 3)))

        def innovation(e, attitude=attitude, sun=sun, exact=exact):
            predicted = Rotation.from_rotvec(e).as_matrix() @ attitude
            basis = tangent_basis(attitude @ sun)
            return basis.T @ (exact.direction - predicted @ sun)

        observation = attitude_observation(exact, sun, attitude)
        np.testing.assert_allclose(observation.innovation, 0.0, atol=1e-15)
        np.testing.assert_allclose(observation.jacobian, truth.derivative(innovation, np.zeros(3), 1e-4), atol=1e-9)


def test_a_turn_about_the_sun_line_is_not_seen(case):
    for seed in range(20):
        attitude, sun, seen = case(seed)
        observation = attitude_observation(seen, sun, attitude)
        np.testing.assert_allclose(observation.jacobian @ (attitude @ sun), 0.0, atol=1e-15)
        np.testing.assert_allclose(np.linalg.svd(observation.jacobian, compute_uv=False), 1.0, atol=1e-14)


def test_the_innovation_has_its_covariance(case):
    normalised = []
    for seed in range(400):
        attitude, sun, seen = case(seed)
        observation = attitude_observation(seen, sun, attitude)
        normalised.append(observation.innovation @ np.linalg.solve(observation.covariance, observation.innovation))
    assert 1.7 < np.mean(normalised) < 2.3
    wider = attitude_observation(seen, sun, attitude, sun_sigma_rad=2e-4)
    np.testing.assert_allclose(wider.covariance - observation.covariance, 4e-8 * np.eye(2), atol=1e-20)


def test_sun_and_a_star_give_the_attitude(case):
    """Two such observations in one least-squares step: error of 1e-2 rad corrected to the noise."""
    attitude, sun, seen = case(3)
    other = np.cross(sun, [0.3, -0.4, 0.8])
    other /= np.linalg.norm(other)
    star = direction_with_covariance(attitude @ other, 1e-12 * np.eye(3))
    predicted = Rotation.from_rotvec([4e-3, -7e-3, 6e-3]).as_matrix().T @ attitude
    for _ in range(3):
        parts = [attitude_observation(a, b, predicted) for a, b in ((seen, sun), (star, other))]
        e = np.linalg.lstsq(
            np.concatenate([p.jacobian for p in parts]), np.concatenate([p.innovation for p in parts]), rcond=None
        )[0]
        predicted = Rotation.from_rotvec(-e).as_matrix() @ predicted
    assert np.linalg.norm(Rotation.from_matrix(predicted @ attitude.T).as_rotvec()) < 5.0 * SIGMA


def test_other_axes(case):
    attitude, sun, seen = case(1)
    inertial = seen.turned(attitude.T)
    np.testing.assert_allclose(inertial.direction, attitude.T @ seen.direction, atol=1e-15)
    np.testing.assert_allclose(np.linalg.eigvalsh(inertial.covariance), np.linalg.eigvalsh(seen.covariance), atol=1e-18)
    np.testing.assert_allclose(inertial.turned(attitude).direction, seen.direction, atol=1e-15)
    assert np.linalg.norm(inertial.direction - sun) < 5.0 * SIGMA


def test_a_sensor_sits_in_body_axes_unless_it_is_told():
    np.testing.assert_array_equal(Mounting().dcm_body_from_sensor, np.eye(3))


def test_basis():
    for s in np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8]]]):
        triad = np.column_stack([tangent_basis(s), s])
        np.testing.assert_allclose(triad.T @ triad, np.eye(3), atol=1e-15)
        assert np.linalg.det(triad) == pytest.approx(1.0)


def test_wrong_use(case):
    attitude, sun, seen = case(0)
    with pytest.raises(ValueError, match="its status is NOT_SEEN"):
        attitude_observation(no_direction(Status.NOT_SEEN), sun, attitude)
    with pytest.raises(ValueError, match="unit vector"):
        attitude_observation(seen, 1.5e11 * sun, attitude)
    with pytest.raises(ValueError, match="unit vector"):
        attitude_observation(seen, [np.nan, 0.0, 1.0], attitude)
    with pytest.raises(ValueError, match="rotation matrix"):
        seen.turned(2.0 * attitude)
    assert isinstance(no_direction(Status.AT_EDGE), SunDirection)


def test_projection_angles_and_sigma():
    """tan(alpha) = s_x / s_z and tan(beta) = s_y / s_z; rms of the two errors across."""
    s = np.array([0.3, -0.4, 0.8]) / np.linalg.norm([0.3, -0.4, 0.8])
    across = np.linalg.svd(s[None])[2][1:]
    found = SunDirection(s, across.T @ np.diag([1e-8, 9e-8]) @ across, Status.OK)
    assert found.sigma_rad == pytest.approx(np.sqrt(5e-8))
    assert np.tan(found.alpha_rad) == pytest.approx(0.3 / 0.8)
    assert np.tan(found.beta_rad) == pytest.approx(-0.4 / 0.8)


def test_an_observation_is_what_it_was(case):
    """Whoever holds one can rely on it."""
    attitude, sun, seen = case(3)
    for said, name in ((attitude_observation(seen, sun, attitude), "innovation"), (seen, "direction")):
        with pytest.raises(FrozenInstanceError):
            setattr(said, name, np.zeros(2))
    for array in (seen.direction, seen.covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
