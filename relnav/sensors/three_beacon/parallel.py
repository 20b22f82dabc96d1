"""The closed form of Cai et al. (1996), eqs (4)-(13), for parallel projection: regular on the docking axis, and signed.

Cai, Zhao, Sun, Qiao, Dai (1996), "Determination of target relative position and range by PSD optical sensor system".
As printed, n = b'(1 + m)/(2 h sqrt m) is 0/0 on the axis, z = n - sqrt(n^2 - 1) cancels near it, and the square roots
lose the signs of y and z. The same solution without these: with d = A' - B', c = C' - (A' + B')/2 on the detector
(x right, y down), D = |d|^2 and k = 2 a / b,

    T = k c.d / D,  U = k d x c / D,  mu = T^2 + U^2,  q = U / (1 + mu),   (q = 1/(2n), T and U from (4)-(6))
    z = 2 q / (1 + sqrt(1 - 4 q^2)),        root of (9) inside the unit sphere
    W = (1 + z^2) / (1 + mu) = x^2 + z^2,   (4)
    x = sqrt(W - z^2),  y = -T W / x,       (10), with the sign of y; x > 0: the chaser is in front
    r = f a sqrt(W) / a',  a' = sqrt(D)/2.  (11)

It is exact only if all beacons are at one depth. Real optics are central, and the formula is then biased by about
b/r of the angle: `perspective` is the default, this stays for comparison with the paper.
"""

import math

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.measurement import DEGENERATE, OK, OUTSIDE_DOMAIN

_TINY = 1e-12  # of the field: below this the spots of A and B coincide to rounding


@kernel
def image_ratios(spots: Matrix, k: float) -> tuple[float, float, float]:
    """Return (T, U, D) of the three spots (3, 2); D = 0 where A' and B' coincide."""
    dx, dy = spots[0, 0] - spots[1, 0], spots[0, 1] - spots[1, 1]
    cx = spots[2, 0] - 0.5 * (spots[0, 0] + spots[1, 0])
    cy = spots[2, 1] - 0.5 * (spots[0, 1] + spots[1, 1])
    D = dx * dx + dy * dy
    if not D > 0.0:
        return 0.0, 0.0, 0.0
    return k * (cx * dx + cy * dy) / D, k * (dx * cy - dy * cx) / D, D


@kernel
def direction_from_ratios(T: float, U: float) -> tuple[float, float, float, float]:
    """Return (x, y, z, W) of the unit direction p from O to the sensor; x = 0 where there is none in front."""
    m1 = 1.0 + T * T + U * U
    q = U / m1
    root = math.sqrt(max(0.0, 1.0 - 4.0 * q * q))
    z = 2.0 * q / (1.0 + root)
    W = (1.0 + z * z) / m1
    x2 = W - z * z
    if not x2 > 1e-6:
        return 0.0, 0.0, z, W
    x = math.sqrt(x2)
    return x, -T * W / x, z, W


@kernel
def solve_parallel(spots: Matrix, f: float, a: float, b: float, p: Vector) -> int:
    """Write the sensor's position (3,) m in the docking frame into p; returns a Status code.

    spots (3, 2) in the unit of f. Exact for parallel projection, one solution.
    """
    T, U, D = image_ratios(spots, 2.0 * a / b)
    if not (_TINY * f) ** 2 < D:
        return DEGENERATE
    x, y, z, W = direction_from_ratios(T, U)
    if not x > 0.0:
        return OUTSIDE_DOMAIN
    r = 2.0 * f * a * math.sqrt(W) / math.sqrt(D)
    p[0], p[1], p[2] = r * x, r * y, r * z
    return OK


@kernel
def solve_parallel_jacobian(spots: Matrix, f: float, a: float, b: float, jacobian: Matrix) -> bool:
    """Write d(range, azimuth, elevation)/d(A'x, A'y, B'x, B'y, C'x, C'y) into jacobian (3, 6); False if undefined.

    The chain rule through the formulas of this module's head, line by line.
    """
    k = 2.0 * a / b
    T, U, D = image_ratios(spots, k)
    if not (_TINY * f) ** 2 < D:
        return False
    x, y, z, W = direction_from_ratios(T, U)
    if not x > 0.0:
        return False
    dx, dy = spots[0, 0] - spots[1, 0], spots[0, 1] - spots[1, 1]
    cx = spots[2, 0] - 0.5 * (spots[0, 0] + spots[1, 0])
    cy = spots[2, 1] - 0.5 * (spots[0, 1] + spots[1, 1])
    m1 = 1.0 + T * T + U * U
    q = U / m1
    root = math.sqrt(max(0.0, 1.0 - 4.0 * q * q))
    if not root > 0.0:
        return False
    r = 2.0 * f * a * math.sqrt(W) / math.sqrt(D)
    h = math.sqrt(x * x + y * y)
    for column in range(6):
        beacon, axis = column // 2, column % 2
        wd = 1.0 if beacon == 0 else (-1.0 if beacon == 1 else 0.0)
        wc = 1.0 if beacon == 2 else -0.5
        ddx, ddy = (wd, 0.0) if axis == 0 else (0.0, wd)
        dcx, dcy = (wc, 0.0) if axis == 0 else (0.0, wc)
        dD = 2.0 * (dx * ddx + dy * ddy)
        dT = (k * (dcx * dx + cx * ddx + dcy * dy + cy * ddy) - T * dD) / D
        dU = (k * (ddx * cy + dx * dcy - ddy * cx - dy * dcx) - U * dD) / D
        dmu = 2.0 * (T * dT + U * dU)
        dq = (dU - q * dmu) / m1
        dz = (1.0 + z * z) / root * dq  # from q z^2 - z + q = 0
        dW = (2.0 * z * dz - W * dmu) / m1
        dpx = (dW - 2.0 * z * dz) / (2.0 * x)
        dpy = -(dT * W + T * dW) / x + T * W * dpx / (x * x)
        jacobian[0, column] = r * (dW / (2.0 * W) - dD / (2.0 * D))
        jacobian[1, column] = (x * dpy - y * dpx) / (h * h)
        jacobian[2, column] = -h * dz + z * (x * dpx + y * dpy) / h
    return True
