"""The normal equations of a star camera's fit against differences of the rays themselves."""

import numpy as np
import pytest

from relnav.sensors.dual_field.camera_normal import UNKNOWNS, normal_equations
from relnav.sensors.dual_field.matching import turn
from relnav.sensors.dual_field.optics import plane_points, rays
from relnav.simulation.star_field import random_attitude

STEP = 1e-6


def residuals(step, spots, stars, dcm, lens):
    """Rays minus predictions (3 n,), the eight unknowns changed by `step`."""
    turned, focal = dcm.copy(), lens[0] * np.exp(step[3])
    turn(turned, *step[:3])
    points = plane_points(spots, focal, lens[1:3] + lens[0] * step[6:], lens[3:] + step[4:6])
    return (rays(points) - stars @ turned.T).ravel()


def test_they_are_those_of_differences():
    rng = np.random.default_rng(4)
    dcm, lens = random_attitude(rng), np.array([1500.0, 12.0, -7.0, 0.08, -0.03])
    spots = rng.uniform(-600.0, 600.0, (15, 2))
    seen = rays(plane_points(spots, lens[0], lens[1:3], lens[3:])) + rng.normal(size=(15, 3)) * 1e-3
    stars = np.column_stack([seen / np.linalg.norm(seen, axis=1, keepdims=True) @ dcm, np.zeros(15)])
    star = np.arange(15)
    star[3] = -1
    normal, gradient = np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS)
    normal_equations(spots, star, stars, dcm, lens, np.empty((3, UNKNOWNS)), normal, gradient)
    used = star >= 0
    around = spots[used], stars[used, :3], dcm, lens
    J = np.column_stack(
        [(residuals(-s, *around) - residuals(s, *around)) / (2.0 * STEP) for s in STEP * np.eye(UNKNOWNS)]
    )
    assert normal == pytest.approx(J.T @ J, rel=1e-6, abs=1e-6)
    assert gradient == pytest.approx(J.T @ residuals(np.zeros(UNKNOWNS), *around), rel=1e-5, abs=1e-7)
