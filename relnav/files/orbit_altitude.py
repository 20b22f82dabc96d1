"""An orbit given by its altitude in a model file, for those who do not think in rad/s."""

import math
from typing import Any, TypeGuard

from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.files.toml_values import Problems
from relnav.files.units import UNITS, split_unit, to_si
from relnav.simulation.orbits import EARTH_RADIUS_M

LOWEST_M = 80e3
"""The lowest perigee with which a satellite comes round (McDowell 2018, "The edge of space")."""


def mean_motion_of_altitude(table: dict[str, Any], problems: Problems) -> None:
    """Replace `altitude_km` (or in m) of the section [orbit] by the mean motion n = sqrt(mu / a^3), in place.

    The altitude is a - EARTH_RADIUS_M: of the perigee it is less by a e.
    """
    orbit = table.get("orbit")
    keys = [key for key in orbit if split_unit(key)[0] == "altitude"] if isinstance(orbit, dict) else []
    if not isinstance(orbit, dict) or not keys:
        return
    key, unit = keys[0], split_unit(keys[0])[1]
    entry, eccentricity = orbit.pop(key), orbit.get("eccentricity", 0.0)
    value = entry.get("value") if isinstance(entry, dict) else entry
    e = eccentricity.get("value") if isinstance(eccentricity, dict) else eccentricity
    if len(keys) > 1 or any(split_unit(other)[0] == "mean_motion" for other in orbit):
        problems.add(f"orbit.{key}", "altitude and mean motion say the same; keep one")
    elif UNITS.get(unit, ("",))[0] != "m" or not _is_number(value) or not -1e9 < value < 1e12:
        problems.add(f"orbit.{key}", "an altitude is a number in m or km: altitude_km = 400.0")
    else:
        a = EARTH_RADIUS_M + to_si(float(value), UNITS[unit][1])
        perigee = a * (1.0 - e) - EARTH_RADIUS_M if _is_number(e) else 0.0
        if perigee < 0.0:
            problems.add(
                f"orbit.{key}",
                f"the perigee lies {-perigee / 1e3:.0f} km below the ground; altitude is a less the Earth's radius",
            )
        elif perigee < LOWEST_M:
            problems.add(f"orbit.{key}", f"the perigee lies {perigee / 1e3:.3g} km high, in the air; km or m?")
        n = math.sqrt(MU_EARTH_M3_S2 / max(a, 1.0) ** 3)
        why = f"sqrt(mu / a^3), a = {a:.1f} m from {key} = {value:g}"
        orbit["mean_motion_rad_s"] = {"value": n, "source": "derived", "why": why}
        return
    orbit.setdefault("mean_motion_rad_s", 1e-3)  # so that only the altitude is complained of


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
