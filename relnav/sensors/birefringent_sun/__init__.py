"""Birefringent sun sensor: the sun's direction from the two spots of a crystal, and which axes they determine.

Source: "Birefringent sun sensor and its measurement of three-axis attitude" (Chinese patent).
"""

from relnav.sensors.birefringent_sun.measure import measure
from relnav.sensors.birefringent_sun.observability import Observability, observability
from relnav.sensors.birefringent_sun.polarised import PolarisedRoll, polarised_roll
from relnav.sensors.birefringent_sun.self_calibration import SelfCalibration, self_calibrate
from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel
from relnav.sensors.birefringent_sun.turntable import TurntableCalibration, calibrate_known
from relnav.sensors.sun_direction import AttitudeObservation, SunDirection, attitude_observation

__all__ = [
    "AttitudeObservation",
    "BirefringentSunModel",
    "Observability",
    "PolarisedRoll",
    "SelfCalibration",
    "SunDirection",
    "TurntableCalibration",
    "attitude_observation",
    "calibrate_known",
    "measure",
    "observability",
    "polarised_roll",
    "self_calibrate",
]
