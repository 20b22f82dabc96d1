"""Roll from a polarised beacon: right, ambiguous as said, and at the counting bound."""

import numpy as np
import pytest

from relnav.sensors.birefringent_sun.crystal import polarisation_basis
from relnav.sensors.birefringent_sun.polarised import polarised_roll, shares, unpolarised_shares

ARCSEC = np.pi / 648000.0


def test_one_candidate_is_right(sensor, cone):
    for s, psi in zip(cone(55.0, 60), np.linspace(0.05, 3.1, 60), strict=True):
        light = 1e8 * shares(sensor, s, psi)
        if light.min() < 1e3:
            continue
        found, _ = polarised_roll(sensor, s, *light).nearest(psi + 0.01)
        assert found == pytest.approx(psi, abs=1e-7)
        candidates = polarised_roll(sensor, s, *light).psi_rad
        for other in candidates:
            again = shares(sensor, s, other)
            assert again[0] / again[1] == pytest.approx(light[0] / light[1], rel=1e-9)


@pytest.mark.parametrize("angle_deg", [0.5, 20.0, 45.0])
def test_photons_set_the_accuracy(sensor, angle_deg):
    """1e8 photons: 12 arcsec or better; 1000 draws at 1e6 reach the stated sigma within 8 %."""
    a = np.radians(angle_deg)
    s, psi = np.array([np.sin(a) * 0.8, np.sin(a) * 0.6, np.cos(a)]), 0.8
    part = shares(sensor, s, psi)
    assert polarised_roll(sensor, s, *(1e8 * part)).nearest(psi)[1] / ARCSEC <= 12.0
    rng = np.random.default_rng(0)
    errors = [polarised_roll(sensor, s, *rng.poisson(1e6 * part)).nearest(psi)[0] - psi for _ in range(1000)]
    sigma = polarised_roll(sensor, s, *(1e6 * part)).nearest(psi)[1]
    assert np.std(errors) == pytest.approx(sigma, rel=0.08)
    assert 100.0 < sigma / ARCSEC < 112.0


def test_ideal_on_axis():
    """A crystal that hardly refracts, axis across: sin^2 and cos^2, sigma = 1 / (2 sqrt N)."""
    from dataclasses import replace

    import relnav

    sensor = relnav.load_model("birefringent_sun").sensor
    thin = replace(sensor, ordinary_index=1.0001, extraordinary_index=1.00005, axis_polar_rad=1.57)
    s = np.array([0.0, 0.0, 1.0])
    assert shares(thin, s, 0.3) == pytest.approx([np.sin(0.3) ** 2, np.cos(0.3) ** 2], abs=1e-4)
    assert polarised_roll(thin, s, *(1e6 * shares(thin, s, 0.3))).nearest(0.3)[1] == pytest.approx(5e-4, rel=1e-3)


def test_sunlight_says_nothing_of_the_roll(sensor, cone):
    """Its shares are the mean over all polarisations."""
    for s in cone(55.0, 20):
        mean = np.mean([shares(sensor, s, psi) for psi in np.linspace(0.0, np.pi, 8, endpoint=False)], axis=0)
        np.testing.assert_allclose(unpolarised_shares(sensor, s), mean, atol=1e-12)


def test_the_basis(cone):
    for s in cone(80.0, 20):
        triad = np.column_stack([polarisation_basis(s), s])
        np.testing.assert_allclose(triad.T @ triad, np.eye(3), atol=1e-14)
        assert np.linalg.det(triad) > 0.0


def test_wrong_use(sensor):
    with pytest.raises(ValueError, match="both spots must have light; got 0 and 5 photons"):
        polarised_roll(sensor, np.array([0.0, 0.0, 1.0]), 0, 5)


@pytest.mark.parametrize("s", [[0.0, 0.0, 2.0], [1.0, 0.0], [[0.0, 0.0, 1.0]]])
def test_no_line_of_sight(sensor, s):
    with pytest.raises(ValueError, match=r"s: a unit vector \(3,\) in sensor axes is expected; got \["):
        polarised_roll(sensor, s, 1e6, 1e6)
