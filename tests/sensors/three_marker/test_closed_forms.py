"""The paper's closed forms on images made by its own model: position and small angles come back."""

import numpy as np
import pytest

from relnav.sensors.three_marker.as_published import closed_form_flat, closed_form_raised

R, PHI = np.array([0.4, 7.0, -0.3]), np.array([0.03, -0.05, 0.02])


def image_of(points, r=R, phi=PHI):
    """Coordinates a = X / Y and beta = Z / Y of p = r + s + phi x s, eq. (3) with C0 = I."""
    p = r + points + np.cross(phi, points)
    return p[:, 0] / p[:, 1], p[:, 2] / p[:, 1]


@pytest.mark.parametrize("r", [R, [-1.1, 3.0, 0.6], [0.2, 20.0, 1.5]])
def test_flat(r):
    points = np.array([[-0.5, 0.0, -0.3], [0.6, 0.0, -0.2], [0.1, 0.0, 0.7]])
    position, angles = closed_form_flat(*image_of(points, np.array(r)), points)
    np.testing.assert_allclose(position, r, rtol=1e-10)
    np.testing.assert_allclose(angles, PHI, rtol=1e-9)


@pytest.mark.parametrize("r", [R, [-1.1, 3.0, 0.6], [0.2, 20.0, 1.5]])
def test_raised(r):
    b, c, h, e = 0.5, 0.2, 0.15, 0.4
    points = np.array([[-b, 0.0, -c], [b, 0.0, -c], [0.0, -h, e]])
    position, angles = closed_form_raised(*image_of(points, np.array(r)), b, c, h, e)
    np.testing.assert_allclose(position, r, rtol=1e-9)
    np.testing.assert_allclose(angles, PHI, rtol=1e-8)
