"""What was built: lens, detector and beacon triangle of the three-beacon sensor.

Source: Cai, Zhao, Sun, Qiao, Dai (1996),
"Determination of target relative position and range by PSD optical sensor system".
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Gt

from relnav.arrays import Matrix

Positive = Annotated[float, Gt(0.0)]


@dataclass(frozen=True)
class ThreeBeaconSensor:
    """Three beacons on the target and one position-sensitive detector behind a lens on the chaser.

    Attributes
    ----------
    focal_length_m : float
        Lens focal length f.
    detector_size_m : (2,)
        Full width and height of the sensitive surface; a spot outside it cannot be real.
    spot_noise_m : float
        1-sigma white noise of each spot coordinate.
    beacon_half_spacing_m : float
        a: beacons A and B stand at (0, +a, 0) and (0, -a, 0) of the docking frame.
    beacon_c_distance_m : float
        b: beacon C stands at (b, 0, 0), out toward the chaser.
    projection : {"perspective", "parallel"}
        The closed form used: exact for central projection, or the paper's formulas as printed.
    extra_beacons_m : ((3,), ...)
        Further beacons D, E, ... in the docking frame. The detector coordinates of all are used (`spots`); the closed
        form (`fix`, and every start) uses A, B and C.
    """

    focal_length_m: Positive
    detector_size_m: tuple[Positive, Positive]
    spot_noise_m: Positive
    beacon_half_spacing_m: Positive
    beacon_c_distance_m: Positive
    projection: Literal["perspective", "parallel"] = "perspective"
    extra_beacons_m: tuple[tuple[float, float, float], ...] = ()

    @property
    def beacons_dock_m(self) -> Matrix:
        """All beacons (n, 3) in the docking frame, rows A, B, C and the further ones, m."""
        a, b = self.beacon_half_spacing_m, self.beacon_c_distance_m
        return np.array([[0.0, a, 0.0], [0.0, -a, 0.0], [b, 0.0, 0.0], *self.extra_beacons_m])
