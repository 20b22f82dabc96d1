"""Where a star is seen: catalogue place moved along its space motion, parallax, and aberration, as unit vectors.

All frames ICRS, all functions of plain arrays. Against the IAU SOFA routines they agree to better than 1 mas (tests).
"""

import numpy as np

from relnav.arrays import Matrix, Vector

LIGHT_KM_S = 299792.458
MAS_RAD = np.pi / 648e6
"""One milliarcsecond, rad."""


def space_motion(
    ra_rad: Vector, dec_rad: Vector, pm_ra_cos_dec_mas_yr: Vector, pm_dec_mas_yr: Vector, years: float
) -> Matrix:
    """Unit vectors (n, 3) of stars after `years` Julian years of straight motion, radial velocity zero.

    Linear motion in space: u(t) = (u0 + mu t) / |u0 + mu t|, mu the proper motion as a vector tangent to the sphere
    (Hipparcos catalogue, vol. 1, section 1.5.5, without the radial term).
    """
    sa, ca, sd, cd = np.sin(ra_rad), np.cos(ra_rad), np.sin(dec_rad), np.cos(dec_rad)
    zero = np.zeros_like(sa)
    p = np.stack([-sa, ca, zero], axis=1)  # toward increasing right ascension
    q = np.stack([-sd * ca, -sd * sa, cd], axis=1)  # toward increasing declination
    mu = (p * np.asarray(pm_ra_cos_dec_mas_yr)[:, None] + q * np.asarray(pm_dec_mas_yr)[:, None]) * MAS_RAD
    u = np.stack([cd * ca, cd * sa, sd], axis=1) + mu * years
    moved: Matrix = u / np.linalg.norm(u, axis=1, keepdims=True)
    return moved


def parallax(directions: Matrix, parallax_mas: Vector, observer_au: Vector) -> Matrix:
    """Directions (n, 3) as seen from the observer's barycentric position (3,) au: u - pi r, normalised."""
    u = directions - np.asarray(parallax_mas, dtype=np.float64)[:, None] * MAS_RAD * np.asarray(observer_au)
    seen: Matrix = u / np.linalg.norm(u, axis=1, keepdims=True)
    return seen


def aberration(directions: Matrix, beta: Vector) -> Matrix:
    """Directions (n, 3) as a moving observer sees them, exact in special relativity.

    u' = (u/g + b (1 + u.b / (1 + 1/g))) / (1 + u.b), g = 1/sqrt(1 - b^2), b (3,) = barycentric velocity / c
    (Explanatory Supplement, 3rd ed., eq. 7.40). The inverse is the same with -b.
    """
    u, b = np.asarray(directions, dtype=np.float64), np.asarray(beta, dtype=np.float64)
    inverse_g = np.sqrt(1.0 - b @ b)
    ub = u @ b
    moved = u * inverse_g + b * (1.0 + ub / (1.0 + inverse_g))[:, None]
    seen: Matrix = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    return seen


def radec(direction: Vector) -> tuple[float, float]:
    """Right ascension [0, 2 pi) and declination of a direction (3,), rad."""
    x, y, z = (float(value) for value in direction)
    return float(np.arctan2(y, x)) % (2.0 * np.pi), float(np.arctan2(z, np.hypot(x, y)))
