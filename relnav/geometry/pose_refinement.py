"""Gauss-Newton of a pose on image points, any number of them, with the information that they hold.

Residuals stand in the normalised image plane, (x, y) = (p_x, p_y) / p_z with p = C s + r, weighted by the information
of each point, so that pixel noise under a lens with distortion is right to first order. Errors of the pose are
(dr, dtheta): r in camera axes, m, and C = C_hat exp([dtheta x]) in target axes, rad. Jacobian of p: [I | -C [s x]].
"""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import cholesky, solve_positive
from relnav.geometry.rotation_vector import turn_by_rotation_vector

WORK_ROWS = 6
BEHIND = -1
UNSETTLED = -2

_MAX_STEPS = 60
_SETTLED = 1e-12  # of chi-square: a step that promises less is the last, a millionth of a sigma
_LEAST_DAMPING = 1e-6
PIVOT = 1e-13  # of its diagonal: a smaller Cholesky pivot is a direction that the points do not see


@kernel
def pose_information(
    points: Matrix, image: Matrix, weights: Matrix, pose: Matrix, information: Matrix, gradient: Vector
) -> float:
    """Write the information (6, 6) and gradient (6,) of the misfit at a pose; returns the misfit, chi-square.

    points (n, 3) m, image (n, 2) with NaN rows left out, weights (n, 3): w_xx, w_xy, w_yy. Infinite where a point that
    is seen lies behind the camera.
    """
    for i in range(6):
        gradient[i] = 0.0
        for j in range(6):
            information[i, j] = 0.0
    chi2 = 0.0
    for k in range(points.shape[0]):
        if image[k, 0] != image[k, 0]:
            continue
        s0, s1, s2 = points[k, 0], points[k, 1], points[k, 2]
        z = pose[2, 0] * s0 + pose[2, 1] * s1 + pose[2, 2] * s2 + pose[3, 2]
        if not z > 0.0:
            return math.inf
        x = (pose[0, 0] * s0 + pose[0, 1] * s1 + pose[0, 2] * s2 + pose[3, 0]) / z
        y = (pose[1, 0] * s0 + pose[1, 1] * s1 + pose[1, 2] * s2 + pose[3, 1]) / z
        ex, ey = x - image[k, 0], y - image[k, 1]
        wxx, wxy, wyy = weights[k, 0], weights[k, 1], weights[k, 2]
        gx, gy = wxx * ex + wxy * ey, wxy * ex + wyy * ey
        chi2 += ex * gx + ey * gy
        # C^T times the rows (1, 0, -x) / z and (0, 1, -y) / z of dh/dp, then s x that: the rows' attitude part
        a0, a1, a2 = (
            (pose[0, 0] - x * pose[2, 0]) / z,
            (pose[0, 1] - x * pose[2, 1]) / z,
            (pose[0, 2] - x * pose[2, 2]) / z,
        )
        b0, b1, b2 = (
            (pose[1, 0] - y * pose[2, 0]) / z,
            (pose[1, 1] - y * pose[2, 1]) / z,
            (pose[1, 2] - y * pose[2, 2]) / z,
        )
        jx = (1.0 / z, 0.0, -x / z, s1 * a2 - s2 * a1, s2 * a0 - s0 * a2, s0 * a1 - s1 * a0)
        jy = (0.0, 1.0 / z, -y / z, s1 * b2 - s2 * b1, s2 * b0 - s0 * b2, s0 * b1 - s1 * b0)
        for i in range(6):
            gradient[i] += jx[i] * gx + jy[i] * gy
            wx, wy = wxx * jx[i] + wxy * jy[i], wxy * jx[i] + wyy * jy[i]
            for j in range(i + 1):
                information[i, j] += wx * jx[j] + wy * jy[j]
    for i in range(6):
        for j in range(i):
            information[j, i] = information[i, j]
    return chi2


def invertible(information: Matrix) -> bool:
    """Whether an information matrix (6, 6) fixes all six directions of a pose beyond rounding."""
    return bool(cholesky(information, PIVOT, np.empty((6, 6))))


@kernel
def _stepped(pose: Matrix, step: Vector, work: Matrix, out: Matrix) -> None:
    """Write the pose moved by minus the step into out (4, 3)."""
    for j in range(3):
        out[3, j] = pose[3, j] - step[j]
        work[0, j] = -step[3 + j]
    turn_by_rotation_vector(pose, work[0], out)


@kernel
def refine_pose(
    points: Matrix, image: Matrix, weights: Matrix, pose: Matrix, information: Matrix, work: Stack
) -> tuple[int, float]:
    """Improve pose (4, 3) in place and write its information (6, 6); returns steps taken and the misfit chi-square.

    Steps below zero: BEHIND (a point is behind the camera at the start) or UNSETTLED (where two solutions merge the
    misfit is flat; the pose is near the best). points, image, weights as in `pose_information`; work (6, 6, 6) is
    scratch. Gauss-Newton; a step that does not lessen the misfit is damped (Levenberg and Marquardt).
    """
    gradient, step, trial_gradient = work[0, 0], work[0, 1], work[0, 2]
    trial, small, factor, spare, damped = work[1], work[2], work[3], work[4], work[5]
    chi2 = pose_information(points, image, weights, pose, information, gradient)
    if not chi2 < math.inf:
        return BEHIND, chi2
    damping = 0.0
    for count in range(_MAX_STEPS):
        for i in range(6):
            step[i] = gradient[i]
            for j in range(6):
                damped[i, j] = information[i, j] * (1.0 + damping if i == j else 1.0)
        solved = solve_positive(damped, step, PIVOT, factor)
        fall, now = 0.0, math.inf
        if solved:
            for i in range(6):
                fall += gradient[i] * step[i]  # of chi-square, as the step promises
            _stepped(pose, step, small, trial)
            now = pose_information(points, image, weights, trial, spare, trial_gradient)
        if not now <= chi2 * (1.0 + 1e-12) + 1e-15:
            if solved and fall < _SETTLED * (1.0 + chi2):
                return count, chi2
            damping = max(_LEAST_DAMPING, 10.0 * damping)
            continue
        for i in range(4):
            for j in range(3):
                pose[i, j] = trial[i, j]
        for i in range(6):
            gradient[i] = trial_gradient[i]
            for j in range(6):
                information[i, j] = spare[i, j]
        chi2 = now
        if fall < _SETTLED * (1.0 + chi2):
            return count + 1, chi2
        damping = 0.1 * damping if damping > _LEAST_DAMPING else 0.0
    return UNSETTLED, chi2
