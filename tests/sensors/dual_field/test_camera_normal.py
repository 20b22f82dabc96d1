"""The normal equations of a star camera's fit against differences of the rays themselves."""

import numpy as np
import pytest

from relnav.sensors.dual_field.camera_fit import _Camera
from relnav.sensors.dual_field.camera_normal import STEP_ROWS, UNKNOWNS, normal_equations, step_camera
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


def exact_frame(points):
    """Stars of a camera without noise, whose axis is the image's centre: spots, stars, attitude, lens."""
    rng = np.random.default_rng(5)
    dcm, lens = random_attitude(rng), np.array([1500.0, 0.0, 0.0, 0.05, 0.0])
    seen = rays(plane_points(points, lens[0], lens[1:3], lens[3:]))
    return points, np.column_stack([seen @ dcm, np.zeros(len(points))]), dcm, lens


def test_steps_lead_to_the_camera():
    """From an attitude and a lens that are off; the covariance is the inverse of the normal equations."""
    spots, stars, dcm, lens = exact_frame(np.random.default_rng(7).uniform(-600.0, 600.0, (25, 2)))
    A, found, star = dcm.copy(), np.array([1540.0, 0.0, 0.0, 0.0, 0.0]), np.arange(25)
    turn(A, 2e-3, -1e-3, 3e-3)
    covariance, variance = np.empty((UNKNOWNS, UNKNOWNS)), 1e-8
    work = np.empty((STEP_ROWS, UNKNOWNS))
    length = step_camera(spots, star, stars, A, found, variance, 5, 10.0, 8, 1e-6, work, covariance)
    assert length < 1e-6
    assert found == pytest.approx(lens, abs=1e-5)
    assert pytest.approx(dcm, abs=1e-8) == A
    normal, gradient = np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS)
    normal_equations(spots, star, stars, A, found, np.empty((3, UNKNOWNS)), normal, gradient)
    used = [0, 1, 2, 3, 4, 6, 7]
    information = normal[np.ix_(used, used)] / variance
    information[5:, 5:] += np.eye(2) * (found[0] / 10.0) ** 2
    assert covariance[np.ix_(used, used)] == pytest.approx(np.linalg.inv(information), rel=1e-5, abs=1e-14)
    assert not covariance[5].any()
    assert not covariance[:, 5].any()


def test_what_matches_do_not_tell_stays_as_it_was():
    """Spots as far from the axis as one another say one number of the lens, not three: the fit still is one."""
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    spots, stars, dcm, _ = exact_frame(500.0 * np.column_stack([np.cos(angle), np.sin(angle)]))
    A, found = dcm.copy(), np.array([1510.0, 0.0, 0.0, 0.0, 0.0])
    turn(A, 1e-3, -1e-3, 1e-3)
    covariance, work = np.empty((UNKNOWNS, UNKNOWNS)), np.empty((STEP_ROWS, UNKNOWNS))
    step_camera(spots, np.arange(12), stars, A, found, 1e-8, 6, 0.0, 8, 1e-6, work, covariance)
    seen = rays(plane_points(spots, found[0], found[1:3], found[3:]))
    assert np.abs(seen - stars[:, :3] @ A.T).max() < 1e-6
    assert np.abs(found[3:]).max() < 0.5


@pytest.mark.parametrize("off_rad", [0.0, 0.02, 0.1, 0.4])
def test_z_looks_through_the_image_centre(off_rad):
    """To rounding, however far the axis is from the image's centre, and turned the shortest way."""
    rng = np.random.default_rng(6)
    lens = np.array([1500.0, *(1500.0 * np.tan(off_rad) * np.array([0.6, -0.8])), 0.0, 0.0])
    camera = _Camera(np.zeros((1, 2)), False, random_attitude(rng), lens, 1e-8)
    dcm, _ = camera.about_centre(np.eye(UNKNOWNS))
    centre = camera.rays(np.zeros((1, 2)))[0]
    assert dcm @ camera.dcm.T @ centre == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert np.trace(dcm @ camera.dcm.T) == pytest.approx(1.0 + 2.0 * np.cos(off_rad), abs=1e-14)
    assert dcm @ dcm.T == pytest.approx(np.eye(3), abs=1e-14)
