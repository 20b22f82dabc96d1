"""Covariance that white acceleration noise adds over any time step: Q(dt) = int_0^dt B(s) A B(s)^T ds.

B(s) = [Phi_rv(s); Phi_vv(s)] of Clohessy-Wiltshire and A (3, 3) is the acceleration noise density, m^2/s^3. The
integrand is smooth on the scale of an orbit, so five Gauss-Legendre points are exact to rounding for n h <= 0.25, and
three for n h <= 0.001 (a test holds it against Van Loan); longer steps double: Q(2h) = Phi(h) Q(h) Phi(h)^T + Q(h).

About an eccentric target B(s) is that of Yamanaka and Ankersen from the time s to the end of the step, and a step is as
many pieces of five points as its fastest turn, that at perigee, asks for: nothing repeats, so nothing doubles. What a
constant acceleration adds, int B(s) a ds, comes from the same points.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.dynamics.clohessy_wiltshire import transition_into
from relnav.dynamics.yamanaka_ankersen import PHI_PATTERN, anomaly_step, from_anomalies_into

LARGEST_TURN_RAD = 0.25
"""Of the target in one piece of the integral; three points do up to SMALL_TURN_RAD."""
SMALL_TURN_RAD = 1e-3
MOST_PIECES = 10_000
"""Of a step about an eccentric target, some 30 ms: 400 revolutions of a nearly circular orbit, 50 at e = 0.7."""


def _gauss_legendre(points: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Nodes and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(points)
    return tuple(float(0.5 * (1.0 + node)) for node in x), tuple(float(0.5 * weight) for weight in w)


_NODES_3, _WEIGHTS_3 = _gauss_legendre(3)
_NODES_5, _WEIGHTS_5 = _gauss_legendre(5)
NODES = 6
"""Matrices of scratch: Phi at each point, and one more."""


@straight_line(phi=PHI_PATTERN, a=(3, 3), q=(6, 6))  # of its last three columns, on a circular orbit the same
def _add_node(phi: Matrix, a: Matrix, weight: float, q: Matrix) -> None:
    """Add B A B^T times a weight to the lower triangle of q, B the last three columns of phi."""
    ba = np.zeros((6, 3))
    for i in range(6):
        for k in range(3):
            ba[i, k] = (phi[i, 3] * a[0, k] + phi[i, 4] * a[1, k] + phi[i, 5] * a[2, k]) * weight
    for i in range(6):
        for j in range(i + 1):
            q[i, j] += ba[i, 0] * phi[j, 3] + ba[i, 1] * phi[j, 4] + ba[i, 2] * phi[j, 5]


@kernel
def _mirror(q: Matrix) -> None:
    for i in range(6):
        for j in range(i):
            q[j, i] = q[i, j]


@kernel
def acceleration_noise_into(
    n: float, dt: float, a: Matrix, q: Matrix, nodes: Stack, work: Matrix, again: bool = False
) -> None:
    """Write Q(dt) (6, 6) into q for mean motion n rad/s, dt >= 0 s and density a (3, 3) m^2/s^3.

    work (6, 6) is scratch, and so is nodes (NODES, 6, 6); again: it holds what a call with these n and dt has left.
    """
    doublings = 0
    h = dt
    while abs(n * h) > LARGEST_TURN_RAD:
        h *= 0.5
        doublings += 1
    short = abs(n * h) < SMALL_TURN_RAD
    for i in range(6):
        for j in range(6):
            q[i, j] = 0.0
    for node in range(3 if short else 5):
        if not again:
            transition_into(n, (_NODES_3[node] if short else _NODES_5[node]) * h, nodes[node])
        _add_node(nodes[node], a, (_WEIGHTS_3[node] if short else _WEIGHTS_5[node]) * h, q)
    _mirror(q)
    phi = nodes[NODES - 1]
    for _ in range(doublings):
        transition_into(n, h, phi)
        for i in range(6):
            for j in range(6):
                work[i, j] = 0.0
                for k in range(6):
                    work[i, j] += phi[i, k] * q[k, j]
        for i in range(6):
            for j in range(i + 1):
                for k in range(6):
                    q[i, j] += work[i, k] * phi[j, k]
        _mirror(q)
        h *= 2.0


@kernel
def eccentric_acceleration_into(
    n: float,
    e: float,
    sin1: float,
    cos1: float,
    dt: float,
    acceleration: Vector,
    a: Matrix,
    q: Matrix,
    effect: Vector,
    phi: Matrix,
) -> bool:
    """Write Q(dt) (6, 6) into q and what a constant acceleration (3,) m/s^2 adds to the state (6,) into effect.

    About a target of mean motion n rad/s and eccentricity e, whose true anomaly at the END of the step has this sine
    and cosine; dt >= 0 s, density a (3, 3) m^2/s^3; phi (6, 6) is scratch. False, and nothing written, for a
    step of more than MOST_PIECES.
    """
    root = math.sqrt(1.0 - e * e)
    turn = n * dt * (1.0 + e) ** 2 / (root * root * root)  # at the rate of the perigee
    if not turn <= MOST_PIECES * LARGEST_TURN_RAD:
        return False
    for i in range(6):
        effect[i] = 0.0
        for j in range(6):
            q[i, j] = 0.0
    short = turn < SMALL_TURN_RAD
    pieces = max(1, math.ceil(turn / LARGEST_TURN_RAD))
    h = dt / pieces
    for piece in range(pieces):
        for node in range(3 if short else 5):
            left = (piece + (_NODES_3[node] if short else _NODES_5[node])) * h  # until the end
            S, V, W, sin0, cos0 = anomaly_step(e, sin1, cos1, -n * left)
            from_anomalies_into(n, e, sin0, cos0, -S, V, -W, phi)
            weight = (_WEIGHTS_3[node] if short else _WEIGHTS_5[node]) * h
            _add_node(phi, a, weight, q)
            for i in range(6):
                push = phi[i, 3] * acceleration[0] + phi[i, 4] * acceleration[1] + phi[i, 5] * acceleration[2]
                effect[i] += weight * push
    _mirror(q)
    return True


@kernel
def add_execution_error(u: Vector, along: float, across: float, out: Matrix) -> None:
    """Add along^2 u u^T + across^2 (|u|^2 I - u u^T) of a control vector u (3,) to out (3, 3).

    along: 1-sigma of its size, relative; across: 1-sigma of its direction about each axis normal to it, rad.
    """
    size2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
    for i in range(3):
        for j in range(3):
            product = u[i] * u[j]
            out[i, j] += along * along * product
            out[i, j] += across * across * ((size2 if i == j else 0.0) - product)


def acceleration_noise(mean_motion_rad_s: float, dt_s: float, density_m2_s3: float | Matrix) -> Matrix:
    """Process noise covariance Q(dt) (6, 6) in `lvlh_ccsds`, SI.

    Parameters
    ----------
    mean_motion_rad_s : float
        Mean motion of the target's orbit, > 0.
    dt_s : float
        Time step, >= 0.
    density_m2_s3 : float or (3, 3)
        Two-sided spectral density of the acceleration noise; a number stands for that number in each axis.

    Raises
    ------
    ValueError
        For a mean motion that is not positive or a step that is negative or not finite.
    """
    if not (math.isfinite(mean_motion_rad_s) and mean_motion_rad_s > 0.0):
        raise ValueError(f"mean_motion_rad_s must be positive and finite; got {mean_motion_rad_s!r}")
    if not (math.isfinite(dt_s) and dt_s >= 0.0):
        raise ValueError(f"dt_s must be >= 0 and finite; got {dt_s!r}")
    density = np.asarray(density_m2_s3, dtype=np.float64)
    a = np.ascontiguousarray(density if density.ndim == 2 else float(density) * np.eye(3))
    q = np.empty((6, 6))
    acceleration_noise_into(mean_motion_rad_s, dt_s, a, q, np.empty((NODES, 6, 6)), np.empty((6, 6)))
    return q
