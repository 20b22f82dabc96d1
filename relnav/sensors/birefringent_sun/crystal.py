"""Refraction into a uniaxial crystal: ordinary and extraordinary waves, rays and amplitudes.

Equations (1)-(10) of "Birefringent sun sensor and its measurement of three-axis attitude" (Chinese patent).
Wave vectors k are in units of 2 pi / wavelength in vacuum, z into the crystal. c is the unit optic axis and

    eps = n_o^2 I + (n_e^2 - n_o^2) c c^T

Phase matching keeps the transverse part k_t = (s_x, s_y) of the incoming wave. (The patent prints "n1 . r = n2 . r";
k1 . r = k2 . r for every r of the face is meant.) References: Yeh, Optical Waves in Layered Media, ch. 9;
Avendano-Alejo, Opt. Express 13, 2549 (2005); Lekner, J. Phys.: Condens. Matter 3, 6121 (1991). Arrays are (..., n).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.codegen.kernel import kernel

SHORTEST_UM, LONGEST_UM = 0.204, 2.172


def calcite(wavelength_um: float) -> tuple[float, float]:
    """Indices (n_o, n_e) of calcite at room temperature: Ghosh, Opt. Commun. 163, 95 (1999).

    Raises
    ------
    ValueError
        Outside 0.204 to 2.172 um, where the formula was fitted.
    """
    if not SHORTEST_UM <= wavelength_um <= LONGEST_UM:
        raise ValueError(f"calcite's indices are known from {SHORTEST_UM} to {LONGEST_UM} um; got {wavelength_um}")
    l2 = wavelength_um**2
    o2 = 1.73358749 + 0.96464345 * l2 / (l2 - 0.0194325203) + 1.82831454 * l2 / (l2 - 120.0)
    e2 = 1.35859695 + 0.82427830 * l2 / (l2 - 0.0106689543) + 0.14429128 * l2 / (l2 - 120.0)
    return float(np.sqrt(o2)), float(np.sqrt(e2))


def optic_axis(polar_rad: float, azimuth_rad: float) -> Vector:
    """Unit optic axis (3,) at angle theta_p from z, its projection at phi_p from x."""
    sine = np.sin(polar_rad)
    return np.array([sine * np.cos(azimuth_rad), sine * np.sin(azimuth_rad), np.cos(polar_rad)])


def ordinary_wave(k_t: ArrayLike, n_o: float) -> Matrix:
    """Ordinary wave vector (..., 3) of transverse parts (..., 2); its ray goes along it. Eq. (1)."""
    k_t = numbers("k_t", k_t)
    q = np.sqrt(n_o**2 - np.sum(k_t**2, axis=-1, keepdims=True))
    return np.concatenate([k_t, q], axis=-1)


@kernel
def extraordinary_root(k_x: float, k_y: float, c_x: float, c_y: float, c_z: float, n_o: float, n_e: float) -> float:
    """k_z > 0 of the extraordinary wave: k^T eps k = n_o^2 n_e^2; what (2) and (3) say implicitly.

    With k = (k_t, q): a q^2 + 2 b q + g = 0, D = n_e^2 - n_o^2,
    a = n_o^2 + D c_z^2, b = D (k_t . c_t) c_z, g = n_o^2 |k_t|^2 + D (k_t . c_t)^2 - n_o^2 n_e^2.
    """
    D = n_e * n_e - n_o * n_o
    along = k_x * c_x + k_y * c_y
    a = n_o * n_o + D * c_z * c_z
    b = D * along * c_z
    g = n_o * n_o * (k_x * k_x + k_y * k_y) + D * along * along - n_o * n_o * n_e * n_e
    return (-b + math.sqrt(b * b - a * g)) / a


def extraordinary_wave(k_t: ArrayLike, axis: Vector, n_o: float, n_e: float) -> Matrix:
    """Extraordinary wave vector (..., 3) of transverse parts (..., 2)."""
    k_t = numbers("k_t", k_t)
    c_x, c_y, c_z = axis.tolist()
    roots = [extraordinary_root(k_x, k_y, c_x, c_y, c_z, n_o, n_e) for k_x, k_y in k_t.reshape(-1, 2).tolist()]
    return np.concatenate([k_t, np.array(roots).reshape(*k_t.shape[:-1], 1)], axis=-1)


def extraordinary_ray(k: Matrix, axis: Vector, n_o: float, n_e: float) -> Matrix:
    """Direction (..., 3), not normalised, of the energy of extraordinary waves: S ~ eps k.

    It is the patent's (7)-(10), and regular where those are 0/0, at k along the axis.
    """
    ray: Matrix = n_o**2 * k + (n_e**2 - n_o**2) * (k @ axis)[..., None] * axis
    return ray


def walk_off(theta_kp_rad: ArrayLike, n_o: float, n_e: float) -> Vector:
    """Angle (rad) from extraordinary wave to ray, away from calcite's axis: tan(th_rp) = (n_o/n_e)^2 tan(th_kp)."""
    theta = numbers("theta_kp_rad", theta_kp_rad)
    angle: Vector = np.arctan2(n_o**2 * np.sin(theta), n_e**2 * np.cos(theta)) - theta
    return angle


def largest_walk_off(n_o: float, n_e: float) -> float:
    """Largest walk-off (rad), asin(|n_o^2 - n_e^2| / (n_o^2 + n_e^2)), at theta_kp = atan(n_e / n_o)."""
    return float(np.arcsin(abs(n_o**2 - n_e**2) / (n_o**2 + n_e**2)))


def mode_amplitudes(s: Vector, axis: Vector, n_o: float, n_e: float) -> tuple[Matrix, float]:
    """How much of either linear polarisation enters as ordinary and extraordinary light, for one direction s (3,).

    Returns
    -------
    amplitudes : (2, 2)
        Rows o, e; columns the incoming unit fields along `polarisation_basis(s)`. A mode's share of the incoming power
        for a field at angle psi in that basis is (amplitudes @ (cos psi, sin psi))^2. Signs are of the modes' choice.
    balance : float
        Largest departure of transmitted plus reflected power from 1: rounding.

    Notes
    -----
    Continuity of the transverse E and H = k x E at the face; modes E_o = k_o x c, E_e = n_o^2 c - (k_e . c) k_e.
    Where k_o lies along c the two modes are the same and the split means nothing.
    """
    incoming, reflected = np.array(s), np.array([s[0], s[1], -s[2]])
    k_o = ordinary_wave(s[:2], n_o)
    k_e = extraordinary_wave(s[:2], axis, n_o, n_e)
    fields = [np.cross(k_o, axis), n_o**2 * axis - (k_e @ axis) * k_e]
    inside = [np.concatenate([E[:2], np.cross(k, E)[:2]]) for k, E in zip((k_o, k_e), fields, strict=True)]
    flux = [np.cross(E, np.cross(k, E))[2] / s[2] for k, E in zip((k_o, k_e), fields, strict=True)]
    basis = polarisation_basis(s)
    back = polarisation_basis(reflected)
    away = [np.concatenate([E[:2], np.cross(reflected, E)[:2]]) for E in back.T]
    system = np.column_stack([*inside, -away[0], -away[1]])
    came = np.column_stack([np.concatenate([E[:2], np.cross(incoming, E)[:2]]) for E in basis.T])
    solved = np.linalg.solve(system, came)
    amplitudes = solved[:2] * np.sqrt(np.array(flux))[:, None]
    power = np.sum(amplitudes**2, axis=0) + np.sum(solved[2:] ** 2, axis=0)
    return amplitudes, float(np.abs(power - 1.0).max())


def polarisation_basis(s: Vector) -> Matrix:
    """Two unit fields, columns of (3, 2), across light of direction s: the x axis made normal to s, and s x that."""
    first = np.array([1.0, 0.0, 0.0]) - s[0] * s
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(s, first)], axis=1)
