"""True rotation of the target: quaternions in inertial space, many runs at once; nothing of the filter's formulas.

Euler's equations with the torque of the gravity gradient and white angular acceleration, by classical Runge-Kutta. At
t = 0 the inertial frame is `lvlh_ccsds`.
"""

import math

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import Orbit


def true_anomaly_rad(t_s: float, orbit: Orbit) -> float:
    """Of the target at t_s, by Kepler's equation M = E - e sin E solved between bounds."""
    e, half = orbit.eccentricity, 0.5 * orbit.true_anomaly_rad
    start = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(half), math.sqrt(1.0 + e) * math.cos(half))
    mean = start - e * math.sin(start) + orbit.mean_motion_rad_s * t_s
    eccentric = float(brentq(lambda x: x - e * math.sin(x) - mean, mean - 1.1, mean + 1.1, xtol=1e-14, rtol=1e-14))
    turns = 2.0 * math.pi * math.floor((eccentric + math.pi) / (2.0 * math.pi))
    half = 0.5 * (eccentric - turns)
    return turns + 2.0 * math.atan2(math.sqrt(1.0 + e) * math.sin(half), math.sqrt(1.0 - e) * math.cos(half))


def lvlh_from_inertial(t_s: float, orbit: Orbit) -> Rotation:
    """Rotation of components from the inertial frame into `lvlh_ccsds`, which turns about -y."""
    angle = orbit.mean_motion_rad_s * t_s
    if orbit.eccentricity > 0.0:
        angle = true_anomaly_rad(t_s, orbit) - true_anomaly_rad(0.0, orbit)
    return Rotation.from_rotvec([0.0, angle, 0.0])


def _gradient(t_s: float, orbit: Orbit) -> float:
    """Three times mu / r^3, 1/s^2."""
    e = orbit.eccentricity
    near = 1.0 if e == 0.0 else (1.0 + e * math.cos(true_anomaly_rad(t_s, orbit))) / (1.0 - e * e)
    return 3.0 * orbit.mean_motion_rad_s**2 * near**3


def rotate_target(
    t_s: Vector,
    q_lvlh_from_target: Matrix,
    rate_rad_s: Matrix,
    inertia_kg_m2: Matrix,
    orbit: Orbit,
    rate_noise_density_rad2_s3: float,
    rng: np.random.Generator,
) -> tuple[Stack, Stack]:
    """Attitudes dcm_lvlh_from_target (n, runs, 3, 3) and inertial rates (n, runs, 3), target axes, at times t_s (n,).

    q_lvlh_from_target (runs, 4), scalar last, and rate_rad_s (runs, 3) are those at t_s[0] = 0.
    """
    q, w = np.array(q_lvlh_from_target), np.array(rate_rad_s)
    inverse = np.linalg.inv(inertia_kg_m2)

    def derivative(t: float, q: Matrix, w: Matrix, push: Matrix) -> tuple[Matrix, Matrix]:
        x, y, z, s = q.T
        turn = 0.5 * np.stack(
            [
                s * w[:, 0] + y * w[:, 2] - z * w[:, 1],
                s * w[:, 1] + z * w[:, 0] - x * w[:, 2],
                s * w[:, 2] + x * w[:, 1] - y * w[:, 0],
                -x * w[:, 0] - y * w[:, 1] - z * w[:, 2],
            ],
            axis=-1,
        )
        nadir = lvlh_from_inertial(t, orbit).inv().apply([0.0, 0.0, 1.0])
        o = Rotation.from_quat(q).inv().apply(nadir)
        torque = _gradient(t, orbit) * np.cross(o, o @ inertia_kg_m2) - np.cross(w, w @ inertia_kg_m2)
        return turn, torque @ inverse + push

    dcm, rate = np.empty((len(t_s), len(q), 3, 3)), np.empty((len(t_s), len(q), 3))
    dcm[0], rate[0] = Rotation.from_quat(q).as_matrix(), w
    for k in range(1, len(t_s)):
        t, dt = float(t_s[k - 1]), float(t_s[k] - t_s[k - 1])
        push = np.sqrt(rate_noise_density_rad2_s3 / dt) * rng.normal(size=w.shape)
        a, b = derivative(t, q, w, push)
        c, d = derivative(t + 0.5 * dt, q + 0.5 * dt * a, w + 0.5 * dt * b, push)
        e, f = derivative(t + 0.5 * dt, q + 0.5 * dt * c, w + 0.5 * dt * d, push)
        g, h = derivative(t + dt, q + dt * e, w + dt * f, push)
        q = q + dt / 6.0 * (a + 2.0 * c + 2.0 * e + g)
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        w = w + dt / 6.0 * (b + 2.0 * d + 2.0 * f + h)
        dcm[k] = (lvlh_from_inertial(float(t_s[k]), orbit) * Rotation.from_quat(q)).as_matrix()
        rate[k] = w
    return dcm, rate
