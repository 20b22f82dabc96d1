"""Every derivative of the spots against central differences of an independent chain of frames."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.sensors.three_marker import project, spot_jacobians

ZERO = np.zeros(3)


@pytest.fixture(scope="module")
def scene(with_lens):
    rng = np.random.default_rng(1)
    mount = Rotation.from_rotvec([0.2, -0.1, 0.3])
    camera = dataclasses.replace(
        with_lens.camera, position_m=(0.4, -0.2, 0.1), q_cam_from_chaser=tuple(mount.as_quat().tolist())
    )
    points = with_lens.markers.points_m
    dcm = with_lens.view.dcm_cam_from_target @ Rotation.from_rotvec(rng.uniform(-0.2, 0.2, 3)).as_matrix()
    return camera, points, dcm, np.array([0.3, -0.2, 4.0])


def spots(scene, *, dr=0.0, theta=ZERO, ds=0.0, dc=ZERO, eps=ZERO, alpha=ZERO):
    """Spots with everything a little off, by frames: target and chaser stand still in space, the camera may not."""
    camera, points, dcm, position = scene
    mount, lever = camera.dcm_cam_from_chaser, np.array(camera.position_m)
    p = (points + ds) @ (dcm @ Rotation.from_rotvec(theta).as_matrix()).T + position + dr
    inertial = p @ mount + lever  # from the chaser's centre of mass, axes that stay
    in_chaser = inertial @ Rotation.from_rotvec(-alpha).as_matrix().T
    in_camera = (in_chaser - lever - dc) @ (Rotation.from_rotvec(-eps).as_matrix() @ mount).T
    return project(in_camera, camera).spots_px


@pytest.mark.parametrize(
    ("name", "argument"),
    [
        ("position", "dr"),
        ("attitude", "theta"),
        ("marker", "ds"),
        ("lever_arm", "dc"),
        ("mounting", "eps"),
        ("chaser_attitude", "alpha"),
    ],
)
def test_jacobian(scene, truth, name, argument):
    camera, points, dcm, position = scene
    jacobian = getattr(spot_jacobians(points, np.vstack([dcm, position]), camera), name)
    expected = truth.derivative(lambda x: spots(scene, **{argument: x}), np.zeros(3), 1e-3).reshape(jacobian.shape)
    assert np.abs(jacobian - expected).max() < 1e-7 * np.abs(expected).max()


def test_a_marker_that_is_not_visible_has_none(scene):
    camera, points, dcm, position = scene
    jacobian = spot_jacobians(points, np.vstack([dcm, -position]), camera)
    assert np.isnan(jacobian.position).all()
