"""Yamanaka-Ankersen transition: relative motion about an eccentric target in closed form, in `lvlh_ccsds` axes.

Yamanaka and Ankersen, J. Guidance 25(1), 2002: with rho = 1 + e cos(theta) and ' = d/d theta the states
(x~, y~, z~) = rho (x, y, z) obey

    x~'' = 2 z~',   y~'' = -y~,   z~'' = 3 z~ / rho - 2 x~'

and their transition from theta0 to theta1 is M(theta1) M(theta0)^-1. Printed so, it loses all but its leading digits
over a short step, and 1 / (1 - e^2) times too many at any. Multiplied out, with D = theta1 - theta0, it is a
polynomial in

    S = sin D,   V = 1 - cos D,   W = J - S / (rho0 rho1) = (1 - e^2)^(-3/2) (DE - sin DE)

where J = k^2 (t - t0), eq. (79), k^2 = h / p^2, and DE is the change of eccentric anomaly: S is of first order in the
step, V of second and W of third, each to full relative precision, whatever dt is. A test holds the product to M M^-1 as
printed, in 50 digits. Clohessy-Wiltshire is the limit e = 0.
"""

import math

import numpy as np

from relnav.arrays import Matrix
from relnav.codegen.kernel import kernel
from relnav.dynamics.clohessy_wiltshire import theta_minus_sin

PHI_PATTERN = ("*0**0*", "0*00*0", "*0**0*", "*0**0*", "0*00*0", "*0**0*")
"""Where Phi is always 0: y goes its own way (a test holds `transition` to it)."""
FULL_TURN = 2.0 * math.pi
ITERATIONS = 60
"""At most, of Kepler's equation; below e = 0.9 four or five are made."""


@kernel
def eccentric_anomaly_step(e: float, sin_e0: float, cos_e0: float, dm: float) -> float:
    """Change of the eccentric anomaly, rad, over a change dm of the mean anomaly within half a turn.

    Kepler's equation of the difference, (1 - e cos E0) sin x + (x - sin x) + e sin E0 (1 - cos x) = dm, by Newton's
    method kept between bounds: no digit of a short step is lost.
    """
    near = 1.0 - e * cos_e0
    low, high = dm - 2.0 * e, dm + 2.0 * e  # E - M is at most e
    x = min(max(dm / near, low), high)
    for _ in range(ITERATIONS):
        half = math.sin(0.5 * x)
        s, v = 2.0 * half * math.cos(0.5 * x), 2.0 * half * half
        excess = near * s + theta_minus_sin(x) + e * sin_e0 * v - dm
        if excess > 0.0:
            high = x
        else:
            low = x
        step = excess / (near + e * (cos_e0 * v + sin_e0 * s))
        other = x - step
        if not low <= other <= high:
            other = 0.5 * (low + high)
            step = x - other
        x = other
        if abs(step) <= 1e-9 * abs(x):
            break
    return x


@kernel
def anomaly_step(e: float, sin0: float, cos0: float, dm: float) -> tuple[float, float, float, float, float]:
    """(S, V, W, sin theta1, cos theta1) of the step that changes the mean anomaly by dm rad, from theta0; any dm."""
    q = 1.0 - e * e
    root = math.sqrt(q)
    rho0 = 1.0 + e * cos0
    sin_e0, cos_e0 = root * sin0 / rho0, (e + cos0) / rho0
    turns = FULL_TURN * math.floor(dm / FULL_TURN + 0.5)
    x = eccentric_anomaly_step(e, sin_e0, cos_e0, dm - turns)
    sin_half, cos_half = math.sin(0.5 * x), math.cos(0.5 * x)
    s, v = 2.0 * sin_half * cos_half, 2.0 * sin_half * sin_half
    near0 = q / rho0  # r / a
    near1 = near0 + e * (cos_e0 * v + sin_e0 * s)
    middle = cos_e0 * cos_half - sin_e0 * sin_half  # cosine of the mean of both eccentric anomalies
    S = 2.0 * root * sin_half * (cos_half - e * middle) / (near0 * near1)
    V = q * v / (near0 * near1)
    W = (theta_minus_sin(x) + turns) / (q * root)
    return S, V, W, sin0 - sin0 * V + cos0 * S, cos0 - cos0 * V - sin0 * S


@kernel
def in_plane_change(
    e: float, sin0: float, cos0: float, S: float, V: float, W: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """What the transition of (x~, z~, x~', z~') adds to the identity: rows x~, z~, z~' of the columns z~, x~', z~'.

    The column of x~ is zero, and x~' - 2 z~ is constant, so the row of x~' is twice that of z~.
    """
    q = 1.0 - e * e
    rho0 = 1.0 + e * cos0
    d_sin, d_cos = cos0 * S - sin0 * V, sin0 * S + cos0 * V  # sin theta1 - sin theta0, cos theta0 - cos theta1
    sin1, cos1, rho1 = sin0 + d_sin, cos0 - d_cos, rho0 - e * d_cos
    over = e / q
    a, b = over * V * (d_sin + e * S), over * V * (d_cos + e * V)
    da = over * (S * (d_sin + e * S) + V * (cos1 + e * (1.0 - V)))  # their derivatives with respect to theta1
    db = over * (S * (d_cos + e * V) + V * (sin1 + e * S))
    x_z, x_dx, x_dz = -3.0 * a / rho0, S + a, 2.0 * V - b + 2.0 * e * over * V * V
    z_z, z_dx, z_dz = 3.0 * (V + b) / rho0, -2.0 * V - b, S - a + 2.0 * e * over * S * V
    dz_z, dz_dx = 3.0 * (S + db) / rho0, -2.0 * S - db
    dz_dz = -V - da + 2.0 * e * over * ((1.0 - V) * V + S * S)
    # J is in the last column of M alone: what W adds is that column times the last row of the inverse.
    cos_twice = cos1 * cos1 - sin1 * sin1
    x, z = 3.0 * rho1 * rho1 * W / q, -3.0 * over * rho1 * sin1 * W
    dz = -3.0 * over * ((cos1 + e * cos_twice) * W + sin1 * V / (rho0 * rho1))  # W' = V / (rho0 rho1^2)
    by_z, by_dx, by_dz = 3.0 * rho0 - q, -rho0 * rho0, e * rho0 * sin0
    return (
        x_z + x * by_z, x_dx + x * by_dx, x_dz + x * by_dz,
        z_z + z * by_z, z_dx + z * by_dx, z_dz + z * by_dz,
        dz_z + dz * by_z, dz_dx + dz * by_dx, dz_dz + dz * by_dz,
    )  # fmt: skip


@kernel
def from_anomalies_into(
    n: float, e: float, sin0: float, cos0: float, S: float, V: float, W: float, phi: Matrix
) -> None:
    """Write Phi (6, 6) over the step from theta0 that `anomaly_step` describes, for mean motion n rad/s, into phi.

    With a, b what the transformed state and its derivative gain, r1 = (rho0 r0 + a) / rho1 and
    v1 = k^2 e (rho0 sin theta1 - rho1 sin theta0) r0 + (rho1 / rho0) v0 + k^2 (e sin theta1 a + rho1 b).
    """
    x_z, x_dx, x_dz, z_z, z_dx, z_dz, dz_z, dz_dx, dz_dz = in_plane_change(e, sin0, cos0, S, V, W)
    q = 1.0 - e * e
    k2 = n / (q * math.sqrt(q))
    rho0, d_sin = 1.0 + e * cos0, cos0 * S - sin0 * V
    rho1 = rho0 - e * (sin0 * S + cos0 * V)
    slope, speed = -e * sin0, 1.0 / (k2 * rho0)  # of the transformed derivative by position and by velocity
    for i in range(6):
        for j in range(6):
            phi[i, j] = 0.0
    # what each column gains: rows 0-2 a, rows 3-5 b
    phi[0, 0], phi[2, 0], phi[5, 0] = slope * x_dx, slope * z_dx, slope * dz_dx
    phi[0, 2], phi[2, 2] = rho0 * x_z + slope * x_dz, rho0 * z_z + slope * z_dz
    phi[5, 2] = rho0 * dz_z + slope * dz_dz
    phi[0, 3], phi[2, 3], phi[5, 3] = speed * x_dx, speed * z_dx, speed * dz_dx
    phi[0, 5], phi[2, 5], phi[5, 5] = speed * x_dz, speed * z_dz, speed * dz_dz
    phi[1, 1], phi[4, 1] = slope * S - rho0 * V, -rho0 * S - slope * V
    phi[1, 4], phi[4, 4] = speed * S, -speed * V
    for j in range(6):
        phi[3, j] = 2.0 * phi[2, j]
    for j in range(6):
        for i in range(3):
            gain = phi[i, j]
            phi[i, j] = gain / rho1
            phi[3 + i, j] = k2 * (e * (sin0 + d_sin) * gain + rho1 * phi[3 + i, j])
    for i in range(3):
        phi[i, i] += rho0 / rho1
        phi[3 + i, i] += k2 * e * (d_sin + e * S)
        phi[3 + i, 3 + i] += rho1 / rho0


@kernel
def transition_into(n: float, e: float, theta0: float, dt: float, phi: Matrix) -> None:
    """Write Phi (6, 6) from true anomaly theta0 rad over dt s, of either sign, into phi; mean motion n rad/s, e < 1."""
    sin0, cos0 = math.sin(theta0), math.cos(theta0)
    S, V, W, _, _ = anomaly_step(e, sin0, cos0, n * dt)
    from_anomalies_into(n, e, sin0, cos0, S, V, W, phi)


def mean_from_true_anomaly(e: float, theta: float) -> float:
    """Mean anomaly, rad, on the same revolution as theta."""
    turns = math.floor((theta + math.pi) / (2.0 * math.pi)) * 2.0 * math.pi
    eccentric = 2.0 * math.atan2(math.sqrt(1.0 - e) * math.sin(0.5 * theta), math.sqrt(1.0 + e) * math.cos(0.5 * theta))
    wrapped = math.remainder(eccentric, 2.0 * math.pi)
    return turns + wrapped - e * math.sin(wrapped)


def true_from_mean_anomaly(e: float, mean: float) -> float:
    """True anomaly, rad, on the same revolution as mean."""
    turns = math.floor((mean + math.pi) / (2.0 * math.pi)) * 2.0 * math.pi
    _, _, _, sine, cosine = anomaly_step(e, 0.0, 1.0, mean - turns)
    return turns + math.atan2(sine, cosine)


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
        Time step, any length and sign.

    Raises
    ------
    ValueError
        For a mean motion or an eccentricity outside these limits, or an anomaly or a step that is not finite.
    """
    n, e = mean_motion_rad_s, eccentricity
    if not (math.isfinite(n) and n > 0.0) or not 0.0 <= e < 1.0:
        raise ValueError(f"mean_motion_rad_s > 0 and 0 <= eccentricity < 1 are expected; got {n!r}, {e!r}")
    if not (math.isfinite(true_anomaly_rad) and math.isfinite(dt_s)):
        raise ValueError(f"true_anomaly_rad and dt_s must be finite; got {true_anomaly_rad!r}, {dt_s!r}")
    phi = np.empty((6, 6))
    transition_into(n, e, true_anomaly_rad, dt_s, phi)
    return phi
