"""All three axes of the attitude from the sun and a second vector: a star, the horizon, the way to the target.

The sun alone leaves the turn about its own line unknown. A second vector at angle eta from it gives that turn with

    sigma_roll^2 = (sigma_2^2 + cos^2(eta) sigma_sun^2) / sin^2(eta)
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, numbers
from relnav.geometry.rotation import triad
from relnav.geometry.rotation_vector import turned
from relnav.sensors.sun_direction import SunDirection, attitude_observation

PASSES = 3
CLOSEST_RAD = math.radians(1.0)


def attitude_from_sun_and_vector(
    sun_body: SunDirection, second_body: SunDirection, sun_inertial: ArrayLike, second_inertial: ArrayLike
) -> tuple[Matrix, Matrix]:
    """Least-squares attitude from two measured directions.

    Parameters
    ----------
    sun_body, second_body : SunDirection
        Measured, in body axes, each with its covariance.
    sun_inertial, second_inertial : (3,)
        Where they are, unit vectors.

    Returns
    -------
    dcm_body_from_inertial : (3, 3)
    covariance : (3, 3)
        Of the attitude's error, body axes, rad^2: dcm_true = exp(-[theta x]) dcm.

    Raises
    ------
    ValueError
        If the two vectors are less than a degree apart or opposite: the roll about them is then not known.
    """
    sun, second = numbers("sun_inertial", sun_inertial), numbers("second_inertial", second_inertial)
    apart = math.atan2(float(np.linalg.norm(np.cross(sun, second))), abs(float(sun @ second)))
    if not apart >= CLOSEST_RAD:
        raise ValueError(f"the second vector lies {math.degrees(apart):.3g} deg from the sun line; 1 deg is the least")
    axes_body, axes_inertial = np.empty((3, 3)), np.empty((3, 3))
    triad(np.array(sun_body.direction), np.array(second_body.direction), axes_body)
    triad(sun, second, axes_inertial)
    dcm: Matrix = axes_body.T @ axes_inertial
    for _ in range(PASSES):
        parts = [attitude_observation(sun_body, sun, dcm), attitude_observation(second_body, second, dcm)]
        information = sum(p.jacobian.T @ np.linalg.solve(p.covariance, p.jacobian) for p in parts)
        pull = sum(p.jacobian.T @ np.linalg.solve(p.covariance, p.innovation) for p in parts)
        covariance: Matrix = np.linalg.inv(np.asarray(information))
        dcm = turned(dcm.T, covariance @ pull).T
    return dcm, covariance
