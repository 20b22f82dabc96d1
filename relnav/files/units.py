"""The one table that turns a key's or column's unit suffix into SI."""

import math
from typing import TypeVar

from relnav.arrays import Vector

Number = TypeVar("Number", float, Vector)

# suffix: (SI suffix, factor)
UNITS: dict[str, tuple[str, float]] = {
    "um": ("m", 1e-6),
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "m": ("m", 1.0),
    "km": ("m", 1e3),
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "deg": ("rad", math.pi / 180.0),
    "arcsec": ("rad", math.pi / 648000.0),
    "s": ("s", 1.0),
    "min": ("s", 60.0),
    "rad_s": ("rad_s", 1.0),
    "deg_s": ("rad_s", math.pi / 180.0),
    "m_s": ("m_s", 1.0),
    "mm_s": ("m_s", 1e-3),
    "cm_s": ("m_s", 1e-2),
    "m_s2": ("m_s2", 1.0),
    "mm_s2": ("m_s2", 1e-3),
    "m2_s3": ("m2_s3", 1.0),
    "nm": ("m", 1e-9),
    "us": ("s", 1e-6),
    "ms": ("s", 1e-3),
    "hz": ("hz", 1.0),
    "khz": ("hz", 1e3),
    "mw": ("w", 1e-3),
    "w": ("w", 1.0),
    "na": ("a", 1e-9),
    "ua": ("a", 1e-6),
    "ma": ("a", 1e-3),
    "a": ("a", 1.0),
    "v": ("v", 1.0),
    "ohm": ("ohm", 1.0),
    "kohm": ("ohm", 1e3),
    "a_w": ("a_w", 1.0),
    "pa_sqrt_hz": ("a_sqrt_hz", 1e-12),
    "a_sqrt_hz": ("a_sqrt_hz", 1.0),
    "w_m2_sr_nm": ("w_m3_sr", 1e9),
    "w_m3_sr": ("w_m3_sr", 1.0),
    "kg_m2": ("kg_m2", 1.0),
    "rad2_s3": ("rad2_s3", 1.0),
    "rad_sqrt_s": ("rad_sqrt_s", 1.0),
    "deg_sqrt_h": ("rad_sqrt_s", math.pi / 10800.0),
    "rad_s_sqrt_s": ("rad_s_sqrt_s", 1.0),
}


def split_unit(key: str) -> tuple[str, str]:
    """Split a key into its base and its longest known unit suffix ("" if there is none)."""
    best = ""
    for suffix in UNITS:
        if key.endswith("_" + suffix) and len(suffix) > len(best):
            best = suffix
    return (key[: -len(best) - 1], best) if best else (key, "")


def same_kind(unit: str) -> list[str]:
    """All units that measure what `unit` does."""
    kind = UNITS[unit][0]
    return [suffix for suffix, (si, _) in UNITS.items() if si == kind]


def to_si(value: Number, factor: float) -> Number:
    """The value times its factor; by division where that is exact in decimal (10 um is 1e-05 m, not 9.99e-06)."""
    inverse = round(1.0 / factor)
    if factor < 1.0 and abs(inverse * factor - 1.0) < 1e-12:
        return value / inverse
    return value * factor
