"""Sun and a second vector: the attitude, with the roll about the sun as the formula has it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.sensors.sun_attitude import attitude_from_sun_and_vector
from relnav.sensors.sun_direction import direction_with_covariance

ARCSEC = np.pi / 648000.0


def measured(s, sigma, rng):
    across = np.eye(3) - np.outer(s, s)
    seen = s + sigma * across @ rng.normal(size=3)
    return direction_with_covariance(seen / np.linalg.norm(seen), sigma**2 * across)


@pytest.mark.parametrize(("eta_deg", "roll_arcsec"), [(90.0, 5.0), (45.0, 60.4), (20.0, 165.5), (5.0, 688.0)])
def test_roll_about_the_sun(eta_deg, roll_arcsec):
    """Sun 60, star 5 arcsec: 600 draws within 10 % of sigma^2 = (s2^2 + cos^2 ss^2) / sin^2, and NEES of 3."""
    rng = np.random.default_rng(7)
    eta = np.radians(eta_deg)
    rolls, nees = [], []
    for _ in range(600):
        attitude = Rotation.random(rng=rng).as_matrix()
        sun = rng.normal(size=3)
        sun /= np.linalg.norm(sun)
        across = np.cross(sun, rng.normal(size=3))
        star = np.cos(eta) * sun + np.sin(eta) * across / np.linalg.norm(across)
        dcm, covariance = attitude_from_sun_and_vector(
            measured(attitude @ sun, 60 * ARCSEC, rng), measured(attitude @ star, 5 * ARCSEC, rng), sun, star
        )
        error = Rotation.from_matrix(attitude @ dcm.T).as_rotvec()
        nees.append(error @ np.linalg.solve(covariance, error))
        rolls.append(error @ (attitude @ sun))
    formula = np.hypot(5.0, np.cos(eta) * 60.0) / np.sin(eta)
    assert formula == pytest.approx(roll_arcsec, rel=0.01)
    assert np.std(rolls) / ARCSEC == pytest.approx(formula, rel=0.1)
    assert np.mean(nees) == pytest.approx(3.0, abs=4 * np.sqrt(6.0 / 600))


def test_too_close():
    s = np.array([0.0, 0.0, 1.0])
    near = np.array([np.sin(0.01), 0.0, np.cos(0.01)])
    seen = direction_with_covariance(s.copy(), np.eye(3))
    for other in (near, -near):
        with pytest.raises(ValueError, match="deg from the sun line; 1 deg is the least"):
            attitude_from_sun_and_vector(seen, seen, s, other)
