"""Refraction into the crystal against Berreman's 4 x 4 matrix, written here from his paper and nothing of the product.

D. W. Berreman, "Optics in stratified and anisotropic media: 4x4-matrix formulation", J. Opt. Soc. Am. 62, 502 (1972).
"""

import numpy as np
import pytest

from relnav.sensors.birefringent_sun.crystal import (
    extraordinary_ray,
    extraordinary_wave,
    mode_amplitudes,
    ordinary_wave,
    polarisation_basis,
)


def berreman_modes(xi, e):
    """Both waves that go in, o and e in no order: k_z (2,), (Ex, Hy, Ey, -Hx) columns (4, 2), rays (2, 3).

    z is the face's normal, x in the plane of incidence, xi the transverse part of k, e (3, 3) the permittivity; k is in
    units of 2 pi / wavelength. d psi / dz = i Delta psi, so that Delta's eigenvalues are the k_z.
    """
    e33 = e[2, 2]
    delta = np.array([
        [-xi * e[2, 0] / e33, 1.0 - xi**2 / e33, -xi * e[2, 1] / e33, 0.0],
        [e[0, 0] - e[0, 2] * e[2, 0] / e33, -xi * e[0, 2] / e33, e[0, 1] - e[0, 2] * e[2, 1] / e33, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [e[1, 0] - e[1, 2] * e[2, 0] / e33, -xi * e[1, 2] / e33, e[1, 1] - e[1, 2] * e[2, 1] / e33 - xi**2, 0.0],
    ])  # fmt: skip
    k_z, psi = (value.real for value in np.linalg.eig(delta))
    inward = psi[0] * psi[1] + psi[2] * psi[3] > 0.0  # z component of E x H
    k_z, psi = k_z[inward], psi[:, inward]
    Ex, Hy, Ey, Hx = *psi[:3], -psi[3]
    E = np.stack([Ex, Ey, -(xi * Hy + e[2, 0] * Ex + e[2, 1] * Ey) / e33], axis=1)
    return k_z, psi, np.cross(E, np.stack([Hx, Hy, xi * Ey], axis=1))


def tangential(k, E):
    """(Ex, Hy, Ey, -Hx) of a plane wave in air."""
    H = np.cross(k, E)
    return np.array([E[0], H[1], E[1], -H[0]])


def test_rays_and_light_of_300_crystals(crystals, cone, outside):
    """Angle between the rays, rad, and difference of the shares of the light, up to 85 deg of incidence."""
    rays = light = 0.0
    compared = 0
    for sensor, s in zip(crystals(300, 4), cone(85.0, 300, 4), strict=True):
        n_o, n_e, c = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
        xi = np.hypot(s[0], s[1])
        turn = np.array([[s[0], s[1], 0.0], [-s[1], s[0], 0.0], [0.0, 0.0, xi]]) / xi  # x into the plane of incidence
        axis = turn @ c
        k_z, psi, energy = berreman_modes(xi, n_o**2 * np.eye(3) + (n_e**2 - n_o**2) * np.outer(axis, axis))
        if abs(k_z[0] - k_z[1]) < 1e-3:  # the two waves are one: which is which means nothing
            continue
        compared += 1
        order = np.argsort(np.abs(k_z - np.sqrt(n_o**2 - xi**2)))
        ours = ordinary_wave(s[:2], n_o), extraordinary_ray(extraordinary_wave(s[:2], c, n_o, n_e), c, n_o, n_e)
        for ray, there in zip(ours, energy[order] @ turn, strict=True):
            sine = np.linalg.norm(np.cross(ray, there)) / np.linalg.norm(ray) / np.linalg.norm(there)
            assert ray @ there > 0.0
            rays = max(rays, sine)
        mirrored = np.array([xi, 0.0, -s[2]])
        back = [tangential(mirrored, E) for E in (np.array([s[2], 0.0, xi]), np.array([0.0, 1.0, 0.0]))]
        came = np.stack([tangential(turn @ s, turn @ E) for E in polarisation_basis(s).T], axis=1)
        amplitude = np.linalg.solve(np.column_stack([psi[:, order], -back[0], -back[1]]), came)[:2]
        flux = (psi[0] * psi[1] + psi[2] * psi[3])[order] / s[2]
        shares = amplitude**2 * flux[:, None]
        light = max(light, np.abs(mode_amplitudes(s, c, n_o, n_e)[0] ** 2 - shares).max())
    assert compared > 290
    reference = "4x4 matrix of Berreman 1972, J. Opt. Soc. Am. 62, 502"
    outside(reference, "both rays in 300 crystals, rad", rays, 1e-10)
    outside(reference, "shares of the light in either ray", light, 1e-10)


def test_the_matrix_knows_snell_and_brewster():
    """Of glass: one wave vector for both fields, and no reflection of the field in the plane at tan = n."""
    n = 1.5
    theta = np.arctan(n)
    k_z, psi, _ = berreman_modes(np.sin(theta), n**2 * np.eye(3))
    assert k_z == pytest.approx(np.sqrt(n**2 - np.sin(theta) ** 2), rel=1e-12)
    k, E = np.array([np.sin(theta), 0.0, np.cos(theta)]), np.array([np.cos(theta), 0.0, -np.sin(theta)])
    back = tangential(k * [1, 1, -1], np.array([np.cos(theta), 0.0, np.sin(theta)]))
    in_plane = psi[:, np.argmax(np.abs(psi[0]))]
    solved = np.linalg.solve(np.column_stack([in_plane[:2], -back[:2]]), tangential(k, E)[:2])
    assert solved[1] == pytest.approx(0.0, abs=1e-12)
