"""Tracking with a prior: two stars are enough, the prior does not pull, and chance is not believed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.sensors.dual_field.solution import StarStatus
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_attitude, random_velocity

PRIOR_RAD = 5e-5


def near(dcm, rng, sigma=PRIOR_RAD):
    return Rotation.from_rotvec(rng.normal(size=3) * sigma).as_matrix() @ dcm


def test_from_two_stars_on(sensor, error_rad):
    simulator = StarFieldSimulator(sensor, SkyConditions(faintest_mag=4.0, false_spots=2))
    rng, nees, solved = np.random.default_rng(1), [], {}
    for _ in range(300):
        frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
        solution = relnav.dual_field.track(
            frame.spots_px,
            sensor,
            near(frame.dcm_cam_from_icrs, rng),
            PRIOR_RAD,
            magnitude=frame.magnitude,
            velocity_km_s=frame.velocity_km_s,
        )
        true = int(np.sum(frame.hip > 0))
        solved.setdefault(min(true, 3), []).append(solution.ok)
        if solution.ok:
            assert np.all((solution.hip == frame.hip) | (solution.hip == 0))
            e = error_rad(solution, frame)
            nees.append(e @ np.linalg.solve(solution.covariance, e))
    assert np.mean(solved[2]) > 0.9
    assert np.mean(solved[3]) > 0.99
    assert not any(solved.get(0, []) + solved.get(1, []))
    assert np.mean(nees) == pytest.approx(3.0, abs=5.0 * np.sqrt(6.0 / len(nees)))


def test_a_wrong_prior_is_not_believed(sensor):
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(2)
    for _ in range(100):
        frame = simulator.frame(rng)
        solution = relnav.dual_field.track(
            frame.spots_px, sensor, random_attitude(rng), 3e-4, magnitude=frame.magnitude, velocity_km_s=np.zeros(3)
        )
        assert solution.status is StarStatus.NO_MATCH


@pytest.mark.parametrize(
    ("prior", "sigma", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), 1e-5, "a rotation matrix"),
        (np.eye(3), 0.0, "sigma_prior_rad is above 0"),
        (np.eye(3), 1e-2, "sigma_prior_rad is above 0 and up to"),
    ],
)
def test_wrong_use(sensor, prior, sigma, message):
    with pytest.raises(ValueError, match=message):
        relnav.dual_field.track(np.zeros((5, 2)), sensor, prior, sigma, velocity_km_s=np.zeros(3))


def test_one_spot_is_too_few(sensor):
    solution = relnav.dual_field.track([[0.0, 0.0]], sensor, np.eye(3), 1e-5, velocity_km_s=np.zeros(3))
    assert solution.status is StarStatus.TOO_FEW
