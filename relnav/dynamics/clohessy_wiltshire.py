"""Clohessy-Wiltshire motion in closed form for any time step, in `lvlh_ccsds` axes (x V-bar, y = -h, z nadir).

    x'' = 2 n z' + a_x,   y'' = -n^2 y + a_y,   z'' = 3 n^2 z - 2 n x' + a_z

(Clohessy and Wiltshire 1960; in these axes Fehse, Automated Rendezvous and Docking, ch. 3.) The textbook's
1 - cos(nt) and nt - sin(nt) lose 6e-5 relative at one millisecond; here they are 2 sin^2(nt/2) and a series.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.frames import DCM_LVLH_CCSDS_FROM_RSW

PHI_PATTERN = ("10**0*", "0*00*0", "00**0*", "00**0*", "0*00*0", "00**0*")
"""Where Phi is always 1 or 0: y goes its own way (a test holds `transition` to it)."""


@kernel
def theta_minus_sin(theta: float) -> float:
    """Return theta - sin(theta) to full relative precision: the alternating series below 0.5 rad."""
    if abs(theta) > 0.5:
        return theta - math.sin(theta)
    t2 = theta * theta
    tail = 1.0 - t2 / 110.0 * (1.0 - t2 / 156.0 * (1.0 - t2 / 210.0))
    return theta * t2 / 6.0 * (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0 * tail)))


@kernel
def transition_into(n: float, dt: float, phi: Matrix) -> None:
    """Write Phi(dt) (6, 6) for mean motion n rad/s into phi; dt in s, of either sign."""
    theta = n * dt
    s = math.sin(theta)
    c = math.cos(theta)
    v = 2.0 * math.sin(0.5 * theta) ** 2  # 1 - cos
    d = theta_minus_sin(theta)
    for i in range(6):
        for j in range(6):
            phi[i, j] = 0.0
    phi[0, 0] = 1.0
    phi[0, 2] = 6.0 * d
    phi[0, 3] = dt - 4.0 * d / n  # (4 sin - 3 theta) / n
    phi[0, 5] = 2.0 * v / n
    phi[1, 1] = c
    phi[1, 4] = s / n
    phi[2, 2] = 1.0 + 3.0 * v  # 4 - 3 cos
    phi[2, 3] = -2.0 * v / n
    phi[2, 5] = s / n
    phi[3, 2] = 6.0 * n * v
    phi[3, 3] = 1.0 - 4.0 * v  # 4 cos - 3
    phi[3, 5] = 2.0 * s
    phi[4, 1] = -n * s
    phi[4, 4] = c
    phi[5, 2] = 3.0 * n * s
    phi[5, 3] = -2.0 * s
    phi[5, 5] = c


@kernel
def acceleration_effect_into(n: float, dt: float, a: Vector, out: Vector) -> None:
    """Write the state (6,) that a constant acceleration a (3,) m/s^2 held over dt adds into out (integral of Phi)."""
    theta = n * dt
    s = math.sin(theta)
    v = 2.0 * math.sin(0.5 * theta) ** 2
    d = theta_minus_sin(theta)
    n2 = n * n
    out[0] = (4.0 * v - 1.5 * theta * theta) / n2 * a[0] + 2.0 * d / n2 * a[2]
    out[1] = v / n2 * a[1]
    out[2] = v / n2 * a[2] - 2.0 * d / n2 * a[0]
    out[3] = (dt - 4.0 * d / n) * a[0] + 2.0 * v / n * a[2]
    out[4] = s / n * a[1]
    out[5] = s / n * a[2] - 2.0 * v / n * a[0]


def _check(n: float, dt: float) -> None:
    if not (math.isfinite(n) and n > 0.0):
        raise ValueError(f"mean_motion_rad_s must be positive and finite; got {n!r}")
    if not math.isfinite(dt):
        raise ValueError(f"dt_s must be finite; got {dt!r}")


def transition(mean_motion_rad_s: float, dt_s: float, frame: str = "lvlh_ccsds") -> Matrix:
    """State transition matrix (6, 6) of the Clohessy-Wiltshire equations.

    Parameters
    ----------
    mean_motion_rad_s : float
        Mean motion of the target's circular orbit, > 0.
    dt_s : float
        Time step, any length and sign.
    frame : {"lvlh_ccsds", "rsw"}
        Axes of the state (position m, velocity m/s in the rotating frame).

    Raises
    ------
    ValueError
        For a mean motion that is not positive, a step that is not finite, or another frame.
    """
    _check(mean_motion_rad_s, dt_s)
    phi = np.empty((6, 6))
    transition_into(mean_motion_rad_s, dt_s, phi)
    if frame == "lvlh_ccsds":
        return phi
    if frame == "rsw":
        turn = np.kron(np.eye(2), DCM_LVLH_CCSDS_FROM_RSW)
        rotated: Matrix = turn.T @ phi @ turn
        return rotated
    raise ValueError(f'frame must be "lvlh_ccsds" or "rsw"; got {frame!r}')


def propagate(
    state: Vector,
    mean_motion_rad_s: float,
    dt_s: float,
    acceleration_m_s2: Vector | None = None,
    delta_v_m_s: Vector | None = None,
) -> Vector:
    """Relative state (6,) in `lvlh_ccsds` after dt_s.

    A constant acceleration (3,) m/s^2 acts over the whole step, an impulse (3,) m/s at its end: the result is the
    state just after the impulse.
    """
    _check(mean_motion_rad_s, dt_s)
    out: Vector = transition(mean_motion_rad_s, dt_s) @ np.asarray(state, dtype=np.float64)
    if acceleration_m_s2 is not None:
        effect = np.empty(6)
        acceleration_effect_into(mean_motion_rad_s, dt_s, np.asarray(acceleration_m_s2, dtype=np.float64), effect)
        out = out + effect
    if delta_v_m_s is not None:
        out[3:] += delta_v_m_s
    return out
