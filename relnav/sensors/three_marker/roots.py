"""Compiled: every pose that explains the spots of labelled markers, and what spots and prior say of each.

A root is one row of `ROOT` numbers: pose (12: the rotation C by rows, then the position r), covariance (36), misfit,
score.
"""

import math

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.geometry.linear_algebra import cholesky, solve_lower, solve_lower_transposed
from relnav.geometry.p3p import solve_p3p
from relnav.geometry.pose_refinement import BEHIND, PIVOT, pose_information, refine_pose
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector

MOST_TRIPLES = 4
MOST_ROOTS = 4 * MOST_TRIPLES
ROOT, MISFIT, SCORE = 50, 48, 49
BELIEF = 49
"""Numbers of a belief: C (9), r (3), covariance (36), and 1 if it says something of the position, else 0."""
WORK = 14
"""Matrices (6, 6) of scratch that these functions need."""

_TRIED_SIGMA = 3.0
_SAME_POSE = 1e-3  # in units of chi-square: two results of Gauss-Newton this near are one
_SQUARINGS = 30


@kernel
def widest_triples(points: Matrix, chosen: Matrix) -> int:
    """Write up to four triples of points (n, 3), the largest triangles first, into chosen (4, 4); returns how many.

    A row is the three places and twice the area.
    """
    count, n = 0, points.shape[0]
    for i in range(n):
        for j in range(i + 1, n):
            a0, a1, a2 = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            for k in range(j + 1, n):
                b0, b1, b2 = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
                x, y, z = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
                area = math.sqrt(x * x + y * y + z * z)
                place = min(count, MOST_TRIPLES - 1)
                if count == MOST_TRIPLES and not area > chosen[place, 3]:
                    continue
                while place > 0 and area > chosen[place - 1, 3]:
                    for c in range(4):
                        chosen[place, c] = chosen[place - 1, c]
                    place -= 1
                chosen[place, 0], chosen[place, 1], chosen[place, 2], chosen[place, 3] = i, j, k, area
                count = min(count + 1, MOST_TRIPLES)
    return count


@kernel
def positive(information: Matrix, factor: Matrix) -> bool:
    """Whether an information matrix (6, 6) fixes all six directions; given that of knowing nothing of an attitude.

    Where two solutions merge, a direction is not seen to first order: every direction then gets 1 / pi^2.
    """
    if cholesky(information, PIVOT, factor):
        return True
    for i in range(3, 6):
        information[i, i] += 1.0 / (math.pi * math.pi)
    return bool(cholesky(information, PIVOT, factor))


@kernel
def is_among(pose: Matrix, poses: Stack, information: Stack, difference: Vector) -> bool:
    """Whether a pose (4, 3) is one of poses (n, 4, 3), in units of their information (n, 6, 6)."""
    for r in range(poses.shape[0]):
        rotation_vector_into(pose, poses[r], difference)
        if not max(abs(difference[0]), abs(difference[1]), abs(difference[2])) < 0.1:
            continue
        for i in range(3):
            difference[3 + i] = difference[i]
            difference[i] = pose[3, i] - poses[r, 3, i]
        squares = 0.0
        for i in range(6):
            for j in range(6):
                squares += difference[i] * information[r, i, j] * difference[j]
        if squares < _SAME_POSE:
            return True
    return False


@entry
def explain_into(
    image: Matrix, weights: Matrix, points: Matrix, poses: Stack, information: Stack, misfit: Vector, work: Stack
) -> int:
    """Write every pose that explains the normalised image (n, 2) of n >= 3 points (n, 3), at most 16; returns how many.

    P3P of the widest triples, real solutions and pairs that noise may have made complex, each refined on all spots.
    poses (17, 4, 3), information (17, 6, 6) and misfit (17,): the last one is scratch; work (14, 6, 6) too.
    """
    chosen, starts = work[0, 0:4, 0:4], work[1:4].reshape((9, 4, 3))
    rays, corners = work[4, 0:2].reshape((4, 3)), work[5, 0:2].reshape((4, 3))
    count = 0
    for t in range(widest_triples(points, chosen)):
        for row in range(3):
            k = int(chosen[t, row])
            x, y = image[k, 0], image[k, 1]
            length = math.sqrt(x * x + y * y + 1.0)
            rays[row, 0], rays[row, 1], rays[row, 2] = x / length, y / length, 1.0 / length
            for c in range(3):
                corners[row, c] = points[k, c]
        for s in range(solve_p3p(rays[0:3], corners[0:3], True, starts)):
            for i in range(4):
                for j in range(3):
                    poses[count, i, j] = starts[s, i, j]
            steps, misfit[count] = refine_pose(points, image, weights, poses[count], information[count], work[6:12])
            if steps == BEHIND or not positive(information[count], work[12]):
                continue
            if not is_among(poses[count], poses[:count], information[:count], work[13, 0]):
                count += 1
    return count


@entry
def rank_into(
    poses: Stack, information: Stack, misfit: Vector, count: int, belief: Vector, work: Stack, roots: Matrix
) -> float:
    """Write the first `count` poses as rows of roots (count, 50), the most credible first.

    belief (49,), see `BELIEF`. Returns the angle from the first root to the nearest other one, infinite if there is
    none. The score is minus twice the logarithm of the integral of likelihood times prior about the root, both
    Gaussian: misfit + d^T S^-1 d + ln |S| - ln |R| with R the root's own covariance, S = R + P, d its distance from
    the prior. A root with a wide covariance of its own is thereby not ruled out, and the determinants are the share of
    the prior that leads to such spots. A belief that says nothing of the position: S and d are those of the attitude.
    """
    factor, spread, difference = work[0], work[1], work[2, 0]
    held, prior = belief[0:9].reshape((3, 3)), belief[12:48].reshape((6, 6))
    first = 0 if belief[48] > 0.0 else 3
    for r in range(count):
        row = roots[r]
        covariance, score = row[12:48].reshape((6, 6)), misfit[r]
        for i in range(12):
            row[i] = poses[r, i // 3, i % 3]
        cholesky(information[r], 0.0, factor)
        for i in range(6):
            score += 2.0 * math.log(factor[i, i])
            for j in range(6):
                covariance[i, j] = 1.0 if i == j else 0.0
            solve_lower(factor, covariance[i])
            solve_lower_transposed(factor, covariance[i])
        rotation_vector_into(poses[r], held, difference)
        for i in range(3):
            difference[3 + i] = difference[i]
            difference[i] = poses[r, 3, i] - belief[9 + i] if first == 0 else 0.0
        for i in range(6):
            for j in range(i):
                covariance[i, j] = covariance[j, i] = 0.5 * (covariance[i, j] + covariance[j, i])
            for j in range(6):
                known = min(i, j) >= first
                spread[i, j] = covariance[i, j] + prior[i, j] if known else (1.0 if i == j else 0.0)
        if cholesky(spread, 0.0, spread):
            score += solve_lower(spread, difference)
            for i in range(6):
                score += 2.0 * math.log(spread[i, i])
        else:
            score = math.inf  # the prior's covariance is none: nothing is known of this root
        row[MISFIT], row[SCORE] = misfit[r], score
        place = r
        while place > 0 and roots[place, SCORE] < roots[place - 1, SCORE]:
            for c in range(ROOT):
                roots[place, c], roots[place - 1, c] = roots[place - 1, c], roots[place, c]
            place -= 1
    gap = math.inf
    for r in range(1, count):
        rotation_vector_into(roots[r, 0:9].reshape((3, 3)), roots[0, 0:9].reshape((3, 3)), difference)
        angle2 = difference[0] ** 2 + difference[1] ** 2 + difference[2] ** 2
        gap = min(gap, math.sqrt(angle2))
    return gap


@kernel
def least_certain_axis(covariance: Matrix, axis: Vector, m: Matrix, square: Matrix) -> float:
    """Write the unit eigenvector of the largest variance of covariance[3:, 3:] into axis (3,); returns that variance.

    A symmetric matrix squared again and again, scaled, tends to the projector on it.
    """
    for i in range(3):
        for j in range(3):
            m[i, j] = covariance[3 + i, 3 + j]
    for _ in range(_SQUARINGS):
        trace = m[0, 0] + m[1, 1] + m[2, 2]
        for i in range(3):
            for j in range(3):
                square[i, j] = (m[i, 0] * m[0, j] + m[i, 1] * m[1, j] + m[i, 2] * m[2, j]) / (trace * trace)
        for i in range(3):
            for j in range(3):
                m[i, j] = square[i, j]
    best = 0
    for i in range(1, 3):
        if m[i, i] > m[best, best]:
            best = i
    length, variance = math.sqrt(m[0, best] ** 2 + m[1, best] ** 2 + m[2, best] ** 2), 0.0
    for i in range(3):
        axis[i] = m[i, best] / length
    for i in range(3):
        for j in range(3):
            variance += axis[i] * covariance[3 + i, 3 + j] * axis[j]
    return variance


@entry
def explains_its_error(root: Vector, image: Matrix, weights: Matrix, points: Matrix, work: Stack) -> bool:
    """Whether the spots' misfit about a root (50,) is what its covariance says: k^2 within a factor of 2, k sigma away.

    Tried along the least certain attitude, both ways. Near a danger cylinder or a second root it is not, and the
    covariance then describes nothing.
    """
    axis, turn, gradient, moved = work[0, 0], work[0, 1], work[0, 2], work[1, 0:2].reshape((4, 3))
    pose, covariance = root[0:12].reshape((4, 3)), root[12:48].reshape((6, 6))
    size = math.sqrt(least_certain_axis(covariance, axis, work[2], work[3]))
    for way in range(2):
        scale = (_TRIED_SIGMA if way == 0 else -_TRIED_SIGMA) / size
        for i in range(3):
            turn[i], turn[3 + i] = 0.0, 0.0
            for j in range(3):
                turn[i] += scale * covariance[3 + i, 3 + j] * axis[j]
                turn[3 + i] += scale * covariance[i, 3 + j] * axis[j]
        turn_by_rotation_vector(pose, turn, moved)
        for i in range(3):
            moved[3, i] = pose[3, i] + turn[3 + i]
        rise = pose_information(points, image, weights, moved, work[4], gradient) - root[MISFIT]
        if not 0.5 * _TRIED_SIGMA**2 < rise < 2.0 * _TRIED_SIGMA**2:
            return False
    return True
