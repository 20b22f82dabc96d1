"""Gauss-Newton of a pose: derivatives against differences, the least-squares pose of scipy, and what cannot be seen."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from relnav.codegen.kernel import is_compiled, kernel
from relnav.geometry.pose_refinement import (
    BEHIND,
    WORK_ROWS,
    invertible,
    pose_information,
    refine_pose,
)

POINTS = np.array([[0.0, 0.3, 0.3], [0.0, -0.3, 0.3], [0.3, 0.0, 0.0], [0.0, 0.2, -0.3], [-0.1, -0.2, -0.25]])


def image(points, dcm, position):
    p = points @ dcm.T + position
    return p[:, :2] / p[:, 2:]


def example(seed=1, count=5, noise=0.0):
    rng = np.random.default_rng(seed)
    dcm = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)).as_matrix()
    position = np.array([0.2, -0.1, 3.0])
    root = rng.normal(size=(count, 2, 2)) + 3.0 * np.eye(2)
    matrices = 1e6 * root @ np.swapaxes(root, 1, 2)
    weights = np.stack([matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]], axis=-1)
    xy = image(POINTS[:count], dcm, position) + noise * rng.normal(size=(count, 2))
    return POINTS[:count], xy, weights, matrices, dcm, position


def moved(dcm, position, x):
    return dcm @ Rotation.from_rotvec(x[3:]).as_matrix(), position + x[:3]


def refine(points, xy, weights, start):
    pose, information = np.array(start), np.empty((6, 6))
    steps, misfit = refine_pose(points, xy, weights, pose, information, np.empty((WORK_ROWS, 6, 6)))
    return steps, misfit, pose, information


def test_gradient_and_information_jacobian(truth):
    """Gradient = half the derivative of chi-square; information = J^T W J with J by central differences."""
    points, xy, weights, matrices, dcm, position = example(noise=1e-3)
    information, gradient = np.empty((6, 6)), np.empty(6)
    misfit = pose_information(points, xy, weights, np.vstack([dcm, position]), information, gradient)

    def residual(x):
        return image(points, *moved(dcm, position, x)) - xy

    J = truth.derivative(residual, np.zeros(6), 1e-3).reshape(-1, 2, 6)
    e = residual(np.zeros(6))
    assert misfit == pytest.approx(np.einsum("ni,nij,nj->", e, matrices, e), rel=1e-12)
    np.testing.assert_allclose(gradient, np.einsum("nik,nij,nj->k", J, matrices, e), rtol=1e-7)
    np.testing.assert_allclose(information, np.einsum("nik,nij,njl->kl", J, matrices, J), rtol=1e-7, atol=1.0)


@pytest.mark.parametrize("seed", range(5))
def test_the_least_squares_pose(seed):
    points, xy, weights, matrices, dcm, position = example(seed, noise=2e-4)
    chol = np.linalg.cholesky(matrices)

    def residual(x):
        e = image(points, *moved(dcm, position, x)) - xy
        return np.einsum("nji,nj->ni", chol, e).ravel()

    best = least_squares(residual, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    start = np.vstack(
        [dcm @ Rotation.from_rotvec([0.1, -0.05, 0.08]).as_matrix(), position + np.array([0.1, 0.05, -0.3])]
    )
    steps, misfit, pose, information = refine(points, xy, weights, start)
    assert 0 < steps < 15
    assert misfit == pytest.approx(2.0 * best.cost, rel=1e-9)
    wanted, place = moved(dcm, position, best.x)
    np.testing.assert_allclose(pose[:3], wanted, atol=1e-7)
    np.testing.assert_allclose(pose[3], place, atol=1e-7)
    assert invertible(information)


def test_points_not_seen_are_left_out():
    points, xy, weights, _, dcm, position = example()
    xy[3] = np.nan
    _, misfit, pose, information = refine(points, xy, weights, np.vstack([dcm, position + 0.01]))
    kept = [0, 1, 2, 4]
    _, _, _, expected = refine(points[kept], xy[kept], weights[kept], np.vstack([dcm, position + 0.01]))
    assert misfit < 1e-12
    np.testing.assert_allclose(pose[3], position, atol=1e-9)
    np.testing.assert_allclose(information, expected, rtol=1e-9, atol=1e-3)


def test_a_point_behind_the_camera():
    points, xy, weights, _, dcm, position = example()
    steps, misfit, _, _ = refine(points, xy, weights, np.vstack([dcm, -position]))
    assert steps == BEHIND
    assert misfit == np.inf


def test_two_points_fix_no_pose():
    points, xy, weights, _, dcm, position = example(count=2)
    information = np.empty((6, 6))
    pose_information(points, xy, weights, np.vstack([dcm, position]), information, np.empty(6))
    assert not invertible(information)


def test_collinear_points_fix_no_pose():
    _, _, weights, _, dcm, position = example()
    points = np.outer(np.linspace(-0.3, 0.3, 5), [0.2, 0.5, 0.8])
    information = np.empty((6, 6))
    pose_information(
        points, image(points, dcm, position), weights, np.vstack([dcm, position]), information, np.empty(6)
    )
    assert not invertible(information)


@kernel
def _many(points, xy, weights, start, pose, information, work, times):
    total = 0
    for _ in range(times):
        for i in range(4):
            for j in range(3):
                pose[i, j] = start[i, j]
        steps, _misfit = refine_pose(points, xy, weights, pose, information, work)
        total += steps
    return total


@pytest.mark.skipif(not is_compiled(), reason="plain Python allocates")
def test_compiled_code_allocates_nothing():
    from numba.core.runtime import _nrt_python, rtsys

    points, xy, weights, _, dcm, position = example(noise=1e-4)
    start = np.vstack([dcm, position + 0.05])
    scratch = np.empty((4, 3)), np.empty((6, 6)), np.empty((WORK_ROWS, 6, 6))
    assert _many(points, xy, weights, start, *scratch, 1) > 1
    was_on = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    counts = []
    for times in (0, 1, 1000):
        before = rtsys.get_allocation_stats().alloc
        _many(points, xy, weights, start, *scratch, times)
        counts.append(rtsys.get_allocation_stats().alloc - before)
    if not was_on:
        _nrt_python.memsys_disable_stats()
    assert counts[0] == counts[1] == counts[2]
