"""Star places against the IAU SOFA routines (pyerfa): within 1 mas, over decades and at orbital speed."""

import warnings

import erfa
import numpy as np
import pytest

from relnav.files.star_catalogue import load_star_catalogue
from relnav.geometry.star_places import LIGHT_KM_S, MAS_RAD, aberration, parallax, radec, space_motion


@pytest.fixture(scope="module")
def stars():
    catalogue = load_star_catalogue()
    part = slice(0, 37622, 7)
    return {name: np.asarray(getattr(catalogue, name)[part], dtype=float) for name in vars(catalogue) if name != "hip"}


def separation_mas(u, v):
    return np.linalg.norm(np.asarray(u) - v, axis=-1) / MAS_RAD


@pytest.mark.parametrize("years", [-20.0, 10.0, 34.75])
def test_space_motion(stars, years, outside):
    """`pmsafe` adds light-time and a parallax floor, which stay far below the bound."""
    mine = space_motion(stars["ra_rad"], stars["dec_rad"], stars["pm_ra_cos_dec_mas_yr"], stars["pm_dec_mas_yr"], years)
    pm_ra = stars["pm_ra_cos_dec_mas_yr"] * MAS_RAD / np.cos(stars["dec_rad"])
    begin = erfa.epj2jd(1991.25)
    end = erfa.epj2jd(1991.25 + years)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # "distance overridden": no parallax is given
        ra, dec, *_ = erfa.pmsafe(
            stars["ra_rad"], stars["dec_rad"], pm_ra, stars["pm_dec_mas_yr"] * MAS_RAD, 0.0, 0.0, *begin, *end
        )
    off = separation_mas(mine, erfa.s2c(ra, dec)).max()
    outside("ERFA (IAU SOFA), pmsafe", f"star places after {years:g} years, largest, mas", off, 1.0)


def test_without_motion_the_stars_would_be_off(stars):
    """The bound above means something: some stars move by arcseconds in these years."""
    still = space_motion(stars["ra_rad"], stars["dec_rad"], 0 * stars["ra_rad"], 0 * stars["ra_rad"], 34.75)
    moved = space_motion(
        stars["ra_rad"], stars["dec_rad"], stars["pm_ra_cos_dec_mas_yr"], stars["pm_dec_mas_yr"], 34.75
    )
    assert separation_mas(still, moved).max() > 10_000.0


@pytest.mark.parametrize("speed_km_s", [7.6, 30.3, 37.8])
def test_aberration(speed_km_s, outside):
    rng = np.random.default_rng(3)
    u = rng.normal(size=(500, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = rng.normal(size=3)
    v *= speed_km_s / np.linalg.norm(v)
    b = v / LIGHT_KM_S
    theirs = erfa.ab(u, b, 1.0e9, np.sqrt(1.0 - b @ b))  # so far from the Sun that its potential does nothing
    off = separation_mas(aberration(u, b), theirs).max()
    outside("ERFA (IAU SOFA), ab", f"aberration at {speed_km_s:g} km/s, largest, mas", off, 0.01)
    first_order = u + b - u * (u @ b)[:, None]
    first_order /= np.linalg.norm(first_order, axis=1, keepdims=True)
    if speed_km_s > 30.0:
        assert separation_mas(first_order, theirs).max() > 0.3


def test_aberration_undoes_itself():
    u = np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    b = np.array([1e-4, -3e-5, 5e-5])
    np.testing.assert_allclose(aberration(aberration(u, b), -b), u, atol=1e-15)


def test_parallax(stars, outside):
    """`pmpx` at the catalogue's epoch does parallax alone."""
    observer = np.array([0.4, -0.8, 0.35])
    u = space_motion(stars["ra_rad"], stars["dec_rad"], 0 * stars["ra_rad"], 0 * stars["ra_rad"], 0.0)
    mine = parallax(u, stars["parallax_mas"], observer)
    theirs = erfa.pmpx(
        stars["ra_rad"], stars["dec_rad"], 0.0, 0.0, np.maximum(stars["parallax_mas"], 0.0) * 1e-3, 0.0, 0.0, observer
    )
    positive = stars["parallax_mas"] >= 0.0
    outside("ERFA (IAU SOFA), pmpx", "parallax, largest, mas", separation_mas(mine, theirs)[positive].max(), 0.01)


def test_radec():
    assert radec(np.array([0.0, -1.0, 0.0])) == pytest.approx((1.5 * np.pi, 0.0))
    assert radec(erfa.s2c(1.2, -0.7)) == pytest.approx((1.2, -0.7))
