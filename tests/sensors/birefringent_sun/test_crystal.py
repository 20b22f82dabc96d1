"""Crystal optics against Maxwell's equations, Fermat's principle, energy and handbook walk-off."""

import numpy as np
import pytest
from scipy.optimize import minimize

from relnav.sensors.birefringent_sun.crystal import (
    calcite,
    extraordinary_ray,
    extraordinary_wave,
    largest_walk_off,
    mode_amplitudes,
    optic_axis,
    ordinary_wave,
    walk_off,
)


def maxwell_quartic(k_t, eps):
    """Roots q of det([k x]^2 + eps) = 0, k = (k_t, q): the waves that Maxwell's equations allow, by interpolation."""

    def determinant(q):
        x, y, z = k_t[0], k_t[1], q
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return np.linalg.det(cross @ cross + eps)

    places = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    return np.roots(np.polyfit(places, [determinant(q) for q in places], 4))


def test_waves_solve_maxwells_equations(crystals, cone, outside):
    """Both wave vectors are roots of the quartic, to 1e-10, for 500 axes and incidences up to 89 deg."""
    worst = 0.0
    for sensor, s in zip(crystals(500), cone(89.0, 500), strict=True):
        n_o, n_e, c = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
        roots = maxwell_quartic(s[:2], n_o**2 * np.eye(3) + (n_e**2 - n_o**2) * np.outer(c, c))
        for k in (ordinary_wave(s[:2], n_o), extraordinary_wave(s[:2], c, n_o, n_e)):
            # a double root (wave along the axis) is known to the root of rounding only
            spread = np.sort(np.abs(roots - k[2]))
            worst = max(worst, spread[0] * min(1.0, spread[1] / 1e-3))
    outside("Maxwell's equations, quartic of the wave normal", "wave vectors of 500 crystals", worst, 1e-10)


def test_rays_carry_the_energy(crystals, cone):
    """Poynting vector of the field that solves the wave equation, from its null space."""
    for sensor, s in zip(crystals(200, 1), cone(85.0, 200, 1), strict=True):
        n_o, n_e, c = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
        eps = n_o**2 * np.eye(3) + (n_e**2 - n_o**2) * np.outer(c, c)
        k = extraordinary_wave(s[:2], c, n_o, n_e)
        if np.linalg.norm(np.cross(k, c)) < 1e-3:
            continue
        cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        field = np.linalg.svd(cross @ cross + eps)[2][-1]
        energy = np.cross(field, np.cross(k, field))
        ray = extraordinary_ray(k, c, n_o, n_e)
        np.testing.assert_allclose(np.cross(ray, energy) / np.linalg.norm(ray) / np.linalg.norm(energy), 0.0, atol=1e-9)
        assert ray @ energy > 0.0


def test_fermat(sensor, cone):
    """The e ray's foot makes optical path plus incoming phase stationary: found by a minimiser, to 1e-6 d."""
    n_o, n_e, c = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
    M = n_e**2 * np.eye(3) + (n_o**2 - n_e**2) * np.outer(c, c)
    for s in cone(75.0, 30):

        def path(x, s=s):
            X = np.array([x[0], x[1], 1.0])
            return np.sqrt(X @ M @ X) - s[:2] @ x

        ray = extraordinary_ray(extraordinary_wave(s[:2], c, n_o, n_e), c, n_o, n_e)
        foot = minimize(path, [0.0, 0.0], method="BFGS", options={"gtol": 1e-11}, jac="3-point").x
        np.testing.assert_allclose(ray[:2] / ray[2], foot, atol=1e-6)


def test_energy_is_conserved(crystals, cone):
    """Shares o + e + reflected = 1 for either polarisation, to 1e-12, up to 88 deg."""
    for sensor, s in zip(crystals(300, 2), cone(88.0, 300, 2), strict=True):
        amplitudes, balance = mode_amplitudes(s, sensor.axis, sensor.ordinary_index, sensor.extraordinary_index)
        assert balance < 1e-12
        assert np.all(np.sum(amplitudes**2, axis=0) <= 1.0 + 1e-12)


def test_normal_incidence_is_fresnels_textbook_case():
    """Axis in the face: fields along and across it see n_e and n_o; T = 4 n / (1 + n)^2."""
    n_o, n_e = 1.6584, 1.4864
    amplitudes, _ = mode_amplitudes(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), n_o, n_e)
    np.testing.assert_allclose(
        amplitudes**2, [[0.0, 4 * n_o / (1 + n_o) ** 2], [4 * n_e / (1 + n_e) ** 2, 0.0]], atol=1e-14
    )


def test_an_isotropic_crystal_has_one_ray_and_snells_law(cone):
    n = 1.5
    for s in cone(80.0, 20):
        k = extraordinary_wave(s[:2], optic_axis(0.7, 0.3), n, n)
        np.testing.assert_allclose(k, ordinary_wave(s[:2], n), atol=1e-14)
        np.testing.assert_allclose(np.cross(extraordinary_ray(k, optic_axis(0.7, 0.3), n, n), k), 0.0, atol=1e-14)


def test_walk_off_of_the_handbook():
    """With 1.6584 and 1.4864: 6.224 deg at 45 deg, 6.261 deg at most, at 41.87 deg."""
    n_o, n_e = 1.6584, 1.4864
    assert np.degrees(walk_off(np.radians(45.0), n_o, n_e)) == pytest.approx(6.2241, abs=1e-4)
    theta = np.linspace(0.0, 0.5 * np.pi, 100_001)
    angles = walk_off(theta, n_o, n_e)
    assert np.degrees(angles.max()) == pytest.approx(6.2612, abs=1e-4)
    assert angles.max() == pytest.approx(largest_walk_off(n_o, n_e), abs=1e-9)
    assert np.degrees(theta[angles.argmax()]) == pytest.approx(41.87, abs=0.01)
    assert np.tan(theta[angles.argmax()]) == pytest.approx(n_e / n_o, abs=1e-4)


def test_walk_off_is_the_angle_between_wave_and_ray(sensor, cone):
    n_o, n_e, c = sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
    k = extraordinary_wave(cone(70.0, 50)[:, :2], c, n_o, n_e)
    ray = extraordinary_ray(k, c, n_o, n_e)
    unit_k, unit_ray = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (k, ray))
    between = np.arcsin(np.linalg.norm(np.cross(unit_k, unit_ray), axis=1))
    np.testing.assert_allclose(between, walk_off(np.arccos(unit_k @ c), n_o, n_e), atol=1e-12)
    assert np.all(unit_ray @ c < unit_k @ c)  # away from the axis: calcite is negative


def test_calcite():
    """Handbook: 1.6584 and 1.4864 at the sodium line, within 3e-4; less at longer waves; dispersion is not off."""
    n_o, n_e = calcite(0.5893)
    assert (n_o, n_e) == pytest.approx((1.6584, 1.4864), abs=3e-4)
    blue, red = calcite(0.4), calcite(0.7)
    assert blue[0] - red[0] == pytest.approx(0.0308, abs=0.002)
    assert blue[1] - red[1] == pytest.approx(0.0138, abs=0.002)
    for wavelength in (0.2, 2.2, 589.3):
        with pytest.raises(ValueError, match=r"known from 0\.204 to 2\.172 um"):
            calcite(wavelength)


def test_the_models_indices_are_calcites(sensor):
    assert (sensor.ordinary_index, sensor.extraordinary_index) == pytest.approx(calcite(0.5893), abs=1e-6)


@pytest.mark.parametrize(
    ("angle", "azimuth", "light"),
    [
        (0.0, 0.0, (0.469, 0.476)),
        (30.0, 0.0, (0.457, 0.484)),
        (30.0, 90.0, (0.478, 0.467)),
        (60.0, 0.0, (0.386, 0.499)),
    ],
)
def test_sunlight_is_shared_almost_evenly(sensor, angle, azimuth, light):
    from relnav.sensors.birefringent_sun.polarised import unpolarised_shares

    a, b = np.radians([angle, azimuth])
    s = np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
    assert unpolarised_shares(sensor, s) == pytest.approx(light, abs=1e-3)
