"""Gauss-Newton of a pose on image points, any number of them, with the information that they hold.

Residuals stand in the normalised image plane (x, y) = (p_x, p_y) / p_z, p = C s + r, weighted by the 2 x 2 information
of each point, so that pixel noise under a lens with distortion is treated exactly to first order. Errors of the pose are
(dr, dtheta): r in camera axes, m, and C = C_hat exp([dtheta x]) in target axes, rad. Jacobian of p: [I | -C [s x]].
"""

import math

from relnav._kernel import kernel
from relnav.arrays import Matrix, Stack, Vector
from relnav.geometry.rotation_vector import turn_by_rotation_vector

WORK_ROWS = 9
SINGULAR = -1
UNSETTLED = -2

_MAX_STEPS = 40
_PIVOT = 1e-13  # of its diagonal: a smaller Cholesky pivot is a direction that the points do not see


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
        a0, a1, a2 = (pose[0, 0] - x * pose[2, 0]) / z, (pose[0, 1] - x * pose[2, 1]) / z, (pose[0, 2] - x * pose[2, 2]) / z
        b0, b1, b2 = (pose[1, 0] - y * pose[2, 0]) / z, (pose[1, 1] - y * pose[2, 1]) / z, (pose[1, 2] - y * pose[2, 2]) / z
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


@kernel
def solve_positive(matrix: Matrix, right: Vector, factor: Matrix) -> bool:
    """Solve matrix x = right in place for a symmetric (6, 6) by Cholesky; False if it is singular to rounding."""
    for i in range(6):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > _PIVOT * matrix[i, i]:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for i in range(6):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            right[i] -= factor[k, i] * right[k]
        right[i] /= factor[i, i]
    return True


@kernel
def _stepped(pose: Matrix, step: Vector, share: float, work: Matrix, out: Matrix) -> None:
    """Write the pose moved by a share of minus the step into out (4, 3)."""
    for j in range(3):
        out[3, j] = pose[3, j] - share * step[j]
        work[0, j] = -share * step[3 + j]
    turn_by_rotation_vector(pose, work[0], out)


@kernel
def refine_pose(
    points: Matrix, image: Matrix, weights: Matrix, pose: Matrix, information: Matrix, work: Stack
) -> tuple[int, float]:
    """Improve pose (4, 3) in place and write its information (6, 6); returns steps taken and the misfit chi-square.

    Steps below zero: SINGULAR (the points do not fix the pose there) or UNSETTLED. points, image, weights as in
    `pose_information`; work (9, 6, 6) is scratch. A step that does not lessen the misfit is halved.
    """
    step, trial, trial_step, small, factor, spare = work[0, 0], work[1], work[2, 0], work[3], work[4], work[5]
    chi2 = pose_information(points, image, weights, pose, information, step)
    if not chi2 < math.inf:
        return UNSETTLED, chi2
    for count in range(_MAX_STEPS):
        slope = 0.0
        for i in range(6):
            trial_step[i] = step[i]
        if not solve_positive(information, step, factor):
            return SINGULAR, chi2
        for i in range(6):
            slope += trial_step[i] * step[i]  # the fall of chi-square that the step promises
        share, accepted = 1.0, False
        for _ in range(12):
            _stepped(pose, step, share, small, trial)
            now = pose_information(points, image, weights, trial, spare, trial_step)
            if now <= chi2 * (1.0 + 1e-12) + 1e-15:
                accepted = True
                break
            share *= 0.5
        if not accepted:
            return (count, chi2) if slope < 1e-9 * (1.0 + chi2) else (UNSETTLED, chi2)
        for i in range(4):
            for j in range(3):
                pose[i, j] = trial[i, j]
        for i in range(6):
            step[i] = trial_step[i]
            for j in range(6):
                information[i, j] = spare[i, j]
        chi2 = now
        if slope < 1e-12 * (1.0 + chi2):
            return count + 1, chi2
    return UNSETTLED, chi2
