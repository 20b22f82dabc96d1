"""Steps of a star camera's fit: attitude, focal length, distortion and principal point from its matches."""

import math

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.geometry.linear_algebra import cholesky, solve_lower, solve_lower_transposed
from relnav.sensors.dual_field.matching import turn

UNKNOWNS = 8
"""Three rotations, log focal length, k1, k2, principal point in focal lengths."""

FOCAL, CX, CY, K1, K2, LENS_NUMBERS = range(6)
"""Entries of `lens`; lengths in px."""

STEP_ROWS = 5 + UNKNOWNS
"""Rows of scratch for `step_camera`."""

RIDGE = 1e-10
"""Added to the normal equations, relative to their diagonal: what matches do not tell (k1 and k2 apart where all spots
are as far from the axis) stays as it was."""


@kernel
def normal_equations(
    spots: Matrix, star: Codes, stars: Matrix, A: Matrix, lens: Vector, J: Matrix, normal: Matrix, gradient: Vector
) -> None:
    """Write the sums over spots (n, 2) that have a star of J^T J (8, 8) and J^T r (8,); J (3, 8) is scratch.

    lens (5,): focal length, principal point, k1, k2. With the ray w, its prediction q = A v and the residual w - q,
    rows of J say how q moves away from w: by -d x q under a rotation d, and as w moves back under the others.
    """
    f, cx, cy, k1, k2 = lens[0], lens[1], lens[2], lens[3], lens[4]
    for row in range(UNKNOWNS):
        gradient[row] = 0.0
        for column in range(UNKNOWNS):
            normal[row, column] = 0.0
    for k in range(spots.shape[0]):
        s = star[k]
        if s < 0:
            continue
        x, y = (spots[k, 0] - cx) / f, (spots[k, 1] - cy) / f
        r2 = x * x + y * y
        scale, bend = 1.0 + r2 * (k1 + k2 * r2), 2.0 * (k1 + 2.0 * k2 * r2)
        px, py = x * scale, y * scale
        w2 = 1.0 / math.sqrt(1.0 + px * px + py * py)
        w0, w1 = px * w2, py * w2
        v0, v1, v2 = stars[s, 0], stars[s, 1], stars[s, 2]
        q0 = A[0, 0] * v0 + A[0, 1] * v1 + A[0, 2] * v2
        q1 = A[1, 0] * v0 + A[1, 1] * v1 + A[1, 2] * v2
        q2 = A[2, 0] * v0 + A[2, 1] * v1 + A[2, 2] * v2
        J[0, 0], J[0, 1], J[0, 2] = 0.0, -q2, q1
        J[1, 0], J[1, 1], J[1, 2] = q2, 0.0, -q0
        J[2, 0], J[2, 1], J[2, 2] = -q1, q0, 0.0
        grown = scale + bend * r2
        for column in range(5):  # minus the derivative of the point on the plane z = 1
            a, b = x * grown, y * grown
            if column == 1:
                a, b = -x * r2, -y * r2
            elif column == 2:
                a, b = -x * r2 * r2, -y * r2 * r2
            elif column == 3:
                a, b = scale + bend * x * x, bend * x * y
            elif column == 4:
                a, b = bend * x * y, scale + bend * y * y
            along = w0 * a + w1 * b
            J[0, 3 + column], J[1, 3 + column] = (a - w0 * along) * w2, (b - w1 * along) * w2
            J[2, 3 + column] = -w2 * along * w2
        for row in range(UNKNOWNS):
            gradient[row] += J[0, row] * (w0 - q0) + J[1, row] * (w1 - q1) + J[2, row] * (w2 - q2)
            for column in range(UNKNOWNS):
                normal[row, column] += J[0, row] * J[0, column] + J[1, row] * J[1, column] + J[2, row] * J[2, column]


@entry
def step_camera(
    spots: Matrix,
    star: Codes,
    stars: Matrix,
    A: Matrix,
    lens: Vector,
    variance: float,
    free: int,
    axis_px: float,
    most: int,
    settled: float,
    work: Matrix,
    covariance: Matrix,
) -> float:
    """Gauss-Newton steps, at most so many, until one is shorter than `settled`: the length of the last, in sigmas.

    Changes attitude and lens, writes the covariance (8, 8), zero for what is kept: of the first six unknowns all but
    the first `free`, and the principal point unless its 1-sigma from the image's centre, `axis_px`, is above 0.
    work (STEP_ROWS, 8) is scratch.
    """
    J, step, downhill, normal, length = work[0:3], work[3], work[4], work[5:STEP_ROWS], 0.0
    for _ in range(most):
        normal_equations(spots, star, stars, A, lens, J, normal, step)
        for r in range(UNKNOWNS):
            step[r] /= variance
            for c in range(UNKNOWNS):
                normal[r, c] /= variance
        if axis_px > 0.0:
            information = (lens[FOCAL] / axis_px) ** 2
            for r in range(2):
                normal[6 + r, 6 + r] += information
                step[6 + r] -= information * lens[CX + r] / lens[FOCAL]
        for r in range(UNKNOWNS):
            kept = free <= r < 6 or (r >= 6 and not axis_px > 0.0)
            if kept:
                step[r] = 0.0
                for c in range(UNKNOWNS):
                    normal[r, c], normal[c, r] = 0.0, 0.0
                normal[r, r] = 1.0
            downhill[r] = step[r]
            normal[r, r] *= 1.0 + RIDGE
        if not cholesky(normal, 0.0, normal):
            return math.inf
        solve_lower(normal, step)
        solve_lower_transposed(normal, step)
        length = 0.0
        for r in range(UNKNOWNS):
            length += step[r] * downhill[r]
        length = math.sqrt(max(0.0, length))
        turn(A, step[0], step[1], step[2])
        for r in range(2):
            lens[CX + r] += lens[FOCAL] * step[6 + r]
            lens[K1 + r] += step[4 + r]
        lens[FOCAL] *= math.exp(min(0.1, max(-0.1, step[3])))
        if length < settled:
            break
    for r in range(UNKNOWNS):
        kept = free <= r < 6 or (r >= 6 and not axis_px > 0.0)
        for c in range(UNKNOWNS):
            covariance[r, c] = 0.0
        if not kept:
            covariance[r, r] = 1.0
            solve_lower(normal, covariance[r])
            solve_lower_transposed(normal, covariance[r])
    return length
