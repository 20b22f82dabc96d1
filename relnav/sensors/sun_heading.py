"""A rover's yaw from the sun, and the drift of its gyro: what the APS patent says a Mars rover's sun sensor is for.

The sun direction s and the upward vertical u, both in body axes, give the angle a from the rover's forward axis f to
the sun about the vertical, h = s - (s.u) u its horizontal part: tan a = u.(f x h) / f.h. With the sun's azimuth Z,
clockwise from north, the yaw is Z + a. Errors of the sun across its azimuth and of the vertical about the sun's
azimuth, of elevation e:

    sigma^2 = sigma_s^2 / cos^2(e) + tan^2(e) sigma_u^2

Yaws of the sun beside those of a gyro over time are a straight line whose slope is the gyro's drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, number, numbers
from relnav.geometry.linear_algebra import lengths
from relnav.sensors.sun_direction import SunDirection

HIGHEST_RAD = math.radians(85.0)
"""Elevation above which the sun tells no yaw."""
OUTLIER = 5.0
"""A yaw so many sigmas from the line through the others is left out."""


def yaw_from_sun(
    sun_body: SunDirection,
    up_body: ArrayLike,
    sun_azimuth_rad: float,
    *,
    forward_body: ArrayLike = (1.0, 0.0, 0.0),
    up_sigma_rad: float = 0.0,
) -> tuple[float, float]:
    """Yaw of the forward axis, clockwise from north, and its 1-sigma, rad.

    Parameters
    ----------
    sun_body : SunDirection
        Measured, in body axes (`SunDirection.turned`), with its covariance.
    up_body, forward_body : (3,)
        The upward vertical, as accelerometers give it at rest, and the forward axis; unit vectors.
    sun_azimuth_rad : float
        Of the sun at that time and place, clockwise from north.
    up_sigma_rad : float
        1-sigma of the vertical about each horizontal axis.

    Raises
    ------
    ValueError
        Without a sun direction; for vectors that are no unit vectors; for a sun within 5 deg of the vertical, or a
        forward axis along it.
    """
    if not sun_body.ok:
        raise ValueError("there is no sun direction to take a yaw from")
    u, f, s = numbers("up_body", up_body), numbers("forward_body", forward_body), np.array(sun_body.direction)
    for name, vector in (("up_body", u), ("forward_body", f)):
        if vector.shape != (3,) or abs(float(lengths(vector)) - 1.0) > 1e-6:
            raise ValueError(f"{name} is a unit vector (3,); got {vector.tolist()}")
    h = s - (s @ u) * u
    cosine, ahead = float(np.linalg.norm(h)), f - (f @ u) * u
    if cosine < math.cos(HIGHEST_RAD) or float(np.linalg.norm(ahead)) < 1e-6:
        raise ValueError("the sun, or the forward axis, stands along the vertical: there is no yaw in it")
    across = np.cross(u, h) / cosine
    angle = math.atan2(float(u @ np.cross(f, h)), float(f @ h))
    variance = float(across @ sun_body.covariance @ across) / cosine**2
    variance += (float(s @ u) / cosine) ** 2 * number("up_sigma_rad", up_sigma_rad) ** 2
    return _wrapped(number("sun_azimuth_rad", sun_azimuth_rad) + angle), math.sqrt(variance)


@dataclass(frozen=True)
class GyroDrift:
    """A gyro's error over a drive.

    Attributes
    ----------
    offset_rad, drift_rad_s : float
        Correction of the gyro's yaw at the first time, and its rate of change.
    covariance : (2, 2)
        Of both, rad^2, rad^2/s, rad^2/s^2.
    used : (n,)
        Whether each yaw was used in the fit.
    """

    offset_rad: float
    drift_rad_s: float
    covariance: Matrix
    used: np.ndarray


def gyro_drift(t_s: ArrayLike, gyro_yaw_rad: ArrayLike, sun_yaw_rad: ArrayLike, sigma_rad: ArrayLike) -> GyroDrift:
    """Offset and drift of a gyro's yaw from yaws of the sun, (n,) each, weighted least squares.

    Outliers are excluded one by one, as long as the worst is more than 5 sigma from the line through the others.

    Raises
    ------
    ValueError
        For fewer than three yaws, arrays of unequal length, times that do not differ or sigmas that are not above zero.
    """
    t, gyro, sun = numbers("t_s", t_s), numbers("gyro_yaw_rad", gyro_yaw_rad), numbers("sun_yaw_rad", sun_yaw_rad)
    sigma = np.broadcast_to(numbers("sigma_rad", sigma_rad), t.shape)
    if t.ndim != 1 or not t.shape == gyro.shape == sun.shape or len(t) < 3:
        shapes = f"{t.shape}, {gyro.shape}, {sun.shape}"
        raise ValueError(f"three yaws or more, arrays (n,) alike, are expected; got {shapes}")
    if not (np.all(sigma > 0.0) and np.ptp(t) > 0.0):
        raise ValueError("sigmas are above zero, and the times differ")
    off = np.unwrap(sun - gyro)
    off += _wrapped(float(off[0])) - off[0]
    J, used = np.column_stack([np.ones(len(t)), t - t[0]]), np.ones(len(t), dtype=bool)
    while True:
        x, covariance = _line(J[used], off[used], sigma[used])
        away = np.abs(off - J @ x) / np.sqrt(np.maximum(sigma**2 - np.einsum("ij,jk,ik->i", J, covariance, J), 1e-300))
        worst = int(np.argmax(np.where(used, away, 0.0)))
        if used.sum() <= 3 or away[worst] < OUTLIER:
            return GyroDrift(float(x[0]), float(x[1]), covariance, used)
        used[worst] = False


def _line(J: Matrix, off: Vector, sigma: Vector) -> tuple[Vector, Matrix]:
    """Weighted least squares and its covariance."""
    weighted = J / sigma[:, None]
    covariance: Matrix = np.asarray(np.linalg.inv(weighted.T @ weighted), dtype=np.float64)
    return covariance @ (weighted.T @ (off / sigma)), covariance


def _wrapped(angle: float) -> float:
    """An angle between -pi and pi."""
    return math.remainder(angle, 2.0 * math.pi)
