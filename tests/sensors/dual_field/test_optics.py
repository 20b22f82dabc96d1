"""Optics: pixel to ray and back, what distortion does, and the spread of a ray for a spot's noise."""

import numpy as np
import pytest

from relnav.sensors.dual_field.optics import plane_points, project, ray_sigma, rays

F, CENTRE = 5114.38, (-10.71, 10.09)


@pytest.mark.parametrize("distortion", [(0.0, 0.0), (-0.12197, 0.0), (0.3, -0.5)])
def test_there_and_back(distortion):
    spots = np.random.default_rng(1).uniform(-500, 500, (200, 2))
    u = rays(plane_points(spots, F, CENTRE, distortion))
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(project(u, F, CENTRE, distortion), spots, atol=1e-9)


def test_by_hand():
    """The ground camera's formula as its README has it."""
    x, y = 500.0, -300.0
    a, b = (x + 10.71) / F, (y - 10.09) / F
    scale = 1.0 - 0.12197 * (a * a + b * b)
    np.testing.assert_allclose(plane_points(np.array([[x, y]]), F, CENTRE, (-0.12197, 0.0)), [[a * scale, b * scale]])


def test_behind_the_camera_is_nan():
    assert np.isnan(project(np.array([[0.0, 0.0, -1.0]]), F)).all()


@pytest.mark.parametrize("off_axis_deg", [0.0, 7.0, 25.0])
def test_ray_sigma_is_the_mean_of_both_axes(off_axis_deg):
    rng = np.random.default_rng(2)
    spot = np.array([F * np.tan(np.radians(off_axis_deg)), 0.0])
    u = rays((spot + rng.normal(size=(40_000, 2)) * 0.5) / F)
    spread = np.sqrt(0.5 * np.sum(np.var(u, axis=0)))
    assert ray_sigma(spot[None] / F, 0.5, F)[0] == pytest.approx(spread, rel=0.01)
