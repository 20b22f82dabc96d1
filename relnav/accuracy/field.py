"""Where beacons leave the detector, by pointing law, and where it saturates."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.accuracy.sensitivity import place_state
from relnav.accuracy.single_shot import true_spots
from relnav.arrays import Vector
from relnav.mission import Model
from relnav.simulation.detector import background_current_a, photocurrents, project_beacons

NEAREST_M, FARTHEST_M = 0.05, 100.0
OFF_AXIS_DEG = (0.0, 1.0, 2.0, 4.0, 5.0)
LAWS = ("held", "tracking")
"""Camera held in `lvlh_ccsds` as the model says, or turned to O."""


@dataclass(frozen=True)
class FieldLimit:
    """Under one pointing law and azimuth: ranges inside which A or B is off, and C is; inf: at any range."""

    law: str
    azimuth_deg: float
    triangle_m: float
    beacon_c_m: float

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return dict(vars(self))


def field_limits(model: Model) -> tuple[FieldLimit, ...]:
    """Where the triangle leaves the detector, on the docking axis and beside it.

    Found by bisection between a range at which all are seen and the next smaller one at which not: exact optics.
    """
    half = 0.5 * np.array(model.sensor.detector_size_m)
    b = model.sensor.beacon_c_distance_m

    def on_detector(law: str, range_m: float, azimuth: float) -> tuple[bool, bool]:
        p = range_m * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        if law == "held":
            spots = project_beacons(model, place_state(model, p)[None])[0]
        else:
            spots = true_spots(model, p, "real")
            spots[(p - model.sensor.beacons_dock_m) @ p <= 0.0] = np.nan  # behind the camera
        on = (np.abs(spots) <= half).all(axis=1)
        return bool(on[0] and on[1]), bool(on[2])

    out = []
    for law in LAWS:
        for azimuth_deg in OFF_AXIS_DEG:
            azimuth = math.radians(azimuth_deg)
            limits = []
            for which in range(2):
                nearest = b * 1.001 if which else NEAREST_M

                def seen(range_m: float, which: int = which, law: str = law, azimuth: float = azimuth) -> bool:
                    return on_detector(law, range_m, azimuth)[which]

                limits.append(_limit(seen, nearest))
            out.append(FieldLimit(law, azimuth_deg, *limits))
    return tuple(out)


def _limit(seen: Any, nearest: float) -> float:
    """Range below which it is not seen any more on the way in from far; inf if it is not seen from far."""
    if not seen(FARTHEST_M):
        return math.inf
    ranges: Vector = np.geomspace(FARTHEST_M, nearest, 400)
    for near, far in zip(ranges[1:], ranges[:-1], strict=True):
        if not seen(float(near)):
            low, high = float(near), float(far)
            while high - low > 1e-6 * high:
                middle = 0.5 * (low + high)
                low, high = (low, middle) if seen(middle) else (middle, high)
            return high
    return nearest


def saturation_range_m(model: Model) -> float:
    """Distance on its boresight at which a beacon in the middle of the detector saturates it, m; NaN if unknown."""
    if model.detector is None or model.light is None:
        return math.nan
    detector, middle = model.detector, np.array([[10.0, 0.0, 0.0]])
    state = place_state(model, middle[0])[None]
    distance = 10.0 - model.sensor.beacon_c_distance_m
    at_ten = float(photocurrents(model, state)[0, 2])
    background = background_current_a(model)
    converter = detector.adc_full_scale_v / detector.feedback_resistance_ohm
    most = min(
        (converter - background) * 2.0 / detector.axis_share,
        detector.saturation_current_a - background * 2.0 / detector.axis_share,
    )
    return distance * math.sqrt(at_ten / most) if most > 0.0 else math.inf
