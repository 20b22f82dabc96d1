"""True rotation of the target: quaternions in inertial space, many runs at once; nothing of the filter's formulas.

Euler's equations with the torque of the gravity gradient and white angular acceleration, by classical Runge-Kutta. At
t = 0 the inertial frame is `lvlh_ccsds`.
"""

import math

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import kernel
from relnav.dynamics.inertia_error import INERTIA_ENTRIES
from relnav.mission import Orbit, Target


def true_inertia(target: Target, off: Vector) -> Matrix:
    """The inertia (3, 3) that flies, kg m^2: the stated one, each entry off by so many of its sigmas, off (6,).

    By half of that, and so on, as long as no body has it.
    """
    stated, error = np.array(target.inertia_kg_m2), np.zeros((3, 3))
    for k, (i, j) in enumerate(INERTIA_ENTRIES):
        error[i, j] = error[j, i] = off[k] * target.inertia_sigma_kg_m2[i][j]
    while not np.linalg.eigvalsh(stated + error)[0] > 0.0:
        error *= 0.5
    out: Matrix = stated + error
    return out


def true_anomaly_rad(t_s: float, orbit: Orbit) -> float:
    """Of the target at t_s, by Kepler's equation M = E - e sin E solved between bounds."""
    e, half = orbit.eccentricity, 0.5 * orbit.true_anomaly_rad
    start = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(half), math.sqrt(1.0 + e) * math.cos(half))
    mean = start - e * math.sin(start) + orbit.mean_motion_rad_s * t_s
    eccentric = float(brentq(lambda x: x - e * math.sin(x) - mean, mean - 1.1, mean + 1.1, xtol=1e-14, rtol=1e-14))
    turns = 2.0 * math.pi * math.floor((eccentric + math.pi) / (2.0 * math.pi))
    half = 0.5 * (eccentric - turns)
    return turns + 2.0 * math.atan2(math.sqrt(1.0 + e) * math.sin(half), math.sqrt(1.0 - e) * math.cos(half))


def turning_rad_s(t_s: float, orbit: Orbit) -> float:
    """Rate at which `lvlh_ccsds` turns about -y at t_s: that of the target's true anomaly."""
    if orbit.eccentricity == 0.0:
        return orbit.mean_motion_rad_s
    p = 1.0 - orbit.eccentricity**2
    near = (1.0 + orbit.eccentricity * math.cos(true_anomaly_rad(t_s, orbit))) / p
    return orbit.mean_motion_rad_s * near**2 * math.sqrt(p)


def lvlh_from_inertial(t_s: float | Vector, orbit: Orbit) -> Rotation:
    """Rotation of components from the inertial frame into `lvlh_ccsds`, which turns about -y; one, or one a time."""
    t = np.asarray(t_s, dtype=np.float64)
    angle = orbit.mean_motion_rad_s * t
    if orbit.eccentricity > 0.0:
        angle = _true_anomalies(t, orbit) - true_anomaly_rad(0.0, orbit)
    return Rotation.from_rotvec(angle[..., None] * np.array([0.0, 1.0, 0.0]))


def _true_anomalies(t_s: Vector, orbit: Orbit) -> Vector:
    """Of the target at times of any shape."""
    found: Vector = np.reshape([true_anomaly_rad(t, orbit) for t in t_s.ravel().tolist()], t_s.shape)
    return found


def _gradient(t_s: Vector, orbit: Orbit) -> Vector:
    """Three times mu / r^3, 1/s^2, at times (n,)."""
    e = orbit.eccentricity
    near = np.ones(len(t_s))
    if e > 0.0:
        near = (1.0 + e * np.cos(_true_anomalies(t_s, orbit))) / (1.0 - e * e)
    gradient: Vector = 3.0 * orbit.mean_motion_rad_s**2 * near**3
    return gradient


@kernel
def _derivative(
    q: Vector, w: Vector, nadir: Vector, gradient: float, inertia: Matrix, inverse: Matrix, push: Vector, out: Vector
) -> None:
    """Write the rates of change (7,) of a quaternion (4,) and of the rate (3,), target axes.

    nadir (3,) in the inertial frame; gradient: three times mu / r^3; push (3,): random angular acceleration.
    """
    x, y, z, s = q[0], q[1], q[2], q[3]
    out[0] = 0.5 * (s * w[0] + y * w[2] - z * w[1])
    out[1] = 0.5 * (s * w[1] + z * w[0] - x * w[2])
    out[2] = 0.5 * (s * w[2] + x * w[1] - y * w[0])
    out[3] = -0.5 * (x * w[0] + y * w[1] + z * w[2])
    # the nadir in target axes, u: v + 2 s (v x a) + 2 (v x a) x a with a = (x, y, z), by the norm of q squared
    a0, a1, a2 = nadir[1] * z - nadir[2] * y, nadir[2] * x - nadir[0] * z, nadir[0] * y - nadir[1] * x
    norm2 = x * x + y * y + z * z + s * s
    u0 = nadir[0] + 2.0 * (s * a0 + a1 * z - a2 * y) / norm2
    u1 = nadir[1] + 2.0 * (s * a1 + a2 * x - a0 * z) / norm2
    u2 = nadir[2] + 2.0 * (s * a2 + a0 * y - a1 * x) / norm2
    h0 = inertia[0, 0] * w[0] + inertia[0, 1] * w[1] + inertia[0, 2] * w[2]
    h1 = inertia[1, 0] * w[0] + inertia[1, 1] * w[1] + inertia[1, 2] * w[2]
    h2 = inertia[2, 0] * w[0] + inertia[2, 1] * w[1] + inertia[2, 2] * w[2]
    g0 = inertia[0, 0] * u0 + inertia[0, 1] * u1 + inertia[0, 2] * u2
    g1 = inertia[1, 0] * u0 + inertia[1, 1] * u1 + inertia[1, 2] * u2
    g2 = inertia[2, 0] * u0 + inertia[2, 1] * u1 + inertia[2, 2] * u2
    t0 = gradient * (u1 * g2 - u2 * g1) - (w[1] * h2 - w[2] * h1)
    t1 = gradient * (u2 * g0 - u0 * g2) - (w[2] * h0 - w[0] * h2)
    t2 = gradient * (u0 * g1 - u1 * g0) - (w[0] * h1 - w[1] * h0)
    for i in range(3):
        out[4 + i] = inverse[i, 0] * t0 + inverse[i, 1] * t1 + inverse[i, 2] * t2 + push[i]


@kernel
def _turn(
    dt: Vector,
    nadirs: Stack,
    gradients: Matrix,
    pushes: Matrix,
    inertia: Matrix,
    inverse: Matrix,
    states: Matrix,
    work: Matrix,
) -> None:
    """Fill states (n, 7), of which the first is given, by Runge-Kutta of fourth order.

    nadirs (n - 1, 3, 3) and gradients (n - 1, 3): at the beginning, middle and end of each interval dt (n - 1,);
    work (5, 7) is scratch.
    """
    at, slopes, weights, shares = work[0], work[1:], (1.0, 2.0, 2.0, 1.0), (0.0, 0.5, 0.5, 1.0)
    for k in range(dt.shape[0]):
        x, after = states[k], states[k + 1]
        for stage in range(4):
            for i in range(7):
                at[i] = x[i] + (shares[stage] * dt[k] * slopes[stage - 1, i] if stage > 0 else 0.0)
            j = (stage + 1) // 2
            _derivative(at[:4], at[4:], nadirs[k, j], gradients[k, j], inertia, inverse, pushes[k], slopes[stage])
        for i in range(7):
            after[i] = x[i]
            for stage in range(4):
                after[i] += dt[k] / 6.0 * weights[stage] * slopes[stage, i]
        norm = math.sqrt(after[0] ** 2 + after[1] ** 2 + after[2] ** 2 + after[3] ** 2)
        for i in range(4):
            after[i] /= norm


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
    q, w, t, dt = np.array(q_lvlh_from_target), np.array(rate_rad_s), np.asarray(t_s, dtype=np.float64), np.diff(t_s)
    inertia: Matrix = np.array(inertia_kg_m2, dtype=np.float64)
    inverse = np.asarray(np.linalg.inv(inertia), dtype=np.float64)
    stages = np.stack([t[:-1], t[:-1] + 0.5 * dt, t[:-1] + dt], axis=1)
    nadirs = lvlh_from_inertial(stages.ravel(), orbit).inv().apply([0.0, 0.0, 1.0]).reshape(-1, 3, 3)
    gradients = _gradient(stages.ravel(), orbit).reshape(-1, 3)
    pushes = rng.normal(size=(len(dt), *w.shape)) * np.sqrt(rate_noise_density_rad2_s3 / dt)[:, None, None]
    to_lvlh = lvlh_from_inertial(t, orbit)
    dcm, rate = np.empty((len(t), len(q), 3, 3)), np.empty((len(t), len(q), 3))
    for run in range(len(q)):
        states = np.empty((len(t), 7))
        states[0, :4], states[0, 4:] = q[run], w[run]
        _turn(dt, nadirs, gradients, np.ascontiguousarray(pushes[:, run]), inertia, inverse, states, np.empty((5, 7)))
        dcm[:, run] = (to_lvlh * Rotation.from_quat(states[:, :4])).as_matrix()
        rate[:, run] = states[:, 4:]
    return dcm, rate
