"""A target's orbit in space: inertial position and velocity by Kepler's equation, the Earth as a point mass.

Bate, Mueller, White (1971), "Fundamentals of Astrodynamics", sections 2.5 and 4.2: perifocal position and velocity,
turned by the argument of perigee, the inclination and the right ascension of the ascending node.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.dynamics.yamanaka_ankersen import mean_from_true_anomaly, true_from_mean_anomaly

MU_EARTH_M3_S2 = 3.986004418e14
"""IERS Conventions (2010), table 1.1."""


def inertial_orbit(
    mean_motion_rad_s: float,
    eccentricity: float,
    true_anomaly_rad: float,
    orientation_rad: tuple[float, float, float],
    t_s: Vector,
) -> tuple[Matrix, Matrix]:
    """Positions m and velocities m/s (n, 3), (n, 3) at times (n,).

    Parameters
    ----------
    mean_motion_rad_s, eccentricity, true_anomaly_rad : float
        As `mission.Orbit`: the anomaly at t = 0, from perigee; on a circular orbit from where the argument points.
    orientation_rad : (3,)
        Inclination, right ascension of the ascending node, argument of perigee.
    t_s : (n,)
        Times.
    """
    e, n = eccentricity, mean_motion_rad_s
    mean = mean_from_true_anomaly(e, true_anomaly_rad) + n * np.asarray(t_s, dtype=np.float64)
    turns = np.floor(mean / math.tau)
    anomaly = np.array([true_from_mean_anomaly(e, m) for m in (mean - math.tau * turns).tolist()])
    inclination, node, perigee = orientation_rad
    semi_latus = (MU_EARTH_M3_S2 / n**2) ** (1.0 / 3.0) * (1.0 - e * e)
    c, s = np.cos(anomaly), np.sin(anomaly)
    radius, speed = semi_latus / (1.0 + e * c), math.sqrt(MU_EARTH_M3_S2 / semi_latus)
    ci, si, cn, sn = math.cos(inclination), math.sin(inclination), math.cos(node), math.sin(node)
    cp, sp = math.cos(perigee), math.sin(perigee)
    p = np.array([cn * cp - sn * sp * ci, sn * cp + cn * sp * ci, sp * si])
    q = np.array([-cn * sp - sn * cp * ci, -sn * sp + cn * cp * ci, cp * si])
    position = (radius * c)[:, None] * p + (radius * s)[:, None] * q
    velocity = (-speed * s)[:, None] * p + (speed * (e + c))[:, None] * q
    return position, velocity
