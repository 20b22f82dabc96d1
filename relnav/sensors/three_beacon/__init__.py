"""Three-beacon PSD sensor: relative position from the spots of three beacons on a position-sensitive detector.

Source: Cai, Zhao, Sun, Qiao, Dai (1996),
"Determination of target relative position and range by PSD optical sensor system".
"""

from relnav.sensors.three_beacon.measure import measure
from relnav.sensors.three_beacon.off_nominal import positions
from relnav.sensors.three_beacon.sensor import ThreeBeaconSensor

__all__ = ["ThreeBeaconSensor", "measure", "positions"]
