"""The attitude filter's settled sigmas against the Riccati equation, solved by scipy."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from relnav.estimation.attitude import settled_sigmas


@pytest.mark.parametrize(("sigma", "dt", "density"), [(1e-3, 0.1, 1e-6), (0.02, 1.0, 1e-9), (5.0, 0.04, 3.0)])
def test_settled_sigmas_solve_the_riccati_equation(sigma, dt, density):
    """Attitude and rate as a double integrator, driven by white acceleration, the attitude measured."""
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0], [0.0]])
    covariance = solve_continuous_are(a.T, b, np.diag([0.0, density]), [[sigma**2 * dt]])
    np.testing.assert_allclose(settled_sigmas(sigma, dt, density), np.sqrt(np.diagonal(covariance)), rtol=1e-6)
