"""APS sun sensor: the sun's direction from the image of a pinhole, and the compensation of its errors.

Source: "Error compensation method for the APS sun sensor of a Mars rover" (Chinese patent, 2021).
"""

from relnav.sensors.aps_sun.calibration import Calibration, CalibrationResult, calibrate
from relnav.sensors.aps_sun.measure import measure
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.spot_centroid import Spot, centroid
from relnav.sensors.sun_direction import AttitudeObservation, SunDirection, attitude_observation
from relnav.sensors.sun_heading import GyroDrift, gyro_drift, yaw_from_sun

__all__ = [
    "ApsSunModel",
    "AttitudeObservation",
    "Calibration",
    "CalibrationResult",
    "GyroDrift",
    "Spot",
    "SunDirection",
    "attitude_observation",
    "calibrate",
    "centroid",
    "gyro_drift",
    "measure",
    "yaw_from_sun",
]
