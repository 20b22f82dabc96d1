"""From a sun direction to its two spots, and back from either spot alone in closed form."""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector, numbers
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import lengths
from relnav.sensors.birefringent_sun.crystal import extraordinary_root
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor

BISECTIONS = 60


@kernel
def two_spots_into(u: float, v: float, plate: Vector, x: Vector, J: Matrix) -> None:
    """Write the spots (x_o, y_o, x_e, y_e) m of the transverse direction (u, v) into x (4,), and d(spots)/d(u, v).

    plate (7,) is `BirefringentSunSensor.plate`, J (4, 2). NaN where |(u, v)| >= 1. A ray leaves a parallel plate as it
    came:

        x_o = L u / s_z + d k_ot / k_oz,   x_e = L u / s_z + d S_t / S_z,   S = n_o^2 k_e + D (k_e . c) c
    """
    L, d, n_o, n_e, c0, c1, c2 = plate[0], plate[1], plate[2], plate[3], plate[4], plate[5], plate[6]
    w = u * u + v * v
    if not w < 1.0:
        for i in range(4):
            x[i] = J[i, 0] = J[i, 1] = math.nan
        return
    n2, D, z, q = n_o * n_o, n_e * n_e - n_o * n_o, math.sqrt(1.0 - w), math.sqrt(n_o * n_o - w)
    x[0], x[1] = L * u / z + d * u / q, L * v / z + d * v / q
    straight, bent = L / z + d / q, L / (z * z * z) + d / (q * q * q)
    J[0, 0], J[0, 1], J[1, 1] = straight + bent * u * u, bent * u * v, straight + bent * v * v
    J[1, 0] = J[0, 1]
    k_z = extraordinary_root(u, v, c0, c1, c2, n_o, n_e)
    along = u * c0 + v * c1
    slope = -1.0 / ((n2 + D * c2 * c2) * k_z + D * along * c2)  # of the quadratic that k_z solves
    q0, q1 = slope * (D * c0 * (c2 * k_z + along) + n2 * u), slope * (D * c1 * (c2 * k_z + along) + n2 * v)
    turn, turn0, turn1 = D * (along + c2 * k_z), D * (c0 + c2 * q0), D * (c1 + c2 * q1)  # D (k . c), its derivatives
    S_x, S_y, S_z = n2 * u + turn * c0, n2 * v + turn * c1, n2 * k_z + turn * c2
    z0, z1 = n2 * q0 + turn0 * c2, n2 * q1 + turn1 * c2
    t_x, t_y, air = S_x / S_z, S_y / S_z, L / (z * z * z)
    x[2], x[3] = L * u / z + d * t_x, L * v / z + d * t_y
    J[2, 0] = L / z + air * u * u + d * (n2 + turn0 * c0 - t_x * z0) / S_z
    J[2, 1] = air * u * v + d * (turn1 * c0 - t_x * z1) / S_z
    J[3, 0] = air * u * v + d * (turn0 * c1 - t_y * z0) / S_z
    J[3, 1] = L / z + air * v * v + d * (n2 + turn1 * c1 - t_y * z1) / S_z


@kernel
def ordinary_scale(x: float, y: float, plate: Vector) -> float:
    """Factor from an ordinary spot (x, y) m to its transverse direction; NaN where no light from the front reaches.

    L = 0: n_o / sqrt(|x|^2 + d^2). Else L w / sqrt(1 - w^2) + d w / sqrt(n_o^2 - w^2) = |x| by bisection.
    """
    L, d, n_o = plate[0], plate[1], plate[2]
    rho2 = x * x + y * y
    if L == 0.0:
        scale = n_o / math.sqrt(rho2 + d * d)
        return scale if scale * scale * rho2 < 1.0 else math.nan
    rho, low, high = math.sqrt(rho2), 0.0, 1.0
    for _ in range(BISECTIONS):
        w = 0.5 * (low + high)
        if L * w / math.sqrt(max(1.0 - w * w, 1e-300)) + d * w / math.sqrt(n_o * n_o - w * w) < rho:
            low = w
        else:
            high = w
    w = 0.5 * (low + high)
    if not w < 1.0:
        return math.nan
    return w / rho if rho > 0.0 else 0.0


def _both(sensor: BirefringentSunSensor, u: ArrayLike) -> tuple[Stack, Stack]:
    """Spots (..., 2, 2) m and their Jacobian (..., 4, 2) of transverse directions (..., 2)."""
    places = numbers("u", u)
    pairs = places.reshape(-1, 2).tolist()
    spots, slopes = np.empty((len(pairs), 4)), np.empty((len(pairs), 4, 2))
    for k, (along, across) in enumerate(pairs):
        two_spots_into(along, across, sensor.plate, spots[k], slopes[k])
    shape = places.shape[:-1]
    return spots.reshape(*shape, 2, 2), slopes.reshape(*shape, 4, 2)


def spots_of_transverse(sensor: BirefringentSunSensor, u: ArrayLike) -> Stack:
    """Spots (..., 2, 2) m of transverse directions u = (s_x, s_y) (..., 2): rows o, e; NaN where |u| >= 1."""
    return _both(sensor, u)[0]


def spots_jacobian(sensor: BirefringentSunSensor, u: ArrayLike) -> Stack:
    """d(x_o, y_o, x_e, y_e)/du, (..., 4, 2) m."""
    return _both(sensor, u)[1]


def project(sensor: BirefringentSunSensor, s: ArrayLike) -> Stack:
    """Spots (..., 2, 2) px, rows o, e, of sun directions (..., 3), unit vectors; NaN for a sun behind.

    Raises
    ------
    ValueError
        For another last axis, or vectors that are not of unit length within 1e-6.
    """
    s = numbers("s", s)
    if s.shape[-1:] != (3,):
        raise ValueError(f"a direction has 3 components in its last axis; got shape {s.shape}")
    if np.any(np.abs(lengths(s) - 1.0) > 1e-6):
        raise ValueError("sun directions are unit vectors (within 1e-6)")
    seen = np.where(s[..., 2:] > 0.0, s[..., :2], np.nan)
    return np.array(sensor.zero_spot_px) + spots_of_transverse(sensor, seen) / sensor.pixel_pitch_m


def transverse_from_ordinary(sensor: BirefringentSunSensor, x: ArrayLike) -> Matrix:
    """Transverse u (..., 2) of ordinary spots x (..., 2) m; NaN where no light from the front reaches."""
    spots = numbers("x", x)
    scale = [ordinary_scale(along, across, sensor.plate) for along, across in spots.reshape(-1, 2).tolist()]
    u: Matrix = spots * np.array(scale).reshape(*spots.shape[:-1], 1)
    return u


def transverse_from_extraordinary(sensor: BirefringentSunSensor, x: ArrayLike) -> Matrix:
    """Transverse u (..., 2) of extraordinary spots x (..., 2) m, for L = 0: u = [M X]_t / sqrt(X^T M X), X = (x, d).

    By Fermat: the optical path of the e ray to X is sqrt(X^T M X), M = n_e^2 I + (n_o^2 - n_e^2) c c^T, and the
    transverse wave vector is its gradient.

    Raises
    ------
    ValueError
        With an air path: there is no closed form.
    """
    if sensor.air_path_m > 0.0:
        raise ValueError("the extraordinary spot alone has a closed form only without an air path")
    x = numbers("x", x)
    n_o, n_e, c = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
    X = np.concatenate([x, np.full_like(x[..., :1], sensor.crystal_thickness_m)], axis=-1)
    MX = n_e**2 * X + (n_o**2 - n_e**2) * (X @ c)[..., None] * c
    u = MX[..., :2] / np.sqrt(np.sum(X * MX, axis=-1, keepdims=True))
    return np.where(np.sum(u**2, axis=-1, keepdims=True) < 1.0, u, np.nan)


def metres(sensor: BirefringentSunSensor, spots_px: Matrix) -> Matrix:
    """Spots (..., 2) from the pixel under the opening, m."""
    offset: Matrix = (spots_px - np.array(sensor.zero_spot_px)) * sensor.pixel_pitch_m
    return offset


def separation_m(sensor: BirefringentSunSensor, u: Matrix) -> Vector:
    """Distance (...) of the two spots of u (..., 2), m."""
    spots = spots_of_transverse(sensor, u)
    apart: Vector = np.linalg.norm(spots[..., 1, :] - spots[..., 0, :], axis=-1)
    return apart
