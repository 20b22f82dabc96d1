"""APS sun sensor and its compensation (seed 002: a Mars rover's sun sensor)."""

from relnav.sensors.aps_sun.calibration import Calibration, CalibrationResult, calibrate
from relnav.sensors.aps_sun.measure import measure
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.spot_centroid import Spot, centroid
from relnav.sensors.sun_direction import AttitudeObservation, SunDirection, attitude_observation

__all__ = [
    "ApsSunModel",
    "AttitudeObservation",
    "Calibration",
    "CalibrationResult",
    "Spot",
    "SunDirection",
    "attitude_observation",
    "calibrate",
    "centroid",
    "measure",
]
