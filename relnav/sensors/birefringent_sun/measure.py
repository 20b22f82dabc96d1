"""The sensor's public call: the two spots of one image in, the sun direction with covariance out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, numbers, one_piece
from relnav.sensors.birefringent_sun.direction import WORK_ROWS, fit_pair
from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel, BirefringentSunSensor
from relnav.sensors.measurement import Status
from relnav.sensors.spot_centroid import ORIGIN, centroids, window_corner
from relnav.sensors.sun_direction import SunDirection, direction_with_covariance, no_direction

CHI2_LIMIT = 18.42
"""One good pair in ten thousand agrees worse (chi-square, 2 degrees of freedom)."""


def measure(
    seen: ArrayLike,
    model: BirefringentSunModel,
    *,
    covariance_px2: ArrayLike | None = None,
    corner_px: tuple[float, float] = ORIGIN,
) -> SunDirection:
    """Direction of the sun in sensor axes, from the ordinary and the extraordinary spot of one image.

    It has two degrees of freedom, and a covariance of rank 2: a rotation about the sun line is not observable
    (`observability`). The third axis needs a second vector, or a polarised beacon (`polarised_roll`).

    Parameters
    ----------
    seen : (2, 2) or (rows, columns)
        Centres (x, y) px of the two spots, in any order: which is the ordinary one follows from how well they agree. A
        NaN row is a spot not seen. Or counts of a read-out window that holds both (the patent's steps 3 and 4).
    model : BirefringentSunModel
        A loaded model.
    covariance_px2 : (4, 4), optional
        Of (x, y) of the first and the second row; the sensor's spot noise if left out. An image brings its own.
    corner_px : (2,)
        Detector coordinates (x, y) of the window's first pixel, or what is to be added to the spots.

    Returns
    -------
    SunDirection
        Bad data never raise: the status says why there is no value (NOT_SEEN, SATURATED, AT_EDGE, OFF_DETECTOR,
        DEGENERATE for spots too close to be separated, NO_CONVERGENCE for two that no sun direction explains,
        OUTSIDE_FIELD).

    Raises
    ------
    ValueError
        For another shape, what is not real numbers, or a covariance that is not symmetric and positive definite.
    """
    sensor, (corner_x, corner_y) = model.sensor, window_corner(corner_px)
    image = numbers("seen", seen)
    if image.shape == (2, 2):
        x, y, p, q = image.ravel().tolist()
        noise = sensor.noise_m2
        if covariance_px2 is not None:
            noise = sensor.pixel_pitch_m**2 * _covariance(covariance_px2)
    elif image.ndim == 2 and min(image.shape) >= 4:
        found = centroids(image, model.image, 2, dark=sensor.light_filter == "dot")
        unusable = [spot.status for spot in found if not spot.ok]
        if unusable:
            return no_direction(unusable[0])
        (x, y), (p, q) = ((spot.x_px, spot.y_px) for spot in found)
        noise = np.zeros((4, 4))
        noise[:2, :2], noise[2:, 2:] = (sensor.pixel_pitch_m**2 * spot.covariance_px2 for spot in found)
    else:
        raise ValueError(
            f"two spots (2, 2) in px or an image (rows, columns) of counts are expected; got {image.shape}"
        )
    return _direction(sensor, (x + corner_x, y + corner_y, p + corner_x, q + corner_y), noise)


def _covariance(covariance_px2: ArrayLike) -> Matrix:
    noise = one_piece("covariance_px2", covariance_px2)
    if noise.shape != (4, 4):
        raise ValueError(f"covariance_px2 has shape (4, 4); got {noise.shape}")
    return noise


def _direction(sensor: BirefringentSunSensor, spots: tuple[float, float, float, float], noise: Matrix) -> SunDirection:
    """Direction of two spots (x, y, x, y) px in any order, with covariance (4, 4) m^2."""
    x, y, p, q = spots
    if not all(map(math.isfinite, spots)):
        return no_direction(Status.NOT_SEEN)
    width, height = sensor.detector_size_px
    right, low = width - 0.5, height - 0.5
    if not (-0.5 <= x <= right and -0.5 <= y <= low and -0.5 <= p <= right and -0.5 <= q <= low):
        return no_direction(Status.OFF_DETECTOR)
    if math.hypot(p - x, q - y) < sensor.separation_px:
        return no_direction(Status.DEGENERATE)
    pitch, (zero_x, zero_y) = sensor.pixel_pitch_m, sensor.zero_spot_px
    spots_m = np.array([pitch * (x - zero_x), pitch * (y - zero_y), pitch * (p - zero_x), pitch * (q - zero_y)])
    work, fits = np.empty((WORK_ROWS, 4)), np.empty((2, 6))
    for order in range(2):  # the ordinary spot is the first, or the second
        if not fit_pair(spots_m, noise, 2 * order, sensor.plate, work, fits[order]):
            return _without_covariance(noise / pitch**2)
    given, exchanged = fits.tolist()
    u, v, p_uu, p_uv, p_vv, chi2 = exchanged if exchanged[5] < given[5] or math.isnan(given[5]) else given
    if not chi2 < CHI2_LIMIT:
        return no_direction(Status.NO_CONVERGENCE)
    s_z = math.sqrt(1.0 - u * u - v * v)
    if s_z < math.cos(sensor.field_half_angle_rad):
        return no_direction(Status.OUTSIDE_FIELD)
    # D P D^T with D = (I; -u^T / s_z): the covariance of the unit vector, rank 2
    p_uz, p_vz = -(p_uu * u + p_uv * v) / s_z, -(p_uv * u + p_vv * v) / s_z
    p_zz = -(p_uz * u + p_vz * v) / s_z
    return direction_with_covariance(
        np.array([u, v, s_z]), np.array([[p_uu, p_uv, p_uz], [p_uv, p_vv, p_vz], [p_uz, p_vz, p_zz]])
    )


def _without_covariance(noise: Matrix) -> SunDirection:
    """No direction where a spot's covariance is not finite; ValueError for one that is none."""
    if np.isfinite(noise).all():
        raise ValueError(f"covariance_px2 is symmetric and positive definite; got {noise.tolist()}")
    return no_direction(Status.NO_CONVERGENCE)
