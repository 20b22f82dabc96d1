"""Pose from three points seen along three known directions: every real solution of the perspective three-point problem.

With unit rays m_i to points s_i at slant distances d_i, the three chords e_ij = |m_i - m_j|^2 and squared sides
A_ij = |s_i - s_j|^2 must agree,

    (d_i - d_j)^2 + d_i d_j e_ij = A_ij.                                                                          (1)

The ratios d_1/d_3 = 1 + xi, d_2/d_3 = 1 + eta leave two conics in (xi, eta), met in `conic_pencil`. Chords, never
1 - cos, and ratios about 1, scaled by the largest chord, keep every number of order one at any range; cosines would
lose half of the digits. Up to four solutions; a double one (on the danger cylinder) may be reported twice.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.conic_pencil import Conic, degenerate_member, line_pair, meet
from relnav.geometry.rotation import triad

BLOCK = 7
"""Poses that `solve_p3p` needs room for: four results, then scratch."""

_MISFIT = 1e-8  # of A_ij: equation (1) left unsatisfied by more is no solution


@kernel
def _distance2(v: Matrix, i: int, j: int) -> float:
    d0, d1, d2 = v[i, 0] - v[j, 0], v[i, 1] - v[j, 1], v[i, 2] - v[j, 2]
    return float(d0 * d0 + d1 * d1 + d2 * d2)


@kernel
def _polish(
    d1: float, d2: float, d3: float, e12: float, e13: float, e23: float, A12: float, A13: float, A23: float
) -> tuple[bool, float, float, float]:
    """Newton on (1) from a root to a better one; False if the distances do not satisfy (1).

    Other roots lie A/d away: a step that long would jump to one of them and is not taken, nor one that does not help.
    """
    limit = 0.05 * min(A12, A13, A23) / max(d1, d2, d3)
    f12 = (d1 - d2) ** 2 + d1 * d2 * e12 - A12
    f13 = (d1 - d3) ** 2 + d1 * d3 * e13 - A13
    f23 = (d2 - d3) ** 2 + d2 * d3 * e23 - A23
    misfit = max(abs(f12) / A12, abs(f13) / A13, abs(f23) / A23)
    for _ in range(3):
        a1, a2 = 2.0 * (d1 - d2) + d2 * e12, 2.0 * (d2 - d1) + d1 * e12
        b1, b3 = 2.0 * (d1 - d3) + d3 * e13, 2.0 * (d3 - d1) + d1 * e13
        c2, c3 = 2.0 * (d2 - d3) + d3 * e23, 2.0 * (d3 - d2) + d2 * e23
        det = -a1 * b3 * c2 - a2 * b1 * c3
        if det == 0.0:
            break
        s1 = (-f12 * b3 * c2 - a2 * (f13 * c3 - b3 * f23)) / det
        s2 = (a1 * (f13 * c3 - b3 * f23) - f12 * b1 * c3) / det
        s3 = (a1 * (-c2 * f13) + f12 * b1 * c2 - a2 * b1 * f23) / det
        if not max(abs(s1), abs(s2), abs(s3)) < limit:
            break
        t1, t2, t3 = d1 - s1, d2 - s2, d3 - s3
        f12 = (t1 - t2) ** 2 + t1 * t2 * e12 - A12
        f13 = (t1 - t3) ** 2 + t1 * t3 * e13 - A13
        f23 = (t2 - t3) ** 2 + t2 * t3 * e23 - A23
        now = max(abs(f12) / A12, abs(f13) / A13, abs(f23) / A23)
        if not now < misfit:
            break
        d1, d2, d3, misfit = t1, t2, t3, now
    return misfit < _MISFIT, d1, d2, d3


@kernel
def pose_of_congruent_triangles(p: Matrix, s: Matrix, pose: Matrix, work: Stack) -> bool:
    """Write the pose with p_i = C s_i + r into pose (4, 3): rows 0-2 the rotation C, row 3 the position r.

    The two-vector attitude of two congruent triangles (rows of p and s (3, 3)). work (2, 4, 3) scratch; False if the
    triangle is flat.
    """
    a, b = work[0], work[1]
    for j in range(3):
        a[3, j], pose[3, j] = s[1, j] - s[0, j], s[2, j] - s[0, j]
    if not triad(a[3], pose[3], a[0:3]):
        return False
    for j in range(3):
        b[3, j], pose[3, j] = p[1, j] - p[0, j], p[2, j] - p[0, j]
    if not triad(b[3], pose[3], b[0:3]):
        return False
    for i in range(3):
        for j in range(3):
            pose[i, j] = b[0, i] * a[0, j] + b[1, i] * a[1, j] + b[2, i] * a[2, j]
    for i in range(3):
        total = 0.0
        for k in range(3):
            total += p[k, i] - pose[i, 0] * s[k, 0] - pose[i, 1] * s[k, 1] - pose[i, 2] * s[k, 2]
        pose[3, i] = total / 3.0
    return True


@kernel
def _are_finite(rows: Matrix) -> bool:
    """Infinities would be a warning in plain Python."""
    for i in range(3):
        for j in range(3):
            if not math.isfinite(rows[i, j]):
                return False
    return True


@kernel
def solve_p3p(rays: Matrix, points: Matrix, near: bool, poses: Stack) -> int:
    """Write every pose from which the points are seen along the rays into poses; returns how many, 0 to 4.

    near: two complex solutions count as one pose, their real part. Noise turns two real solutions that lie close
    together into such a pair; it satisfies (1) only nearly.

    rays (3, 3): unit vectors, camera axes, rows; points (3, 3): the same points in target axes, m. poses (7, 4, 3): the
    first that many hold rows 0-2 dcm_cam_from_target, row 3 the target's origin in camera axes, m; the rest is scratch.
    """
    if not (_are_finite(rays) and _are_finite(points)):
        return 0
    A01, A02, A12 = _distance2(points, 0, 1), _distance2(points, 0, 2), _distance2(points, 1, 2)
    i1, i2, i3 = 0, 1, 2  # the longest side between the last two: both conics then have coefficients of at most order 1
    if A02 >= A01 and A02 >= A12:
        i1, i2, i3 = 1, 0, 2
    elif A01 >= A12:
        i1, i2, i3 = 2, 0, 1
    A12, A13, A23 = _distance2(points, i1, i2), _distance2(points, i1, i3), _distance2(points, i2, i3)
    e12, e13, e23 = _distance2(rays, i1, i2), _distance2(rays, i1, i3), _distance2(rays, i2, i3)
    scale = math.sqrt(max(e12, e13, e23))
    if not (min(A12, A13) > 1e-24 * A23 and scale > 0.0):
        return 0
    a, b, g = A12 / A23, A13 / A23, 1.0 / (scale * scale)
    c1: Conic = (1.0, 0.5 * e12 - 1.0, 1.0 - a, 0.5 * e12 / scale, 0.5 * (e12 - a * e23) / scale, (e12 - a * e23) * g)
    c2: Conic = (1.0, 0.0, -b, 0.5 * e13 / scale, -0.5 * b * e23 / scale, (e13 - b * e23) * g)
    member, least_c2 = degenerate_member(c1, c2)
    real, line0, line1 = line_pair(member)
    count = 0
    if not real:
        return 0
    p = poses[4]
    for line in (line0, line1):
        met, x0, y0, x1, y1 = meet(line, c2 if least_c2 else c1)
        if met == 1 and not near:
            continue
        for k in range(met):
            xi, eta = (scale * x0, scale * y0) if k == 0 else (scale * x1, scale * y1)
            if not (-1.0 < xi < math.inf and -1.0 < eta < math.inf):
                continue
            chord2 = eta * eta + (1.0 + eta) * e23
            if not chord2 > 0.0:  # two rays that are one
                continue
            d3 = math.sqrt(A23 / chord2)
            exact, d1, d2, d3 = _polish((1.0 + xi) * d3, (1.0 + eta) * d3, d3, e12, e13, e23, A12, A13, A23)
            if not ((exact or met == 1) and min(d1, d2, d3) > 0.0):
                continue
            for j in range(3):
                p[i1, j], p[i2, j], p[i3, j] = d1 * rays[i1, j], d2 * rays[i2, j], d3 * rays[i3, j]
            if pose_of_congruent_triangles(p, points, poses[count], poses[5:7]):
                count += 1
    return count


@kernel
def camera_in_target(pose: Matrix, out: Vector) -> None:
    """Write where the camera is, target axes, into out (3,): -C^T r of a pose (4, 3)."""
    for j in range(3):
        out[j] = -(pose[0, j] * pose[3, 0] + pose[1, j] * pose[3, 1] + pose[2, j] * pose[3, 2])


def p3p(rays: Matrix, points_m: Matrix, *, near: bool = False) -> Stack:
    """Every pose from which three points are seen along three directions.

    Parameters
    ----------
    rays : (3, 3)
        Unit vectors from the camera to the points, camera axes, rows. Not normalised here.
    points_m : (3, 3)
        The points in target axes, m, rows.
    near : bool
        Also the real part of each pair of complex solutions, as a start for noisy rays: it is no solution.

    Returns
    -------
    (n, 4, 3), n = 0 to 4
        One pose each: rows 0-2 dcm_cam_from_target, row 3 the target's origin in camera axes, m, so that point k is at
        `pose[:3] @ points_m[k] + pose[3]`.

    Raises
    ------
    ValueError
        For arrays of another shape. Rays or points that are not finite have no solution.
    """
    u, s = np.ascontiguousarray(rays, dtype=np.float64), np.ascontiguousarray(points_m, dtype=np.float64)
    if u.shape != (3, 3) or s.shape != (3, 3):
        raise ValueError(f"three rays and three points, rows of (3, 3), are expected; got shapes {u.shape}, {s.shape}")
    poses = np.empty((BLOCK, 4, 3))
    return poses[: solve_p3p(u, s, near, poses)]
