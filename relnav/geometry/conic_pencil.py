"""Where two conics meet: the degenerate members of their pencil, each a pair of real lines, found without cancellation.

A conic is a symmetric 3 x 3 matrix in homogeneous (xi, eta, 1), kept as its six numbers (m00, m01, m11, m02, m12, m22).
det(C1 + gamma C2) = k3 gamma^3 + k2 gamma^2 + k1 gamma + k0 has the degenerate members as roots (the pencil idea of
Persson and Nordberg 2018 and Ding et al. 2023). The leading coefficient k3 = det C2 vanishes in symmetric views, and
solvers that divide by it lose roots there; here the pencil is turned over so that the larger of k3, k0 leads, and both
being zero has its own branch.
"""

import math
from typing import TypeAlias

from relnav.codegen.kernel import kernel

Conic: TypeAlias = tuple[float, float, float, float, float, float]
Line: TypeAlias = tuple[float, float, float]

_DOUBLE = 1e-6  # of B^2 + 4 |A C|: a discriminant this far below zero may be a double root's rounding


@kernel
def _adjugate(m: Conic) -> Conic:
    m00, m01, m11, m02, m12, m22 = m
    return (
        m11 * m22 - m12 * m12,
        m02 * m12 - m01 * m22,
        m00 * m22 - m02 * m02,
        m01 * m12 - m02 * m11,
        m01 * m02 - m00 * m12,
        m00 * m11 - m01 * m01,
    )


@kernel
def _trace_of_product(m: Conic, n: Conic) -> float:
    return m[0] * n[0] + m[2] * n[2] + m[5] * n[5] + 2.0 * (m[1] * n[1] + m[3] * n[3] + m[4] * n[4])


@kernel
def _combination(m: Conic, gamma: float, n: Conic) -> Conic:
    return (
        m[0] + gamma * n[0],
        m[1] + gamma * n[1],
        m[2] + gamma * n[2],
        m[3] + gamma * n[3],
        m[4] + gamma * n[4],
        m[5] + gamma * n[5],
    )


@kernel
def _one_root(a: float, b: float, c: float) -> float:
    """A real root of g^3 + a g^2 + b g + c, of three the one farthest from zero: Cardano or trigonometric, polished."""
    shift = -a / 3.0
    p = b - a * a / 3.0
    q = a * (2.0 * a * a / 27.0 - b / 3.0) + c
    half, third = 0.5 * q, p / 3.0
    discriminant = half * half + third * third * third
    if discriminant > 0.0:
        root = math.sqrt(discriminant)
        u = -half - root if half > 0.0 else -half + root
        u = math.copysign(math.pow(abs(u), 1.0 / 3.0), u)
        g = shift + u - (third / u if u != 0.0 else 0.0)
    else:
        size = math.sqrt(max(0.0, -third))
        cube = size * size * size
        angle = math.acos(max(-1.0, min(1.0, -half / cube if cube > 0.0 else 0.0))) / 3.0
        g = shift + 2.0 * size * math.cos(angle if shift >= 0.0 else angle + 2.0943951023931953)
    value = ((g + a) * g + b) * g + c
    for _ in range(3):
        slope = (3.0 * g + 2.0 * a) * g + b
        trial = g - value / slope if slope != 0.0 else g
        now = ((trial + a) * trial + b) * trial + c
        if not abs(now) < abs(value):  # at a double root the step is all rounding
            break
        g, value = trial, now
    return g


@kernel
def cubic_roots(k3: float, k2: float, k1: float, k0: float) -> tuple[int, float, float, float]:
    """Count (1 or 3) and values of the real roots of k3 g^3 + k2 g^2 + k1 g + k0, k3 not 0.

    One root, then the quadratic that is left, divided out from the end that does not cancel: three roots by one formula
    would lose small ones beside a large one. Two that coincide to rounding are real.
    """
    a, b, c = k2 / k3, k1 / k3, k0 / k3
    g0 = _one_root(a, b, c)
    if abs(g0 * g0 * g0) > abs(c):  # g^2 + m g + n is left
        n = -c / g0
        m = (n - b) / g0
    else:
        m = a + g0
        n = b + m * g0
    discriminant = m * m - 4.0 * n
    if discriminant < -1e-13 * (m * m + 4.0 * abs(n)):
        return 1, g0, 0.0, 0.0
    root = math.sqrt(max(0.0, discriminant))
    g1 = -0.5 * (m + root) if m >= 0.0 else -0.5 * (m - root)
    g2 = n / g1 if g1 != 0.0 else 0.0
    return 3, g0, g1, g2


@kernel
def _reality(m: Conic) -> float:
    """How surely a degenerate conic is a pair of real lines: the largest -adj diagonal over the largest |entry|^2."""
    adj = _adjugate(m)
    big = max(abs(m[0]), abs(m[1]), abs(m[2]), abs(m[3]), abs(m[4]), abs(m[5]))
    return max(-adj[0], -adj[2], -adj[5]) / (big * big) if big > 0.0 else -math.inf


@kernel
def degenerate_member(c1: Conic, c2: Conic) -> tuple[Conic, bool]:
    """The member of the pencil that is most surely a pair of real lines, and whether it is least aligned with c2."""
    k0 = _trace_of_product(_adjugate(c1), c1) / 3.0
    k1 = _trace_of_product(_adjugate(c1), c2)
    k2 = _trace_of_product(_adjugate(c2), c1)
    k3 = _trace_of_product(_adjugate(c2), c2) / 3.0
    turned = abs(k3) < abs(k0)
    if turned:
        k0, k1, k2, k3 = k3, k2, k1, k0
        c1, c2 = c2, c1
    best, share, use_c2 = c2, -math.inf, False
    if abs(k3) <= 1e-13 * max(abs(k1), abs(k2)) or k3 == 0.0:
        share = _reality(c2)  # both conics are line pairs: the roots are 0, -k1/k2 and infinity
        count, g0, g1, g2 = 2, 0.0, (-k1 / k2 if abs(k2) > 1e-13 * abs(k1) else 0.0), 0.0
    else:
        count, g0, g1, g2 = cubic_roots(k3, k2, k1, k0)
    for i in range(count):
        gamma = g0 if i == 0 else (g1 if i == 1 else g2)
        member = _combination(c1, gamma, c2)
        reality = _reality(member)
        if reality > share:
            best, share, use_c2 = member, reality, abs(gamma) <= 1.0
    return best, use_c2 != turned


@kernel
def line_pair(m: Conic) -> tuple[bool, Line, Line]:
    """The two lines l, g of a degenerate conic m ~ l g^T + g l^T; False if they are not real.

    adj m = -p p^T with p the point where they meet, and m + [p x] has rank one: its largest row and column.
    """
    adj = _adjugate(m)
    d0, d1, d2 = -adj[0], -adj[2], -adj[5]
    big = max(d0, d1, d2)
    none = (0.0, 0.0, 0.0)
    if not big > 0.0:
        return False, none, none
    norm = math.sqrt(big)
    if d0 >= d1 and d0 >= d2:
        p0, p1, p2 = norm, -adj[1] / norm, -adj[3] / norm
    elif d1 >= d2:
        p0, p1, p2 = -adj[1] / norm, norm, -adj[4] / norm
    else:
        p0, p1, p2 = -adj[3] / norm, -adj[4] / norm, norm
    row0 = (m[0], m[1] - p2, m[3] + p1)
    row1 = (m[1] + p2, m[2], m[4] - p0)
    row2 = (m[3] - p1, m[4] + p0, m[5])
    s0 = max(abs(row0[0]), abs(row0[1]), abs(row0[2]))
    s1 = max(abs(row1[0]), abs(row1[1]), abs(row1[2]))
    s2 = max(abs(row2[0]), abs(row2[1]), abs(row2[2]))
    row = row0 if s0 >= s1 and s0 >= s2 else (row1 if s1 >= s2 else row2)
    big = max(s0, s1, s2)
    if abs(row[0]) == big:
        return True, row, (row0[0], row1[0], row2[0])
    if abs(row[1]) == big:
        return True, row, (row0[1], row1[1], row2[1])
    return True, row, (row0[2], row1[2], row2[2])


@kernel
def meet(line: Line, m: Conic) -> tuple[int, float, float, float, float]:
    """Count and points (xi, eta), (xi, eta) where a line meets a conic; a point at infinity is not finite.

    Count 2: two points; 1: the real part of two complex ones, where they come nearest; 0: the line is at infinity.
    """
    l0, l1, l2 = line
    if l0 == 0.0 and l1 == 0.0:
        return 0, 0.0, 0.0, 0.0, 0.0
    m00, m01, m11, m02, m12, m22 = m
    first = abs(l0) >= abs(l1)
    if first:  # xi = s eta + t
        s, t = -l1 / l0, -l2 / l0
        a = (m00 * s + 2.0 * m01) * s + m11
        b = 2.0 * (m00 * s * t + m01 * t + m02 * s + m12)
        c = (m00 * t + 2.0 * m02) * t + m22
    else:  # eta = s xi + t
        s, t = -l0 / l1, -l2 / l1
        a = (m11 * s + 2.0 * m01) * s + m00
        b = 2.0 * (m11 * s * t + m01 * t + m12 * s + m02)
        c = (m11 * t + 2.0 * m12) * t + m22
    discriminant = b * b - 4.0 * a * c
    count = 2 if discriminant >= -_DOUBLE * (b * b + 4.0 * abs(a * c)) else 1
    root = math.sqrt(max(0.0, discriminant))
    q = -0.5 * (b + root) if b >= 0.0 else -0.5 * (b - root)
    v0 = q / a if a != 0.0 else math.inf
    v1 = c / q if q != 0.0 else v0
    if first:
        return count, s * v0 + t, v0, s * v1 + t, v1
    return count, v0, s * v0 + t, v1, s * v1 + t
