"""The sun's direction against ERFA (the IAU's SOFA): ephemeris epv00 and aberration."""

from datetime import UTC, datetime, timedelta, timezone

import erfa
import numpy as np
import pytest

from relnav.dynamics.ephemeris import earth_position_m, earth_velocity_m_s, seconds_since_j2000, sun_direction

AU_M, C_M_S, DAY_S = 149597870700.0, 299792458.0, 86400.0
ARCSEC = np.pi / 648000.0


@pytest.fixture(scope="module")
def reference():
    """(t_s, heliocentric Earth m, its barycentric velocity m/s) every 5 days from 1990 to 2050."""
    t = np.arange(-10 * 365.25, 50 * 365.25, 5.0) * DAY_S
    helio, bary = erfa.epv00(2451545.0, t / DAY_S)
    return t, helio["p"] * AU_M, bary["v"] * AU_M / DAY_S


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def test_direction_within_two_arcsec(reference, outside):
    t, helio, velocity = reference
    distance = np.linalg.norm(helio, axis=1)
    slow = np.sqrt(1.0 - np.sum(velocity**2, axis=1) / C_M_S**2)
    seen = erfa.ab(unit(-helio), velocity / C_M_S, distance / AU_M, slow)
    off = np.linalg.norm(sun_direction(t) - seen, axis=1) / ARCSEC
    outside("ERFA (IAU SOFA), epv00 and ab", "direction to the sun 1990 to 2050, largest, arcsec", off.max(), 2.0)
    assert np.sqrt(np.mean(off**2)) < 0.6


def test_aberration_is_there(reference):
    """Without it the direction is 20 arcsec off."""
    t, helio, _ = reference
    off = np.linalg.norm(sun_direction(t) - unit(-helio), axis=1) / ARCSEC
    assert off.min() > 18.0
    assert off.max() < 23.0


def test_distance_and_velocity(reference, outside):
    t, helio, velocity = reference
    ratio = np.linalg.norm(earth_position_m(t), axis=1) / np.linalg.norm(helio, axis=1)
    assert np.abs(ratio - 1.0).max() < 1e-5
    off = np.linalg.norm(earth_velocity_m_s(t) - velocity, axis=1).max()
    outside("ERFA (IAU SOFA), epv00", "Earth's velocity 1990 to 2050, largest, m/s", off, 20.0)


def test_a_spacecraft_sees_parallax_and_its_own_aberration():
    t = seconds_since_j2000(datetime(2026, 3, 20, tzinfo=UTC))
    centre = sun_direction(t)
    across = unit(np.cross(centre, [0.0, 0.0, 1.0]))
    shifted = sun_direction(t, position_m=6.8e6 * across)
    assert (shifted - centre) @ across / ARCSEC == pytest.approx(-9.4, abs=0.2)
    moving = sun_direction(t, velocity_m_s=7600.0 * across)
    assert (moving - centre) @ across / ARCSEC == pytest.approx(5.2, abs=0.1)


def test_equinox():
    """March 2026: the sun crosses the equator of date on the 20th, 14:46 UTC; that of J2000 is 0.15 deg off."""
    t = seconds_since_j2000(datetime(2026, 3, 20, 14, 46, tzinfo=UTC))
    x, y, z = sun_direction(t)
    precession = 2004.19 * 0.262 * ARCSEC  # rad in declination, 26.2 years
    assert x > 0.9999
    assert z == pytest.approx(-precession, abs=3e-5)
    assert np.hypot(y, z) < 0.01


def test_time():
    """2000-01-01 11:58:55.816 UTC is J2000.0; 2026: 69.184 s."""
    assert seconds_since_j2000(datetime(2000, 1, 1, 11, 58, 55, 816000, tzinfo=UTC)) == pytest.approx(0.0, abs=1e-6)
    d1, d2 = erfa.taitt(*erfa.utctai(*erfa.dtf2d("UTC", 2026, 7, 3, 4, 5, 6.0)))
    expected = ((d1 - 2451545.0) + d2) * DAY_S
    when = datetime(2026, 7, 3, 4, 5, 6, tzinfo=UTC)
    assert seconds_since_j2000(when) == pytest.approx(expected, abs=1e-4)
    east = timezone(timedelta(hours=8))
    assert seconds_since_j2000(when.astimezone(east)) == pytest.approx(expected, abs=1e-4)
    for text, when in (("its zone", datetime(2026, 1, 1)), ("from 1999-01-01 on", datetime(1998, 1, 1, tzinfo=UTC))):
        with pytest.raises(ValueError, match=text):
            seconds_since_j2000(when)


def test_shapes():
    assert sun_direction(0.0).shape == (3,)
    assert sun_direction(np.zeros((2, 4))).shape == (2, 4, 3)


def test_every_leap_second():
    """TT - UTC at the first of every month from 1999 to 2025, beside ERFA's table."""
    for year in range(1999, 2026):
        for month in range(1, 13):
            date = datetime(year, month, 1, tzinfo=UTC)
            utc_s = (date - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds()
            assert seconds_since_j2000(date) - utc_s == pytest.approx(erfa.dat(year, month, 1, 0.0) + 32.184, abs=1e-6)


def test_every_term_has_its_amplitude(outside):
    """What is left beside ERFA holds no printed term by two fifths: one that is twice as large leaves a half."""
    from relnav.dynamics.ephemeris import DISTANCE, LONGITUDE

    t = np.arange(-100 * 365.25, 100 * 365.25, 3.0) * DAY_S
    helio, _ = erfa.epv00(2451545.0, t / DAY_S)
    ours, theirs = earth_position_m(t) / AU_M, helio["p"]
    radius = np.linalg.norm(ours, axis=1) - np.linalg.norm(theirs, axis=1)
    east = np.cross([0.0, -np.sin(0.40909), np.cos(0.40909)], theirs)
    longitude = np.sum((ours - theirs) * unit(east), axis=1)
    millennia = t / (365250.0 * DAY_S)
    worst = 0.0
    for left, table in ((longitude, LONGITUDE), (radius, DISTANCE)):
        # what 200 years tell apart: neither a drift nor as good as the year
        rows = [row for row in table[0][1:] if abs(row[2]) > 100.0 and row[2] != 6275.96]
        phases = np.array([b + c * millennia for _, b, c in rows])
        slow = np.array([np.ones(len(t)), millennia, millennia**2])
        found = np.linalg.lstsq(np.concatenate([np.cos(phases), np.sin(phases), slow]).T, left, rcond=None)[0]
        size = np.hypot(found[: len(rows)], found[len(rows) : 2 * len(rows)])
        worst = max(worst, float((size / (1e-8 * np.array([a for a, _, _ in rows]))).max()))
    outside("ERFA (IAU SOFA), epv00", "what is left of a term of the sun's series, largest share", worst, 0.4)
