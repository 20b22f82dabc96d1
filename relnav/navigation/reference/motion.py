"""Prediction of `engine="filterpy"`, from equations of motion and scipy alone: a second opinion on the filters' own.

Motion relative to the target, in `lvlh_ccsds` (x along the track, z to the nadir), k = mu / r^3, w the orbit's rate:

    x'' = 2 w z' + w' z + (w^2 - k) x,   y'' = -k y,   z'' = -2 w x' - w' x + (w^2 + 2 k) z

(Clohessy-Wiltshire for w^2 = k = n^2). About a circular orbit its transition, noise and control effect are one matrix
exponential (Van Loan 1978, Computing integrals involving the matrix exponential); about an eccentric one they are
integrated. The rotation is J w' = -w x J w + 3 n^2 o x J o, C' = C [(w - C^T w_L) x]; errors are carried by integrating
complex neighbours of the attitude and the rate, whose imaginary parts are derivatives without a formula for them
(Squire and Trapp 1998, Using complex variables to estimate derivatives of real functions).
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import Orbit, ProcessNoise
from relnav.navigation.propagation import snapped

LARGEST_TURN_RAD = 0.2
"""Of the orbit or of the target in one piece of an integration."""
MOST_TURN_RAD = 1000.0
"""Of a step: nothing is known of the target's attitude after more."""
IMAGINARY = 1e-30
"""Of a complex neighbour: its square vanishes beside 1."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(5)
NODES, WEIGHTS = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS


def cross(a: Any, b: Any) -> Any:
    """Product a x b (..., 3), broadcast, of complex numbers too: a quarter of the time of numpy's on short arrays."""
    out: Any = np.stack([a[..., i - 2] * b[..., i - 1] - a[..., i - 1] * b[..., i - 2] for i in range(3)], axis=-1)
    return out


def step_between(before_s: float, t_s: float) -> float:
    """A step as filters take it: time stamps differ by their rounding."""
    return float(snapped(t_s - before_s))


def _execution_error(u: Vector, noise: ProcessNoise) -> Matrix:
    """Covariance (3, 3) of how a commanded vector (3,) is carried out."""
    size, turn = noise.control_magnitude_sigma, noise.control_direction_sigma_rad
    along = np.outer(u, u)
    error: Matrix = size**2 * along + turn**2 * (u @ u * np.eye(3) - along)
    return error


def predict_motion(
    orbit: Orbit, noise: ProcessNoise, t_s: float, dt_s: float, acceleration: Vector, delta_v: Vector
) -> tuple[Matrix, Matrix, Vector]:
    """Phi and Q (6, 6), and the control's effect (6,), over dt from t; NaN in Q where nothing is known after it."""
    density = noise.acceleration_noise_density_m2_s3 * np.eye(3)
    density += noise.control_correlation_time_s * _execution_error(acceleration, noise)
    fastest = orbit.mean_motion_rad_s / (1.0 - orbit.eccentricity) ** 2
    if not fastest * dt_s <= MOST_TURN_RAD:
        return np.eye(6), np.full((6, 6), np.nan), np.zeros(6)
    way = _circular if orbit.eccentricity == 0.0 else _eccentric
    phi, q, effect = way(orbit, t_s, dt_s, acceleration, density)
    q[3:, 3:] += _execution_error(delta_v, noise)
    effect[3:] += delta_v
    return phi, 0.5 * (q + q.T), effect


def _rates(w: float, w_rate: float, k: float) -> Matrix:
    """The equations of relative motion as a matrix (6, 6)."""
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 2], a[3, 5] = w * w - k, w_rate, 2.0 * w
    a[4, 1] = -k
    a[5, 0], a[5, 2], a[5, 3] = -w_rate, w * w + 2.0 * k, -2.0 * w
    return a


def _circular(orbit: Orbit, _t: float, dt: float, push: Vector, density: Matrix) -> tuple[Matrix, Matrix, Vector]:
    from scipy.linalg import expm

    n, seven, driven = orbit.mean_motion_rad_s, np.zeros((7, 7)), np.zeros((7, 7))
    seven[:6, :6], seven[3:6, 6] = _rates(n, 0.0, n * n), push
    driven[3:6, 3:6] = density
    whole = expm(dt * np.block([[-seven, driven], [np.zeros((7, 7)), seven.T]]))
    phi = whole[7:, 7:].T
    q = phi @ whole[:7, 7:]
    return phi[:6, :6].copy(), q[:6, :6].copy(), phi[:6, 6].copy()


def _eccentric(orbit: Orbit, t: float, dt: float, push: Vector, density: Matrix) -> tuple[Matrix, Matrix, Vector]:
    fastest = orbit.mean_motion_rad_s / (1.0 - orbit.eccentricity) ** 2
    pieces = max(1, math.ceil(fastest * dt / LARGEST_TURN_RAD))
    phi, q, effect = np.eye(6), np.zeros((6, 6)), np.zeros(6)
    driven = np.zeros((6, 6))
    driven[3:, 3:] = density
    h = dt / pieces
    for piece in range(pieces):

        def rate(s: float, values: Vector, begun: float = t + piece * h) -> Vector:
            columns = _rates(*_orbit_rates(orbit, begun + s)) @ values.reshape(6, 7)
            columns[3:, 6] += push
            out: Vector = columns.ravel()
            return out

        path = integrated(rate, np.hstack([np.eye(6), np.zeros((6, 1))]).ravel(), h).reshape(-1, 6, 7)
        own, added = _noise_along(path[:, :, :6], driven, h)
        phi, q, effect = own @ phi, own @ q @ own.T + added, own @ effect + path[-1, :, 6]
    return phi, q, effect


def _orbit_rates(orbit: Orbit, t_s: float) -> tuple[float, float, float]:
    """(w, w', k) of the target's orbit: h / r^2, its derivative, and mu / r^3."""
    n, e, theta = orbit.mean_motion_rad_s, orbit.eccentricity, orbit.true_anomaly_rad
    if e == 0.0:
        return n, 0.0, n * n
    turns = round(theta / (2.0 * math.pi))
    half = 0.5 * theta - math.pi * turns
    at_zero = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(half), math.sqrt(1.0 + e) * math.cos(half))
    mean = math.remainder(at_zero - e * math.sin(at_zero) + n * t_s, 2.0 * math.pi)
    low, high = mean - e, mean + e
    eccentric = mean
    for _ in range(100):  # Newton within bounds
        excess = eccentric - e * math.sin(eccentric) - mean
        low, high = (low, eccentric) if excess > 0.0 else (eccentric, high)
        better = eccentric - excess / (1.0 - e * math.cos(eccentric))
        better = better if low <= better <= high else 0.5 * (low + high)
        if abs(better - eccentric) < 1e-15:
            break
        eccentric = better
    sine, cosine = math.sqrt(1.0 - e * e) * math.sin(eccentric), math.cos(eccentric) - e
    near = 1.0 - e * math.cos(eccentric)  # r / a
    sine, cosine, rho = sine / near, cosine / near, 1.0 + e * cosine / near
    w = n * rho * rho / (1.0 - e * e) ** 1.5
    return w, -2.0 * w * w * e * sine / rho, w * w / rho


def rate_and_gravity(orbit: Orbit, t_s: float) -> tuple[float, float]:
    """Rate at which `lvlh_ccsds` turns about -y, rad/s, and mu / r^3, 1/s^2."""
    rate, _, gravity = _orbit_rates(orbit, t_s)
    return rate, gravity


def pieces_of(rate: Vector, n: float, dt_s: float) -> int:
    """How many pieces of a turn of 0.2 rad an integration of a body's rotation has."""
    return max(1, math.ceil(max(float(np.linalg.norm(rate)), n) * dt_s / LARGEST_TURN_RAD))


def predict_rotation(
    inertia: Matrix,
    orbit: tuple[float, float],
    dcm: Matrix,
    rate: Vector,
    dt_s: float,
    density: float,
    more: Callable[[Matrix, Vector], float] | None = None,
) -> tuple[Matrix, Vector, Matrix, Matrix] | None:
    """dcm_lvlh_from_target and inertial rate after dt, and Phi and Q (6, 6) of their errors (theta, dw).

    inertia (3, 3) kg m^2, orbit as `rate_and_gravity` has it, density of white angular acceleration, rad^2/s^3;
    more: what is added to it, by attitude and rate. None after MOST_TURN_RAD.
    """
    n, gravity = orbit
    fastest = max(float(np.linalg.norm(rate)), n)
    if not fastest * dt_s <= MOST_TURN_RAD:
        return None
    pieces = pieces_of(rate, n, dt_s)
    inverse, phi, q, driven = np.linalg.inv(inertia), np.eye(6), np.zeros((6, 6)), np.zeros((6, 6))
    driven[3:, 3:] = density * np.eye(3)

    def rate_of(_: float, values: Vector) -> Vector:
        attitude, turning = values[:63].reshape(7, 3, 3), values[63:].reshape(7, 3)
        nadir = attitude[:, 2]
        relative = turning + n * attitude[:, 1]
        torque = 3.0 * gravity * cross(nadir, nadir @ inertia) - cross(turning, turning @ inertia)
        return np.concatenate([cross(attitude, relative[:, None]).ravel(), (torque @ inverse).ravel()])

    for _ in range(pieces):
        here = np.concatenate([_neighbours(dcm).ravel(), np.tile(rate.astype(complex), 7)])
        here[63:].reshape(7, 3)[4:] += 1j * IMAGINARY * np.eye(3)
        if more is not None:
            driven[3:, 3:] = (density + more(dcm, rate)) * np.eye(3)
        path = integrated(rate_of, here, dt_s / pieces)
        flow = np.array([_errors_of(values) for values in path])
        own, added = _noise_along(flow, driven, dt_s / pieces)
        phi, q = own @ phi, own @ q @ own.T + added
        dcm, rate = path[-1, :9].reshape(3, 3).real, path[-1, 63:66].real
    left, _, right = np.linalg.svd(dcm)  # a rotation to the last digit
    return left @ right, rate, phi, 0.5 * (q + q.T)


def _neighbours(dcm: Matrix) -> Stack:
    """The attitude seven times (7, 3, 3): turned by nothing, by the imaginary unit about each axis, and by nothing."""
    out = np.repeat(dcm[None].astype(complex), 7, axis=0)
    for i, axis in enumerate(np.eye(3)):
        out[1 + i] += 1j * IMAGINARY * -cross(axis, dcm)  # C [axis x]: row by row, c x axis
    return out


def _errors_of(values: Vector) -> Matrix:
    """Phi (6, 6) from what became of the neighbours: columns are what each error has done."""
    attitude, rate = values[:63].reshape(7, 3, 3), values[63:].reshape(7, 3)
    phi, dcm = np.zeros((6, 6)), attitude[0].real
    for column in range(6):
        turn = dcm.T @ attitude[1 + column].imag / IMAGINARY
        phi[:3, column] = turn[2, 1], turn[0, 2], turn[1, 0]
        phi[3:, column] = rate[1 + column].imag / IMAGINARY
    return phi


def integrated(rate: Callable[..., Vector], start: Vector, h: float) -> Matrix:
    """Values at the five nodes of an integral over h, and at its end."""
    from scipy.integrate import solve_ivp

    if h == 0.0:
        return np.repeat(start[None], len(NODES) + 1, axis=0)
    solved = solve_ivp(rate, (0.0, h), start, "DOP853", [*(NODES * h), h], rtol=1e-13, atol=1e-16, first_step=h)
    path: Matrix = solved.y.T
    return path


def _noise_along(flow: Stack, driven: Matrix, h: float) -> tuple[Matrix, Matrix]:
    """Phi of a step, and the white noise that it adds; flow (6, n, n): Phi from its beginning to nodes and end."""
    whole, added = flow[-1], np.zeros(driven.shape)
    for weight, before in zip(WEIGHTS, flow[:-1], strict=True):
        left = whole @ np.linalg.inv(before)
        added += weight * h * left @ driven @ left.T
    return whole, added
