"""Yamanaka-Ankersen transition: relative motion about an eccentric target, closed form in true anomaly.

Yamanaka and Ankersen, J. Guidance 25(1), 2002. In-plane transformed states are (x~, z~, x~', z~') with
x~ = rho x, rho = 1 + e cos(theta), ' = d/d theta; Clohessy-Wiltshire is its limit e = 0. Axes are `lvlh_ccsds`.
Element (2, 2) of the inverse, printed with a misprint in some copies, is -3 s (1/rho + e^2/rho^2); a test holds
M(theta0) M^-1(theta0) = I.
"""

import math

import numpy as np

from relnav.arrays import Matrix
from relnav.codegen.kernel import kernel

IN_PLANE = (0, 2, 3, 5)
"""Places of x, z and their rates in a state."""


@kernel
def fundamental_into(e: float, theta: float, integral: float, out: Matrix) -> None:
    """Write the in-plane fundamental matrix M (4, 4) at true anomaly theta rad; integral J = k^2 (t - t0), eq. (79)."""
    rho = 1.0 + e * math.cos(theta)
    s, c = rho * math.sin(theta), rho * math.cos(theta)
    ds, dc = math.cos(theta) + e * math.cos(2.0 * theta), -(math.sin(theta) + e * math.sin(2.0 * theta))
    j = integral
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = 1.0, -c * (1.0 + 1.0 / rho), s * (1.0 + 1.0 / rho), 3.0 * rho**2 * j
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = 0.0, s, c, 2.0 - 3.0 * e * s * j
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = 0.0, 2.0 * s, 2.0 * c - e, 3.0 * (1.0 - 2.0 * e * s * j)
    out[3, 0], out[3, 1], out[3, 2], out[3, 3] = 0.0, ds, dc, -3.0 * e * (ds * j + s / rho**2)


@kernel
def fundamental_inverse_into(e: float, theta: float, out: Matrix) -> None:
    """Write the inverse of M at its own start (J = 0), closed form, eq. (82), (4, 4)."""
    rho = 1.0 + e * math.cos(theta)
    s, c = rho * math.sin(theta), rho * math.cos(theta)
    d = 1.0 / (1.0 - e * e)
    out[0, 0], out[0, 1] = 1.0, 3.0 * e * s * (1.0 / rho + 1.0 / rho**2) * d
    out[0, 2], out[0, 3] = -e * s * (1.0 + 1.0 / rho) * d, (-e * c + 2.0) * d
    out[1, 0], out[1, 1] = 0.0, -3.0 * s * (1.0 / rho + e**2 / rho**2) * d
    out[1, 2], out[1, 3] = s * (1.0 + 1.0 / rho) * d, (c - 2.0 * e) * d
    out[2, 0], out[2, 1] = 0.0, -3.0 * (c / rho + e) * d
    out[2, 2], out[2, 3] = (c * (1.0 + 1.0 / rho) + e) * d, -s * d
    out[3, 0], out[3, 1], out[3, 2], out[3, 3] = 0.0, (3.0 * rho + e * e - 1.0) * d, -(rho**2) * d, e * s * d


def fundamental_matrix(e: float, theta: float, integral: float) -> Matrix:
    """In-plane fundamental matrix M (4, 4), as `fundamental_into`."""
    out = np.empty((4, 4))
    fundamental_into(e, theta, integral, out)
    return out


def fundamental_inverse(e: float, theta: float) -> Matrix:
    """Inverse of M at its own start (4, 4), as `fundamental_inverse_into`."""
    out = np.empty((4, 4))
    fundamental_inverse_into(e, theta, out)
    return out


def in_plane_transition(e: float, theta0: float, theta1: float, integral: float) -> Matrix:
    """In-plane transition (4, 4) of the transformed states (x~, z~, x~', z~') from theta0 to theta1."""
    product: Matrix = fundamental_matrix(e, theta1, integral) @ fundamental_inverse(e, theta0)
    return product


@kernel
def mean_from_true_anomaly(e: float, theta: float) -> float:
    """Mean anomaly, rad, on the same revolution as theta."""
    turns = math.floor((theta + math.pi) / (2.0 * math.pi)) * 2.0 * math.pi
    half = 0.5 * (theta - turns)
    eccentric = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(half), math.sqrt(1.0 + e) * math.cos(half))
    return turns + eccentric - e * math.sin(eccentric)


@kernel
def true_from_mean_anomaly(e: float, mean: float) -> float:
    """True anomaly, rad, on the same revolution: Newton on Kepler's equation from Danby's start."""
    turns = math.floor((mean + math.pi) / (2.0 * math.pi)) * 2.0 * math.pi
    m = mean - turns
    eccentric = m + (0.85 * e if m > 0.0 else -0.85 * e)
    for _ in range(50):
        step = (eccentric - e * math.sin(eccentric) - m) / (1.0 - e * math.cos(eccentric))
        eccentric -= step
        if abs(step) < 1e-15:
            break
    half = 0.5 * eccentric
    return turns + 2.0 * math.atan2(math.sqrt(1.0 + e) * math.sin(half), math.sqrt(1.0 - e) * math.cos(half))


@kernel
def transition_into(n: float, e: float, theta0: float, dt: float, phi: Matrix, work: Matrix) -> None:
    """Write Phi (6, 6) in `lvlh_ccsds` (m, m/s) from true anomaly theta0 rad over dt s, of either sign.

    n: mean motion rad/s; work (14, 6): scratch.
    """
    theta1 = true_from_mean_anomaly(e, mean_from_true_anomaly(e, theta0) + n * dt)
    k2 = n / (1.0 - e * e) ** 1.5  # k^2 = h / p^2
    end, start, plane = work[0:4, 0:4], work[4:8, 0:4], work[8:14]
    fundamental_into(e, theta1, k2 * dt, end)
    fundamental_inverse_into(e, theta0, start)
    for i in range(6):
        for j in range(6):
            plane[i, j] = 0.0
            phi[i, j] = 0.0
    for i in range(4):
        for j in range(4):
            total = 0.0
            for k in range(4):
                total += end[i, k] * start[k, j]
            plane[IN_PLANE[i], IN_PLANE[j]] = total
    d = theta1 - theta0
    plane[1, 1], plane[1, 4], plane[4, 1], plane[4, 4] = math.cos(d), math.sin(d), -math.sin(d), math.cos(d)
    rho0, rho1 = 1.0 + e * math.cos(theta0), 1.0 + e * math.cos(theta1)
    de0, es1 = -e * math.sin(theta0), k2 * e * math.sin(theta1)
    for i in range(3):
        for j in range(3):  # x~ = rho x, x~' = rho' x + v / (k^2 rho) on the right; x = x~ / rho, v on the left
            xx = plane[i, j] * rho0 + plane[i, 3 + j] * de0
            xv = plane[i, 3 + j] / (k2 * rho0)
            vx = plane[3 + i, j] * rho0 + plane[3 + i, 3 + j] * de0
            vv = plane[3 + i, 3 + j] / (k2 * rho0)
            phi[i, j], phi[i, 3 + j] = xx / rho1, xv / rho1
            phi[3 + i, j], phi[3 + i, 3 + j] = es1 * xx + k2 * rho1 * vx, es1 * xv + k2 * rho1 * vv


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
    n, e = mean_motion_rad_s, eccentricity
    if not n > 0.0 or not 0.0 <= e < 1.0:
        raise ValueError(f"mean_motion_rad_s > 0 and 0 <= eccentricity < 1 are expected; got {n!r}, {e!r}")
    phi = np.empty((6, 6))
    transition_into(float(n), float(e), float(true_anomaly_rad), float(dt_s), phi, np.empty((14, 6)))
    return phi
