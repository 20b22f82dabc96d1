"""The sensor's public call: an image of the sun spot, or its centre, in; the sun direction with covariance out."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.sensors.aps_sun.calibration import Calibration, as_built
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.measurement import Status
from relnav.sensors.spot_centroid import ORIGIN, centroid, window_corner
from relnav.sensors.sun_direction import SunDirection, direction_with_covariance, no_direction


def measure(
    seen: ArrayLike,
    model: ApsSunModel,
    *,
    calibration: Calibration | None = None,
    corner_px: tuple[float, float] = ORIGIN,
) -> SunDirection:
    """Direction of the sun in sensor axes, from one image or one spot.

    Parameters
    ----------
    seen : (rows, columns) or (2,)
        Counts of a read-out window; or the centre (x, y) of the spot, px, NaN if none was seen.
    model : ApsSunModel
        A loaded model: detector and read-out.
    calibration : Calibration, optional
        From `relnav calibrate sun` (`relnav.load_sun_calibration`); the model's own dimensions if left out.
    corner_px : (2,)
        Detector coordinates (x, y) of the window's first pixel, or what is to be added to the spot.

    Returns
    -------
    SunDirection
        Bad data never raise: the status says why there is no value (NOT_SEEN, SATURATED, AT_EDGE, OFF_DETECTOR,
        OUTSIDE_FIELD).

    Raises
    ------
    ValueError
        For another shape, or what is not real numbers.
    """
    used, (corner_x, corner_y) = as_built(model) if calibration is None else calibration, window_corner(corner_px)
    array = numbers("seen", seen)
    if array.shape == (2,):
        x, y = array.tolist()
        if not math.isfinite(x + y):
            return no_direction(Status.NOT_SEEN)
        variance = used.spot_noise_px**2
        return _direction(x + corner_x, y + corner_y, (variance, 0.0, variance), model, used)
    if array.ndim != 2:
        raise ValueError(
            f"an image (rows, columns) of counts or a spot (2,) in px is expected; got shape {array.shape}"
        )
    found = centroid(array, model.image)
    if not found.ok:
        return no_direction(found.status)
    return direction_of_spot((found.x_px + corner_x, found.y_px + corner_y), found.covariance_px2, model, used)


def direction_of_spot(
    spot_px: Vector | tuple[float, float], covariance_px2: Matrix, model: ApsSunModel, used: Calibration
) -> SunDirection:
    """Direction of a spot (2,) with covariance (2, 2): P = D (R + c^2 I) D^T, D = d(direction)/d(spot), c of `used`."""
    (xx, xy), (_, yy) = covariance_px2.tolist()
    return _direction(float(spot_px[0]), float(spot_px[1]), (xx, xy, yy), model, used)


def _direction(
    x: float, y: float, covariance: tuple[float, float, float], model: ApsSunModel, used: Calibration
) -> SunDirection:
    width, height = model.sensor.detector_size_px
    if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
        return no_direction(Status.OFF_DETECTOR)
    (xx, xy, yy), more = covariance, used.calibration_noise_px**2
    out = used.form.direction_of(x, y, xx + more, xy, yy + more)
    if not (abs(out[6, 0]) <= used.largest_tangent and abs(out[7, 0]) <= used.largest_tangent):
        return no_direction(Status.OUTSIDE_FIELD)
    return direction_with_covariance(out[0], out[3:6])
