"""The sensor's public call: an image of the sun spot, or its centre, in; the sun direction with covariance out."""

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.geometry.projection_angles import tangents_from_direction
from relnav.sensors.aps_sun.calibration import MARGIN_RAD, Calibration, as_built, spot_to_direction
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.measurement import Status
from relnav.sensors.spot_centroid import centroid
from relnav.sensors.sun_direction import SunDirection, direction_with_covariance, no_direction


def measure(
    seen: ArrayLike,
    model: ApsSunModel,
    *,
    calibration: Calibration | None = None,
    corner_px: tuple[float, float] = (0.0, 0.0),
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
        For another shape.
    """
    used = as_built(model) if calibration is None else calibration
    array = numbers("seen", seen)
    if array.shape == (2,):
        spot, noise = array, used.spot_noise_px**2 * np.eye(2)
        status = Status.OK if np.all(np.isfinite(array)) else Status.NOT_SEEN
    elif array.ndim == 2:
        found = centroid(array, model.image)
        spot, noise, status = np.array([found.x_px, found.y_px]), found.covariance_px2, found.status
    else:
        raise ValueError(
            f"an image (rows, columns) of counts or a spot (2,) in px is expected; got shape {array.shape}"
        )
    if status is not Status.OK:
        return no_direction(status)
    return direction_of_spot(spot + numbers("corner_px", corner_px), noise, model, used)


def direction_of_spot(spot_px: Vector, covariance_px2: Matrix, model: ApsSunModel, used: Calibration) -> SunDirection:
    """Direction of a spot (2,) with covariance (2, 2): P = D (R + c^2 I) D^T, D = d(direction)/d(spot), c of `used`."""
    width, height = model.sensor.detector_size_px
    if not (-0.5 <= spot_px[0] <= width - 0.5 and -0.5 <= spot_px[1] <= height - 0.5):
        return no_direction(Status.OFF_DETECTOR)
    s, slope = spot_to_direction(used, float(spot_px[0]), float(spot_px[1]))
    limit = np.tan(used.field_half_angle_rad + MARGIN_RAD)
    if not (s[2] > 0.0 and np.all(np.abs(tangents_from_direction(s)) <= limit)):
        return no_direction(Status.OUTSIDE_FIELD)
    noise = covariance_px2 + used.calibration_noise_px**2 * np.eye(2)
    return direction_with_covariance(s, slope @ noise @ slope.T)
