"""Yamanaka-Ankersen's matrices against Orekit's printed ones."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from relnav.dynamics.yamanaka_ankersen import fundamental_inverse, fundamental_matrix, in_plane_transition

CASE = tomllib.loads(Path(__file__).with_name("yamanaka_ankersen.toml").read_text())


def test_in_plane_transition() -> None:
    e, (theta0, theta1) = CASE["eccentricity"], np.radians(CASE["true_anomaly_deg"])
    p = CASE["semi_major_axis_m"] * (1.0 - e * e)
    momentum = math.sqrt(CASE["mu_m3_s2"] * p)
    integral = momentum / p**2 * CASE["time_s"]  # J = k^2 t, k^2 = h / p^2
    got = in_plane_transition(e, float(theta0), float(theta1), integral)
    np.testing.assert_allclose(got, CASE["in_plane"], rtol=0.0, atol=CASE["absolute_tolerance"])


@pytest.mark.parametrize("e", [0.0, 0.008, 0.3, 0.8, 0.95])
def test_the_printed_inverse_is_the_inverse(e: float) -> None:
    """Element (2, 2) is misprinted in some copies; at sin(theta) = 0 the misprint would not show."""
    for theta in np.linspace(-3.0, 9.0, 25):
        m = fundamental_matrix(e, float(theta), 0.0)
        product = m @ fundamental_inverse(e, float(theta))
        np.testing.assert_allclose(product, np.eye(4), atol=3e-15 * np.linalg.cond(m))
