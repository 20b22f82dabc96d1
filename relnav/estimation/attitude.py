"""Attitude and rate from measured attitudes: the multiplicative extended Kalman filter's update, and where it settles.

The error state is (theta, dw) with C = C_hat exp([theta x]), theta in body axes (Lefferts, Markley, Shuster 1982;
Markley and Crassidis 2014, ch. 6). A measured attitude Z gives the innovation y = log(C_hat^T Z), with H = [I 0].
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation_vector import rotation_vector_between, turned


def reset(covariance: Matrix, theta: Vector, at: int = 0) -> Matrix:
    """Covariance about the attitude after it took theta (3,) in: G P G^T, G = I - [theta x] / 2 from row `at` on."""
    G = np.eye(len(covariance))
    G[at : at + 3, at : at + 3] -= 0.5 * cross_matrix(theta)
    out: Matrix = G @ covariance @ G.T
    return out


def joseph(covariance: Matrix, gain: Matrix, h: Matrix, noise: Matrix) -> Matrix:
    """Covariance after an update with any gain: (I - K H) P (I - K H)^T + K R K^T, symmetric to the last bit."""
    rest = np.eye(len(covariance)) - gain @ h
    out = rest @ covariance @ rest.T + gain @ noise @ gain.T
    symmetric: Matrix = 0.5 * (out + out.T)
    return symmetric


def attitude_update(
    dcm: Matrix, rate: Vector, covariance: Matrix, measured: Matrix, noise: Matrix
) -> tuple[Matrix, Vector, Matrix]:
    """Attitude (3, 3), rate (3,) and covariance (6, 6) after a measured attitude (3, 3) with noise (3, 3)."""
    h = np.eye(3, 6)
    innovation = rotation_vector_between(measured, dcm)
    gain = np.asarray(np.linalg.solve(covariance[:3, :3] + noise, covariance[:3]).T, dtype=np.float64)
    correction = gain @ innovation
    updated = joseph(covariance, gain, h, noise)
    return turned(dcm, correction[:3]), rate + correction[3:], reset(updated, correction[:3])


def settled_sigmas(sigma_rad: float, dt_s: float, density_rad2_s3: float) -> tuple[float, float]:
    """1-sigma of attitude (rad) and rate (rad/s), each axis, at which such a filter settles.

    Steady state of the double integrator (attitude, rate) with white angular acceleration of density q and
    measurements of continuous density v = sigma^2 dt: P_theta = sqrt(2) v^(3/4) q^(1/4),
    P_w = sqrt(2) v^(1/4) q^(3/4). Holds where the settling time (v / q)^(1/4) is long against dt.
    """
    v, q = sigma_rad**2 * dt_s, density_rad2_s3
    return float(np.sqrt(2.0**0.5 * v**0.75 * q**0.25)), float(np.sqrt(2.0**0.5 * v**0.25 * q**0.75))
