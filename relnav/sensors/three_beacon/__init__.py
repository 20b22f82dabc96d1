"""Three-beacon PSD sensor (seed 000: Cai, Zhao, Sun, Qiao, Dai 1996)."""

from relnav.sensors.three_beacon.measure import measure
from relnav.sensors.three_beacon.off_nominal import positions
from relnav.sensors.three_beacon.sensor import ThreeBeaconSensor

__all__ = ["ThreeBeaconSensor", "measure", "positions"]
