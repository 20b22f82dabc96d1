"""The sensor's public call: spots of one image in, range, azimuth and elevation with covariance out."""

from __future__ import annotations

from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import one_piece
from relnav.sensors.measurement import OK, Measurement, Status
from relnav.sensors.three_beacon.fix import MEASURE_ROWS, PARALLEL, PERSPECTIVE, measure_into
from relnav.sensors.three_beacon.implied import implied_pose
from relnav.sensors.three_beacon.sensor import ThreeBeaconSensor

PROJECTIONS = {"perspective": PERSPECTIVE, "parallel": PARALLEL}


class HasSensor(Protocol):
    """Anything that carries a three-beacon sensor, such as a loaded model."""

    @property
    def sensor(self) -> ThreeBeaconSensor:
        """The sensor."""
        ...


def measure(spots_m: ArrayLike, model: HasSensor | ThreeBeaconSensor, *, projection: str | None = None) -> Measurement:
    """Range, azimuth and elevation of the sensor in the target's docking frame, and its attitude there, from one image.

    Parameters
    ----------
    spots_m : (3, 2)
        Detector coordinates of beacons A, B, C, m (x right, y down); a NaN row is a beacon not seen. A model's
        calibration is applied to them.
    model : Model or ThreeBeaconSensor
        A loaded model or its sensor.
    projection : {"perspective", "parallel"}, optional
        The closed form; the model's own if left out. "perspective" is exact for real optics, "parallel" is eqs (4)-(13)
        of the paper as printed.

    Returns
    -------
    Measurement
        With the covariance that the sensor's spot noise implies. Bad data never raise: the status says why there is
        no value.

    Raises
    ------
    ValueError
        For spots of another shape or an unknown projection.
    """
    sensor = model if isinstance(model, ThreeBeaconSensor) else model.sensor
    spots = one_piece("spots_m", spots_m)
    if spots.shape != (3, 2):
        raise ValueError(f"spots_m has shape (3, 2), rows A, B, C, columns x, y in metres; got {spots.shape}")
    calibration = getattr(model, "calibration", None)
    noise = sensor.spot_noise_m
    if calibration is not None:
        spots, noise = calibration.correct(spots), float(np.hypot(noise, calibration.residual_sigma_m))
    name = sensor.projection if projection is None else projection
    if name not in PROJECTIONS:
        raise ValueError(f'projection must be "perspective" or "parallel"; got {name!r}')
    rae, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    status = measure_into(
        spots,
        sensor.focal_length_m,
        0.5 * sensor.detector_size_m[0],
        0.5 * sensor.detector_size_m[1],
        noise,
        sensor.beacon_half_spacing_m,
        sensor.beacon_c_distance_m,
        PROJECTIONS[name],
        rae,
        covariance,
        np.zeros((MEASURE_ROWS, 6)),
    )
    covariance.setflags(write=False)
    implied = None
    if status == OK and name == "perspective":
        implied = partial(implied_pose, spots.copy(), sensor, noise)
    return Measurement(float(rae[0]), float(rae[1]), float(rae[2]), covariance, Status(status), implied)
