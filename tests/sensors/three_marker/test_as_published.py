"""As published: closed forms against the general solution, the error laws, and the criticised iteration.

The paper is Liu, Xu, Xu (2013),
"Vision-based relative navigation for autonomous rendezvous and docking of spacecraft".
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.accuracy.three_marker_trials import depth_iteration_success, small_angle_errors
from relnav.geometry.p3p import pose_of_congruent_triangles
from relnav.sensors.three_marker import closed_form_flat, closed_form_raised, depth_iteration, small_angle

RANGES_M = (0.75, 1.5, 3.0, 10.0, 30.0)


def paper_image(points, rng, largest_rad):
    """Image coordinates a = x/y, beta = z/y in the paper's axes, of a random pose; C from target to camera."""
    dcm = Rotation.from_rotvec(rng.uniform(-largest_rad, largest_rad, 3)).as_matrix()
    r = rng.uniform(1.5, 20.0)
    position = np.array([rng.uniform(-0.05, 0.05) * r, r, rng.uniform(-0.05, 0.05) * r])
    p = points @ dcm.T + position
    return p[:, 0] / p[:, 1], p[:, 2] / p[:, 1]


def general(a, beta, points, own):
    """The general 6 x 6 solution in camera axes, turned into the paper's."""
    pose = small_angle(np.stack([a, -beta], axis=-1), points, own.cam_from_paper)
    turn = Rotation.from_matrix(own.cam_from_paper.T @ pose[:3])
    return own.cam_from_paper.T @ pose[3], turn.as_rotvec()


def test_closed_form_of_a_flat_layout(own):
    """Any three markers in the plane; views whose 6 x 6 system is near singular compare to its rounding only."""
    rng = np.random.default_rng(1)
    compared = 0
    for _ in range(500):
        points = rng.uniform(-0.4, 0.4, (3, 3))
        points[:, 1] = 0.0
        a, beta = paper_image(points, rng, 0.1)
        r, phi = closed_form_flat(a, beta, points)
        r6, phi6 = general(a, beta, points, own)
        if np.linalg.norm(phi) > 0.5:
            continue  # no small angles; the rotation vector of the general form is then another
        compared += 1
        np.testing.assert_allclose(r, r6, atol=1e-9 * np.linalg.norm(r6))
        np.testing.assert_allclose(phi, phi6, atol=1e-9)
    assert compared > 250


def test_closed_form_of_a_raised_layout(own):
    rng = np.random.default_rng(2)
    for _ in range(500):
        b, c, h = rng.uniform(0.1, 0.5, 3)
        e = rng.uniform(-0.1, 0.5)
        points = np.array([[-b, 0.0, -c], [b, 0.0, -c], [0.0, -h, e]])
        a, beta = paper_image(points, rng, 0.05)
        r, phi = closed_form_raised(a, beta, b, c, h, e)
        r6, phi6 = general(a, beta, points, own)
        if np.linalg.norm(phi) > 0.5:
            continue
        np.testing.assert_allclose(r, r6, atol=1e-9 * np.linalg.norm(r6))
        np.testing.assert_allclose(phi, phi6, atol=1e-9 * (1.0 + np.linalg.norm(phi6)))


@pytest.mark.parametrize("range_m", RANGES_M)
@pytest.mark.parametrize("angle_deg", [1.0, 2.0, 5.0, 10.0, 15.0, 20.0])
def test_error_law_of_a_raised_layout(model, range_m, angle_deg):
    """About 0.007 theta^2 deg at every range: there the claim 'not limited by range' is true."""
    attitude, position = small_angle_errors(model, range_m, np.radians(angle_deg), 150, 3)
    assert 0.004 * angle_deg**2 < np.degrees(np.median(attitude)) < 0.009 * angle_deg**2
    assert np.median(position) / range_m < 2e-4 * angle_deg**2


@pytest.mark.parametrize("range_m", [0.75, 1.5, 3.0])
def test_error_law_of_a_flat_layout(flat, range_m):
    """About theta^2 r / (2 R): it grows with range, and the claim is false."""
    theta = np.radians(5.0)
    median = np.median(small_angle_errors(flat, range_m, theta, 300, 4)[0])
    assert median == pytest.approx(theta**2 * range_m / (2.0 * 0.3), rel=0.35)


@pytest.mark.parametrize("range_m", RANGES_M)
def test_three_passes_are_exact(model, range_m):
    attitude, _ = small_angle_errors(model, range_m, np.radians(10.0), 150, 5, passes=3)
    assert np.degrees(attitude.max()) < 1e-4
    assert np.degrees(np.median(attitude)) < 1e-5
    attitude, _ = small_angle_errors(model, range_m, np.radians(20.0), 100, 5, passes=6)
    assert np.degrees(attitude.max()) < 1e-9


def test_depth_iteration_depends_on_its_start(model, flat):
    """From equal depths it reaches the mirror image of a raised pattern, always, and often misses for a flat one."""
    ranges, largest = (1.5, 5.0, 15.0), np.radians(10.0)
    assert depth_iteration_success(model, ranges, largest, 60, 6) == 0.0
    assert 0.6 < depth_iteration_success(flat, ranges, largest, 150, 6) < 0.95


def test_depth_iteration_from_the_nominal_depths(model, own):
    """From the depths of the nominal attitude, 20 % off, it finds the truth; the two vectors then give the pose."""
    rng = np.random.default_rng(7)
    s = model.markers.points_m
    for range_m in (1.5, 5.0, 15.0):
        for _ in range(30):
            dcm, position = model.view.dcm_cam_from_target @ own.tilt(rng, 8.0), np.array([0.0, 0.0, range_m])
            p = s @ dcm.T + position
            rays = p / np.linalg.norm(p, axis=1)[:, None]
            nominal = np.linalg.norm(s @ model.view.dcm_cam_from_target.T + 1.2 * position, axis=1)
            d, steps = depth_iteration(rays, s, nominal)
            assert steps < 20
            np.testing.assert_allclose(d, np.linalg.norm(p, axis=1), rtol=1e-9)
            pose = np.empty((4, 3))
            assert pose_of_congruent_triangles(d[:, None] * rays, s, pose, np.empty((2, 4, 3)))
            np.testing.assert_allclose(pose, np.vstack([dcm, position]), atol=1e-7)


def test_depth_iteration_gives_up():
    d, steps = depth_iteration(np.tile([0.0, 0.0, 1.0], (3, 1)), np.eye(3), np.ones(3))
    assert np.isnan(d).all()
    assert steps == 50
    assert np.isnan(depth_iteration(np.eye(3), 10.0 * np.eye(3), np.array([1.0, -1.0, 1.0]), most=2)[0]).all()


def test_a_singular_view_has_no_small_angle_solution(own):
    """A vertex raised by 0.3 m seen from 0.75 m: the camera is on the danger cylinder."""
    R, h = 0.3, 0.3
    points = R * np.array([[-np.sqrt(0.75), 0, -0.5], [np.sqrt(0.75), 0, -0.5], [0.0, -h / R, 1.0]])
    p = points + np.array([0.0, 0.75, 0.0])
    xy = np.stack([p[:, 0] / p[:, 1], -p[:, 2] / p[:, 1]], axis=-1)
    pose = small_angle(xy, points, own.cam_from_paper)
    assert pose.shape == (4, 3)
    assert np.isnan(pose).all()
    p = points + np.array([0.0, 0.9, 0.0])
    xy = np.stack([p[:, 0] / p[:, 1], -p[:, 2] / p[:, 1]], axis=-1)
    pose = small_angle(xy, points, own.cam_from_paper)
    assert pose.shape == (4, 3)
    np.testing.assert_allclose(pose[3], [0.0, 0.0, 0.9], atol=1e-12)


def test_more_markers_by_least_squares(five):
    attitude, _ = small_angle_errors(five, 5.0, np.radians(3.0), 50, 8)
    assert np.degrees(np.median(attitude)) < 0.07
    attitude, _ = small_angle_errors(five, 5.0, np.radians(3.0), 50, 8, passes=4)
    assert np.degrees(attitude.max()) < 1e-9
