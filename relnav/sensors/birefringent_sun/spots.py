"""From a sun direction to its two spots, and back from either spot alone in closed form."""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector
from relnav.geometry.pinhole import central_projection
from relnav.sensors.birefringent_sun.crystal import extraordinary_ray, extraordinary_wave, ordinary_wave
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor

STEP = 1e-5


def spots_of_transverse(sensor: BirefringentSunSensor, u: ArrayLike) -> Stack:
    """Spots (..., 2, 2) m of transverse directions u = (s_x, s_y) (..., 2): rows o, e; NaN where |u| >= 1.

    x_o = L u / s_z + d k_ot / k_oz,   x_e = L u / s_z + d S_t / S_z: a ray leaves a parallel plate as it came.
    """
    u = np.asarray(u, dtype=np.float64)
    left = 1.0 - np.sum(u**2, axis=-1, keepdims=True)
    in_air = sensor.air_path_m * u / np.sqrt(np.where(left > 0.0, left, np.nan))
    n_o, n_e, axis, d = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis, sensor.crystal_thickness_m
    o = ordinary_wave(u, n_o)
    e = extraordinary_ray(extraordinary_wave(u, axis, n_o, n_e), axis, n_o, n_e)
    spots: Stack = np.stack([in_air + d * central_projection(ray) for ray in (o, e)], axis=-2)
    return spots


def project(sensor: BirefringentSunSensor, s: ArrayLike) -> Stack:
    """Spots (..., 2, 2) px, rows o, e, of sun directions (..., 3), unit vectors; NaN for a sun behind.

    Raises
    ------
    ValueError
        For another last axis, or vectors that are not of unit length within 1e-6.
    """
    s = np.asarray(s, dtype=np.float64)
    if s.shape[-1:] != (3,):
        raise ValueError(f"a direction has 3 components in its last axis; got shape {s.shape}")
    if np.any(np.abs(np.linalg.norm(s, axis=-1) - 1.0) > 1e-6):
        raise ValueError("sun directions are unit vectors (within 1e-6)")
    seen = np.where(s[..., 2:] > 0.0, s[..., :2], np.nan)
    return np.array(sensor.zero_spot_px) + spots_of_transverse(sensor, seen) / sensor.pixel_pitch_m


def spots_jacobian(sensor: BirefringentSunSensor, u: Matrix) -> Stack:
    """d(x_o, y_o, x_e, y_e)/du, (..., 4, 2) m, by central differences."""
    columns = []
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = STEP
        ahead, behind = spots_of_transverse(sensor, u + step), spots_of_transverse(sensor, u - step)
        columns.append(((ahead - behind) / (2.0 * STEP)).reshape(*u.shape[:-1], 4))
    return np.stack(columns, axis=-1)


def transverse_from_ordinary(sensor: BirefringentSunSensor, x: ArrayLike) -> Matrix:
    """Transverse u (..., 2) of ordinary spots x (..., 2) m; NaN where no light from the front reaches.

    L = 0: u = n_o x / sqrt(|x|^2 + d^2). Else L w / sqrt(1 - w^2) + d w / sqrt(n_o^2 - w^2) = |x| by bisection.
    """
    x = np.asarray(x, dtype=np.float64)
    d, L, n_o = sensor.crystal_thickness_m, sensor.air_path_m, sensor.ordinary_index
    rho = np.linalg.norm(x, axis=-1, keepdims=True)
    if L == 0.0:
        return _in_front(n_o * x / np.sqrt(rho**2 + d**2))
    low, high = np.zeros_like(rho), np.ones_like(rho)
    for _ in range(60):
        w = 0.5 * (low + high)
        reaches = L * w / np.sqrt(np.maximum(1.0 - w**2, 1e-300)) + d * w / np.sqrt(n_o**2 - w**2) < rho
        low, high = np.where(reaches, w, low), np.where(reaches, high, w)
    w = 0.5 * (low + high)
    return _in_front(w * x / np.where(rho > 0.0, rho, 1.0))


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
    x = np.asarray(x, dtype=np.float64)
    n_o, n_e, c = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
    X = np.concatenate([x, np.full_like(x[..., :1], sensor.crystal_thickness_m)], axis=-1)
    MX = n_e**2 * X + (n_o**2 - n_e**2) * (X @ c)[..., None] * c
    return _in_front(MX[..., :2] / np.sqrt(np.sum(X * MX, axis=-1, keepdims=True)))


def direction_of_transverse(u: Matrix) -> Matrix:
    """Unit vectors (..., 3) of u (..., 2)."""
    z = np.sqrt(1.0 - np.sum(u**2, axis=-1, keepdims=True))
    return np.concatenate([u, z], axis=-1)


def metres(sensor: BirefringentSunSensor, spots_px: Matrix) -> Matrix:
    """Spots (..., 2) from the pixel under the opening, m."""
    offset: Matrix = (spots_px - np.array(sensor.zero_spot_px)) * sensor.pixel_pitch_m
    return offset


def separation_m(sensor: BirefringentSunSensor, u: Matrix) -> Vector:
    """Distance (...) of the two spots of u (..., 2), m."""
    spots = spots_of_transverse(sensor, u)
    apart: Vector = np.linalg.norm(spots[..., 1, :] - spots[..., 0, :], axis=-1)
    return apart


def _in_front(u: Matrix) -> Matrix:
    inside = np.sum(u**2, axis=-1, keepdims=True) < 1.0
    return np.where(inside, u, np.nan)
