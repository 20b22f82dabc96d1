"""Dual-field star sensor: attitude from the stars of two fields on one detector.

Source: You, Xing, Dong (2004),
"Dual-field star sensor and star identification with it", patent CN 1609549.
"""

from relnav.sensors.dual_field.measure import measure, track
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.solution import StarSolution, StarStatus
from relnav.sensors.dual_field.star_spots import FoundStars, find_stars

__all__ = ["FoundStars", "StarSensor", "StarSolution", "StarStatus", "find_stars", "measure", "track"]
