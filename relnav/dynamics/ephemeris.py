"""Where the sun stands seen from a spacecraft near the Earth, from a short series: within 2 arcsec from 1990 to 2050.

The Earth's heliocentric place is the leading terms of VSOP87 (Bretagnon and Francou 1988, A&A 202, 309; version B,
ecliptic and equinox of J2000), those above some 7e-7 rad or au. Axes of what leaves are the mean equator and equinox of
J2000, which are ICRS within 0.03 arcsec. The sun's own motion about the barycentre during the light's 8 minutes is left
out (0.01 arcsec). Time is TT (or TDB) in seconds since J2000.0; UTC in its place would be 69 s late, 2.8 arcsec.
"""

import math
from datetime import UTC, datetime

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix

AU_M = 149597870700.0
"""Astronomical unit (IAU 2012)."""
LIGHT_M_S = 299792458.0
OBLIQUITY_RAD = math.radians(84381.406 / 3600.0)
"""Of the ecliptic at J2000 (IAU 2006)."""
MILLENNIUM_S = 365250.0 * 86400.0
DAY_S = 86400.0
J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
TT_MINUS_TAI_S = 32.184
TAI_MINUS_UTC_S = (
    (datetime(1999, 1, 1, tzinfo=UTC), 32.0),
    (datetime(2006, 1, 1, tzinfo=UTC), 33.0),
    (datetime(2009, 1, 1, tzinfo=UTC), 34.0),
    (datetime(2012, 7, 1, tzinfo=UTC), 35.0),
    (datetime(2015, 7, 1, tzinfo=UTC), 36.0),
    (datetime(2017, 1, 1, tzinfo=UTC), 37.0),
)
"""Leap seconds (IERS Bulletin C); none has been added since 2017."""

# Rows (A, B, C): A cos(B + C t), A in 1e-8 rad or au, t in millennia; one table for each power of t.
LONGITUDE = (
    ((175347046.0, 0.0, 0.0), (3341656.0, 4.6692568, 6283.07585), (34894.0, 4.6261, 12566.1517),
     (3497.0, 2.7441, 5753.3849), (3418.0, 2.8289, 3.5231), (3136.0, 3.6277, 77713.7715),
     (2676.0, 4.4181, 7860.4194), (2343.0, 6.1352, 3930.2097), (1324.0, 0.7425, 11506.7698),
     (1273.0, 2.0371, 529.691), (1199.0, 1.1096, 1577.3435), (990.0, 5.233, 5884.927),
     (902.0, 2.045, 26.298), (857.0, 3.508, 398.149), (780.0, 1.179, 5223.694), (753.0, 2.533, 5507.553),
     (505.0, 4.583, 18849.228), (492.0, 4.205, 775.523), (357.0, 2.92, 0.067), (317.0, 5.849, 11790.629),
     (284.0, 1.899, 796.298), (271.0, 0.315, 10977.079), (243.0, 0.345, 5486.778), (206.0, 4.806, 2544.314),
     (205.0, 1.869, 5573.143), (202.0, 2.458, 6069.777), (156.0, 0.833, 213.299), (132.0, 3.411, 2942.463),
     (126.0, 1.083, 20.775), (115.0, 0.645, 0.98), (103.0, 0.636, 4694.003), (102.0, 0.976, 15720.839),
     (102.0, 4.267, 7.114), (99.0, 6.21, 2146.17), (98.0, 0.68, 155.42), (86.0, 5.98, 161000.69),
     (85.0, 1.3, 6275.96), (85.0, 3.67, 71430.7), (80.0, 1.81, 17260.15)),
    ((628307584999.0, 0.0, 0.0), (206059.0, 2.678235, 6283.07585), (4303.0, 2.6351, 12566.1517),
     (425.0, 1.59, 3.523), (119.0, 5.796, 26.298), (109.0, 2.966, 1577.344), (93.0, 2.59, 18849.23),
     (72.0, 1.14, 529.69)),
    ((8722.0, 1.0725, 6283.0758), (991.0, 3.1416, 0.0), (295.0, 0.437, 12566.152)),
)  # fmt: skip
LATITUDE = (
    ((280.0, 3.199, 84334.662), (102.0, 5.422, 5507.553), (80.0, 3.88, 5223.69)),
    ((227778.0, 3.413766, 6283.07585), (3806.0, 3.3706, 12566.1517), (3620.0, 0.0, 0.0)),
    ((9721.0, 5.1519, 6283.0758), (233.0, 3.1416, 0.0)),
)
DISTANCE = (
    ((100013989.0, 0.0, 0.0), (1670700.0, 3.0984635, 6283.07585), (13956.0, 3.05525, 12566.1517),
     (3084.0, 5.1985, 77713.7715), (1628.0, 1.1739, 5753.3849), (1576.0, 2.8469, 7860.4194),
     (925.0, 5.453, 11506.77), (542.0, 4.564, 3930.21), (472.0, 3.661, 5884.927), (346.0, 0.964, 5507.553),
     (329.0, 5.9, 5223.694), (307.0, 0.299, 5573.143), (243.0, 4.273, 11790.629), (212.0, 5.847, 1577.344),
     (186.0, 5.022, 10977.079), (175.0, 3.012, 18849.228), (110.0, 5.055, 5486.778), (98.0, 0.89, 6069.78),
     (86.0, 5.69, 15720.84), (86.0, 1.27, 161000.69)),
    ((103019.0, 1.10749, 6283.07585), (1721.0, 1.0644, 12566.1517), (702.0, 3.142, 0.0)),
    ((4359.0, 5.7846, 6283.0758), (124.0, 5.579, 12566.152)),
)  # fmt: skip


def _terms(tables: tuple[tuple[tuple[tuple[float, float, float], ...], ...], ...]) -> Matrix:
    """All rows, one below the other, as columns B, C and the power of t, and A in one column for each table."""
    rows = [
        (b, c, power, *(a if k == which else 0.0 for k in range(len(tables))))
        for which, table in enumerate(tables)
        for power, part in enumerate(table)
        for a, b, c in part
    ]
    return np.array(rows)


_TERMS = _terms((LONGITUDE, LATITUDE, DISTANCE))


def seconds_since_j2000(utc: datetime) -> float:
    """TT seconds since J2000.0 (2000-01-01 12:00 TT) of a UTC time.

    Raises
    ------
    ValueError
        For a time without time zone, or before 1999: earlier leap seconds are not kept here.
    """
    if utc.tzinfo is None:
        raise ValueError("a time with its zone is expected: datetime(..., tzinfo=UTC)")
    known = [seconds for since, seconds in TAI_MINUS_UTC_S if utc >= since]
    if not known:
        raise ValueError(f"times from {TAI_MINUS_UTC_S[0][0]:%Y-%m-%d} on can be converted; got {utc.isoformat()}")
    return (utc - J2000).total_seconds() + known[-1] + TT_MINUS_TAI_S


def earth_position_m(t_s: ArrayLike) -> Matrix:
    """Heliocentric position of the Earth (..., 3), m, at TT seconds since J2000.0 (...)."""
    t = np.asarray(t_s, dtype=np.float64) / MILLENNIUM_S
    phase, speed, power = _TERMS[:, :3].T
    series = 1e-8 * (np.cos(phase + speed * t[..., None]) * t[..., None] ** power) @ _TERMS[:, 3:]
    longitude, latitude, distance = series[..., 0], series[..., 1], series[..., 2]
    level = distance * np.cos(latitude)
    x, y, z = level * np.cos(longitude), level * np.sin(longitude), distance * np.sin(latitude)
    c, s = math.cos(OBLIQUITY_RAD), math.sin(OBLIQUITY_RAD)
    return AU_M * np.stack([x, c * y - s * z, s * y + c * z], axis=-1)


def earth_velocity_m_s(t_s: ArrayLike) -> Matrix:
    """Velocity of the Earth (..., 3), m/s, heliocentric: within 20 m/s (0.014 arcsec of aberration) of barycentric."""
    return _earth(t_s)[1]


def _earth(t_s: ArrayLike) -> tuple[Matrix, Matrix]:
    """Position and velocity of the Earth; velocity from differences over a tenth of a day."""
    t, half = np.asarray(t_s, dtype=np.float64), 0.05 * DAY_S
    now, before, after = earth_position_m(np.stack([t, t - half, t + half]))
    return now, (after - before) / (2.0 * half)


def sun_direction(t_s: ArrayLike, position_m: ArrayLike | None = None, velocity_m_s: ArrayLike | None = None) -> Matrix:
    """Unit vectors (..., 3) toward the sun as a sensor sees it, with aberration; within 2 arcsec.

    Parameters
    ----------
    t_s : (...)
        TT seconds since J2000.0 (`seconds_since_j2000`).
    position_m, velocity_m_s : (..., 3), optional
        Of the spacecraft from the Earth's centre, J2000 (GCRS) axes. Left out, the sun as from the Earth's centre: in
        low orbit 9.4 arcsec off by parallax, and 5 arcsec by aberration, at most.
    """
    earth, velocity = _earth(t_s)
    to_sun = -earth
    if position_m is not None:
        to_sun = to_sun - np.asarray(position_m, dtype=np.float64)
    if velocity_m_s is not None:
        velocity = velocity + np.asarray(velocity_m_s, dtype=np.float64)
    geometric = to_sun / np.linalg.norm(to_sun, axis=-1, keepdims=True)
    seen = geometric + velocity / LIGHT_M_S  # to first order in v/c: the rest is 0.001 arcsec
    apparent: Matrix = seen / np.linalg.norm(seen, axis=-1, keepdims=True)
    return apparent
