"""The closed form made exact for central projection: the default.

Each pass rescales the spots by their beacons' depth ratios w_i = 1 - (P_i . p) / r from the last solution and applies
the closed form of `parallel` again (the POSIT idea, DeMenthon and Davis 1995). The spots are taken as rays about the
line of sight to O, which is re-centred in every pass: under perspective the image of O is the depth-weighted mean of
A' and B', not their middle. Once a pass moves little, Newton's method on the attitude-free invariants finishes.

Domain: off-axis angle of the line of sight against r/b, within which the pose with x > 0 is the only one; outside it
there can be up to four, and a status says so.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import anywhere, select
from relnav.geometry.linear_algebra import invert_three
from relnav.sensors.measurement import DEGENERATE, NO_CONVERGENCE, OK, OUTSIDE_DOMAIN
from relnav.sensors.three_beacon.invariants import (
    invariants,
    position_gradient,
    rays_from_position,
    spot_gradient,
)
from relnav.sensors.three_beacon.parallel import direction_from_ratios

MAX_PASSES = 40
MAX_NEWTON = 12
MAX_CHORDS = 4
ROUNDING = 1e-15
"""Of the position: an error that is no more than the rounding of the rays it follows from."""


@kernel
def inside_domain(p: Vector, b: float) -> bool:
    """Whether the pose p (3,) m lies where it is the only one in front: off-axis angle against r/b, in steps."""
    r = math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    if not p[0] > 0.0:
        return False
    cosine = p[0] / r
    ratio = r / b
    if cosine >= 0.9848077530122081:  # 10 deg
        return ratio >= 1.2
    if cosine >= 0.9396926207859084:  # 20 deg
        return ratio >= 1.54
    if cosine >= 0.8660254037844387:  # 30 deg
        return ratio >= 2.0
    if cosine >= 0.7071067811865476:  # 45 deg
        return ratio >= 3.0
    return cosine >= 0.5 and ratio >= 5.0  # 60 deg


@kernel
def _closed_form_pass(u: Matrix, a: float, b: float, w: Vector, p: Vector, v: Matrix) -> bool:
    """One pass: from line of sight w (3,) and position p (r = 0 at the start) to better ones, in place; v scratch."""
    r = math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    for i in range(3):
        depth = 1.0
        if r > 0.0:
            offset = b * p[0] if i == 2 else (a * p[1] if i == 0 else -a * p[1])
            depth = max(0.05, 1.0 - offset / (r * r))
        cosine = u[i, 0] * w[0] + u[i, 1] * w[1] + u[i, 2] * w[2]
        if not cosine > 1e-3:
            return False
        for j in range(3):
            v[i, j] = u[i, j] * depth / cosine  # beacon i from the camera, in units of r, if depth is right
    dw, cw = 0.0, 0.0
    for j in range(3):
        v[3, j] = 0.5 * (v[0, j] + v[1, j])
        v[4, j] = v[0, j] - v[1, j]
        v[5, j] = v[2, j] - v[3, j]
        dw += v[4, j] * w[j]
        cw += v[5, j] * w[j]
    D, cd = 0.0, 0.0
    for j in range(3):
        v[4, j] -= dw * w[j]
        v[5, j] -= cw * w[j]
        D += v[4, j] * v[4, j]
        cd += v[4, j] * v[5, j]
    if not D > 1e-24:
        return False
    cross = (
        w[0] * (v[4, 1] * v[5, 2] - v[4, 2] * v[5, 1])
        + w[1] * (v[4, 2] * v[5, 0] - v[4, 0] * v[5, 2])
        + w[2] * (v[4, 0] * v[5, 1] - v[4, 1] * v[5, 0])
    )
    k = 2.0 * a / b
    x, y, z, W = direction_from_ratios(k * cd / D, k * cross / D)
    if not x > 0.0:
        return False
    r = 2.0 * a * math.sqrt(W) / math.sqrt(D)
    p[0], p[1], p[2] = r * x, r * y, r * z
    norm = math.sqrt(v[3, 0] ** 2 + v[3, 1] ** 2 + v[3, 2] ** 2)
    for j in range(3):
        w[j] = v[3, j] / norm
    return True


@straight_line(p=(3,), inverse=(3, 3))
def gradient_inverse(p: Vector, a: float, b: float, inverse: Matrix) -> bool:
    """Write (dg/dp)^-1 at the position p into inverse (3, 3); False where it does not exist."""
    u, distance, dg = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    rays_from_position(p, a, b, u, distance)
    position_gradient(u, distance, dg)
    return invert_three(dg, inverse)


@straight_line(g=(3,), p=(3,), inverse=(3, 3))
def chord_step(g: Vector, a: float, b: float, p: Vector, inverse: Matrix, share: float) -> tuple[float, float]:
    """Move p (3,) by a share, 1 or 0, of inverse (g - g(p)), in place.

    Returns the sums of the whole steps' and of the position's sizes.
    """
    u, distance, got = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    rays_from_position(p, a, b, u, distance)
    invariants(u, got)
    size, scale = 0.0, 0.0
    for i in range(3):
        step = inverse[i, 0] * (g[0] - got[0]) + inverse[i, 1] * (g[1] - got[1]) + inverse[i, 2] * (g[2] - got[2])
        p[i] += share * step
        size += abs(step)
        scale += abs(p[i])
    return size, scale


@straight_line(g=(3,), p=(3,), inverse=(3, 3))
def newton_step(g: Vector, a: float, b: float, p: Vector, inverse: Matrix, share: float) -> tuple[bool, float, float]:
    """`chord_step` with the inverse at p itself, which is written into inverse (3, 3); False first if there is none."""
    regular = gradient_inverse(p, a, b, inverse)
    size, scale = chord_step(g, a, b, p, inverse, share)
    return regular, size, scale


@kernel
def settle(g: Vector, a: float, b: float, p: Vector, inverse: Matrix) -> bool:
    """Newton on g(p) = g from p, in place; False if it does not settle. inverse (3, 3) is scratch.

    Newton's error after a step of size s is C s^2. Steps that keep the last inverse (chords) multiply it by C s at less
    than half the price: they finish once s is below 1e-3 of p, when C s is seen in the ratio of two sizes.
    """
    last, left = math.inf, 1.0  # left: 0 where it has settled, and p is not moved any more
    for _ in range(MAX_NEWTON):
        regular, size, scale = newton_step(g, a, b, p, inverse, left)
        if not (left == 0.0) | (regular & (size < scale)):
            return False
        # the second: at the rounding
        left = select((size < 3e-8 * scale) | ((size < 1e-6 * scale) & (size >= 0.5 * last)), 0.0, left)
        if not anywhere(left > 0.0):
            return True
        last = size
        if (left == 0.0) | (size < 1e-3 * scale):
            for _ in range(MAX_CHORDS):
                moved, scale = chord_step(g, a, b, p, inverse, left)
                left = select(moved * moved < ROUNDING * scale * size, 0.0, left)
                if not anywhere(left > 0.0):
                    return True
                if not (left == 0.0) | (moved < 0.1 * size):
                    break
                size = moved
    return False


@kernel
def solve_perspective(u: Matrix, a: float, b: float, p: Vector, work: Matrix) -> int:
    """Write the sensor's position (3,) m in the docking frame into p, from camera-frame unit rays u (rows A, B, C).

    Exact, any camera attitude; returns a Status code. work (12, 6) is scratch.
    """
    w, g, trial = work[6], work[7], work[8]
    norm = 0.0
    for j in range(3):
        w[j] = u[0, j] + u[1, j]
        norm += w[j] * w[j]
        p[j] = 0.0
    norm = math.sqrt(norm)
    if not norm > 1e-3:
        return DEGENERATE
    for j in range(3):
        w[j] /= norm
    invariants(u, g)
    if not g[0] > 1e-24:
        return DEGENERATE
    tolerance = 0.1
    for _ in range(MAX_PASSES):
        x0, x1, x2 = p[0], p[1], p[2]
        if not _closed_form_pass(u, a, b, w, p, work[0:6]):
            return NO_CONVERGENCE
        moved = abs(p[0] - x0) + abs(p[1] - x1) + abs(p[2] - x2)
        scale = abs(p[0]) + abs(p[1]) + abs(p[2])
        if moved < tolerance * scale:
            trial[0], trial[1], trial[2] = p[0], p[1], p[2]
            if settle(g, a, b, trial, work[9:12]):
                p[0], p[1], p[2] = trial[0], trial[1], trial[2]
                if not inside_domain(p, b):
                    return OUTSIDE_DOMAIN
                return OK
            tolerance *= 0.1
    return NO_CONVERGENCE


@straight_line(inverse=(3, 3), u=(3, 3), jacobian=(3, 6))
def implicit_jacobian(inverse: Matrix, u: Matrix, f: float, jacobian: Matrix) -> None:
    """Write dp/d(spots) = (dg/dp)^-1 dg/ds into jacobian (3, 6), from the inverse at p and its camera-frame rays u."""
    ds = np.zeros((3, 6))
    spot_gradient(u, f, ds)
    for i in range(3):
        for j in range(6):
            jacobian[i, j] = inverse[i, 0] * ds[0, j] + inverse[i, 1] * ds[1, j] + inverse[i, 2] * ds[2, j]


@straight_line(p=(3,), u=(3, 3), jacobian=(3, 6))
def position_jacobian(p: Vector, u: Matrix, f: float, a: float, b: float, jacobian: Matrix) -> bool:
    """Write dp/d(A'x, A'y, B'x, B'y, C'x, C'y) into jacobian (3, 6), m per unit of f; False where singular.

    p (3,) m is the pose and u its camera-frame rays: by the implicit function theorem J = (dg/dp)^-1 dg/ds, which is
    the upper half of the inverse of the 6 x 6 projection Jacobian (a test holds the two equal).
    """
    inverse = np.zeros((3, 3))
    regular = gradient_inverse(p, a, b, inverse)
    implicit_jacobian(inverse, u, f, jacobian)
    return regular
