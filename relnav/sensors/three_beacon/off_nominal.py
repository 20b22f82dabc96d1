"""Beyond the domain of the closed form: every position that explains an image, by the perspective three-point problem.

Far off the docking axis, or close in, up to four poses show the same three spots; `measure` then gives no value
(OUTSIDE_DOMAIN). Which of them is true, an image cannot tell: a prior must.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.geometry.p3p import camera_in_target, p3p
from relnav.sensors.three_beacon.fix import image_rays
from relnav.sensors.three_beacon.measure import HasSensor
from relnav.sensors.three_beacon.sensor import ThreeBeaconSensor


def positions(spots_m: ArrayLike, model: HasSensor | ThreeBeaconSensor) -> Matrix:
    """Every position of the sensor that explains an image, whatever its attitude.

    Parameters
    ----------
    spots_m : (3, 2)
        Detector coordinates of beacons A, B, C, m.
    model : Model or ThreeBeaconSensor
        A loaded model or its sensor.

    Returns
    -------
    (k, 3), k = 0 to 4
        Docking frame, m; those in front of the docking plane (x > 0) first. None for a spot that is not a number.

    Raises
    ------
    ValueError
        For spots of another shape.
    """
    sensor = model if isinstance(model, ThreeBeaconSensor) else model.sensor
    spots = numbers("spots_m", spots_m)
    if spots.shape != (3, 2):
        raise ValueError(f"spots_m has shape (3, 2), rows A, B, C, columns x, y in metres; got {spots.shape}")
    rays, found = np.empty((3, 3)), list[Vector]()
    if not np.isfinite(spots).all():
        return np.empty((0, 3))
    image_rays(spots, sensor.focal_length_m, rays)
    for pose in p3p(rays, sensor.beacons_dock_m[:3]):
        position = np.empty(3)
        camera_in_target(np.ascontiguousarray(pose), position)
        if not any(np.linalg.norm(position - other) < 1e-6 * np.linalg.norm(position) for other in found):
            found.append(position)
    found.sort(key=lambda position: float(position[0]) <= 0.0)
    return np.array(found).reshape(-1, 3)
