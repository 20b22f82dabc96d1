"""Yamanaka-Ankersen transition: relative motion about an eccentric target, closed form in true anomaly.

Yamanaka and Ankersen, J. Guidance 25(1), 2002. In-plane transformed states are (x~, z~, x~', z~') with
x~ = rho x, rho = 1 + e cos(theta), ' = d/d theta; Clohessy-Wiltshire is its limit e = 0. Axes are `lvlh_ccsds`.
Element (2, 2) of the inverse, printed with a misprint in some copies, is -3 s (1/rho + e^2/rho^2); a test holds
M(theta0) M^-1(theta0) = I.
"""

import math

import numpy as np

from relnav.arrays import Matrix


def fundamental_matrix(e: float, theta: float, integral: float) -> Matrix:
    """In-plane fundamental matrix M (4, 4) at true anomaly theta rad; integral J = k^2 (t - t0), eq. (79)."""
    rho = 1.0 + e * math.cos(theta)
    s, c = rho * math.sin(theta), rho * math.cos(theta)
    ds, dc = math.cos(theta) + e * math.cos(2.0 * theta), -(math.sin(theta) + e * math.sin(2.0 * theta))
    j = integral
    return np.array(
        [
            [1.0, -c * (1.0 + 1.0 / rho), s * (1.0 + 1.0 / rho), 3.0 * rho**2 * j],
            [0.0, s, c, 2.0 - 3.0 * e * s * j],
            [0.0, 2.0 * s, 2.0 * c - e, 3.0 * (1.0 - 2.0 * e * s * j)],
            [0.0, ds, dc, -3.0 * e * (ds * j + s / rho**2)],
        ]
    )


def fundamental_inverse(e: float, theta: float) -> Matrix:
    """Inverse of M at its own start (J = 0), closed form, eq. (82)."""
    rho = 1.0 + e * math.cos(theta)
    s, c = rho * math.sin(theta), rho * math.cos(theta)
    rows = np.array(
        [
            [1.0 - e**2, 3.0 * e * s * (1.0 / rho + 1.0 / rho**2), -e * s * (1.0 + 1.0 / rho), -e * c + 2.0],
            [0.0, -3.0 * s * (1.0 / rho + e**2 / rho**2), s * (1.0 + 1.0 / rho), c - 2.0 * e],
            [0.0, -3.0 * (c / rho + e), c * (1.0 + 1.0 / rho) + e, -s],
            [0.0, 3.0 * rho + e**2 - 1.0, -(rho**2), e * s],
        ]
    )
    inverse: Matrix = rows / (1.0 - e**2)
    return inverse


def in_plane_transition(e: float, theta0: float, theta1: float, integral: float) -> Matrix:
    """In-plane transition (4, 4) of the transformed states (x~, z~, x~', z~') from theta0 to theta1."""
    product: Matrix = fundamental_matrix(e, theta1, integral) @ fundamental_inverse(e, theta0)
    return product


def mean_from_true_anomaly(e: float, theta: float) -> float:
    """Mean anomaly, rad, on the same revolution as theta."""
    turns = math.floor((theta + math.pi) / (2.0 * math.pi)) * 2.0 * math.pi
    eccentric = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(0.5 * theta), math.sqrt(1.0 + e) * math.cos(0.5 * theta))
    wrapped = math.remainder(eccentric, 2.0 * math.pi)
    return turns + wrapped - e * math.sin(wrapped)


def true_from_mean_anomaly(e: float, mean: float) -> float:
    """True anomaly, rad, on the same revolution: Newton on Kepler's equation from Danby's start."""
    turns = math.floor((mean + math.pi) / (2.0 * math.pi)) * 2.0 * math.pi
    m = mean - turns
    eccentric = m + 0.85 * e * math.copysign(1.0, m)
    for _ in range(50):
        step = (eccentric - e * math.sin(eccentric) - m) / (1.0 - e * math.cos(eccentric))
        eccentric -= step
        if abs(step) < 1e-15:
            break
    half = 0.5 * eccentric
    return turns + 2.0 * math.atan2(math.sqrt(1.0 + e) * math.sin(half), math.sqrt(1.0 - e) * math.cos(half))


def transition(mean_motion_rad_s: float, eccentricity: float, true_anomaly_rad: float, dt_s: float) -> Matrix:
    """State transition matrix (6, 6) in `lvlh_ccsds` (m, m/s) about an eccentric target.

    Parameters
    ----------
    mean_motion_rad_s : float
        Mean motion sqrt(mu / a^3) of the target, > 0.
    eccentricity : float
        0 <= e < 1.
    true_anomaly_rad : float
        Target's true anomaly at the start.
    dt_s : float
        Time step, either sign.

    Raises
    ------
    ValueError
        For a mean motion or an eccentricity outside these limits.
    """
    n, e, theta0 = mean_motion_rad_s, eccentricity, true_anomaly_rad
    if not n > 0.0 or not 0.0 <= e < 1.0:
        raise ValueError(f"mean_motion_rad_s > 0 and 0 <= eccentricity < 1 are expected; got {n!r}, {e!r}")
    theta1 = true_from_mean_anomaly(e, mean_from_true_anomaly(e, theta0) + n * dt_s)
    k2 = n / (1.0 - e**2) ** 1.5  # k^2 = h / p^2
    phi = np.zeros((6, 6))
    plane = np.ix_([0, 2, 3, 5], [0, 2, 3, 5])
    phi[plane] = in_plane_transition(e, theta0, theta1, k2 * dt_s)
    d = theta1 - theta0
    phi[np.ix_([1, 4], [1, 4])] = [[math.cos(d), math.sin(d)], [-math.sin(d), math.cos(d)]]
    return _from_transformed(e, theta1, k2) @ phi @ _to_transformed(e, theta0, k2)


def _to_transformed(e: float, theta: float, k2: float) -> Matrix:
    rho, de = 1.0 + e * math.cos(theta), -e * math.sin(theta)
    eye = np.eye(3)
    return np.block([[rho * eye, 0.0 * eye], [de * eye, eye / (k2 * rho)]])


def _from_transformed(e: float, theta: float, k2: float) -> Matrix:
    rho, s = 1.0 + e * math.cos(theta), math.sin(theta)
    eye = np.eye(3)
    return np.block([[eye / rho, 0.0 * eye], [k2 * e * s * eye, k2 * rho * eye]])
