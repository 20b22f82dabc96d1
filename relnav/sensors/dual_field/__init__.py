"""Dual-field star sensor (seed 001: You, Xing, Dong 2004, CN 1609549)."""

from relnav.sensors.dual_field.measure import measure, track
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.solution import StarSolution, StarStatus

__all__ = ["StarSensor", "StarSolution", "StarStatus", "measure", "track"]
