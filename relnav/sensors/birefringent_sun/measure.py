"""The sensor's public call: the two spots of one image in, the sun direction with covariance out."""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import numbers
from relnav.sensors.birefringent_sun.direction import direction_covariance, fit_two_spots, label_spots
from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel
from relnav.sensors.birefringent_sun.spots import direction_of_transverse, metres
from relnav.sensors.measurement import Status
from relnav.sensors.spot_centroid import centroids
from relnav.sensors.sun_direction import SunDirection, direction_with_covariance, no_direction

CHI2_LIMIT = 18.42
"""One good pair in ten thousand agrees worse (chi-square, 2 degrees of freedom)."""


def measure(
    seen: ArrayLike,
    model: BirefringentSunModel,
    *,
    covariance_px2: ArrayLike | None = None,
    corner_px: tuple[float, float] = (0.0, 0.0),
) -> SunDirection:
    """Direction of the sun in sensor axes, from the ordinary and the extraordinary spot of one image.

    It has two degrees of freedom, and a covariance of rank 2: a turn about the sun line cannot be seen in any image of
    it (`observability`). The third axis needs a second vector, or a polarised beacon (`polarised_roll`).

    Parameters
    ----------
    seen : (2, 2) or (rows, columns)
        Centres (x, y) px of the two spots, in any order: which is which follows from how well they agree. A NaN row
        is a spot not seen. Or counts of a read-out window that holds both (the patent's steps 3 and 4).
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
        DEGENERATE for spots too close to be told apart, NO_CONVERGENCE for two that no sun direction explains,
        OUTSIDE_FIELD).

    Raises
    ------
    ValueError
        For another shape.
    """
    sensor = model.sensor
    spots = numbers("seen", seen)
    noise = sensor.spot_noise_px**2 * np.eye(4)
    if covariance_px2 is not None:
        noise = numbers("covariance_px2", covariance_px2)
    if noise.shape != (4, 4):
        raise ValueError(f"covariance_px2 has shape (4, 4); got {noise.shape}")
    if spots.ndim != 2 or (spots.shape != (2, 2) and min(spots.shape) < 4):
        raise ValueError(
            f"two spots (2, 2) in px or an image (rows, columns) of counts are expected; got {spots.shape}"
        )
    if spots.shape != (2, 2):
        found = centroids(spots, model.image, 2, dark=sensor.light_filter == "dot")
        unusable = [spot.status for spot in found if not spot.ok]
        if unusable:
            return no_direction(unusable[0])
        spots = np.array([[spot.x_px, spot.y_px] for spot in found])
        noise = np.zeros((4, 4))
        noise[:2, :2], noise[2:, 2:] = (spot.covariance_px2 for spot in found)
    spots = spots + numbers("corner_px", corner_px)
    if not np.all(np.isfinite(spots)):
        return no_direction(Status.NOT_SEEN)
    if np.any((spots < -0.5) | (spots > np.array(sensor.detector_size_px) - 0.5)):
        return no_direction(Status.OFF_DETECTOR)
    if np.linalg.norm(spots[1] - spots[0]) < sensor.separation_px:
        return no_direction(Status.DEGENERATE)
    spots_m, noise_m2 = metres(sensor, spots), sensor.pixel_pitch_m**2 * noise
    if label_spots(sensor, spots_m, noise_m2)[0]:
        order = [2, 3, 0, 1]
        spots_m, noise_m2 = spots_m[::-1], noise_m2[np.ix_(order, order)]
    fit = fit_two_spots(sensor, spots_m, noise_m2)
    if not fit.chi2 < CHI2_LIMIT:
        return no_direction(Status.NO_CONVERGENCE)
    s = direction_of_transverse(fit.u)
    if s[2] < np.cos(sensor.field_half_angle_rad):
        return no_direction(Status.OUTSIDE_FIELD)
    return direction_with_covariance(s, direction_covariance(fit.u, fit.covariance))
