"""How much light of a beacon, and of everything else, reaches the detector.

A beacon of power P radiates I(theta) = P (m + 1) / (2 pi) cos^m theta about its boresight (m = 1 is a Lambertian
source; m follows from the angle of half intensity). At distance d the lens of area A takes tau I A cos(phi) / d^2,
phi from its axis. A background of spectral radiance N, seen over the detector's solid angle through an interference
filter of width w, gives tau N w A Omega.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from relnav.arrays import Vector

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]


@dataclass(frozen=True)
class Light:
    """Beacons as lamps, and the lens and filter in front of the detector.

    Attributes
    ----------
    beacon_power_w : float
        Power of a beacon while it is on.
    half_power_angle_rad : float
        From a beacon's boresight (the docking axis) to where its intensity is half.
    aperture_diameter_m : float
        Of the lens.
    transmission : float
        Of lens and filter together, at the beacons' wavelength.
    filter_bandwidth_m : float
        Width of the interference filter.
    background_spectral_radiance_w_m3_sr : float
        Of whatever stands behind the beacons.
    """

    beacon_power_w: Positive
    half_power_angle_rad: Annotated[float, Gt(0.0), Lt(0.5 * math.pi)]
    aperture_diameter_m: Positive
    transmission: Annotated[float, Gt(0.0), Le(1.0)]
    filter_bandwidth_m: Positive
    background_spectral_radiance_w_m3_sr: NonNegative

    @property
    def aperture_area_m2(self) -> float:
        """Area of the lens."""
        return 0.25 * math.pi * self.aperture_diameter_m**2

    def received_power_w(self, distance_m: Vector, beacon_angle_rad: Vector, camera_angle_rad: Vector) -> Vector:
        """Power of a beacon on the detector, W: zero beyond 90 deg from its boresight or behind the camera.

        Parameters
        ----------
        distance_m : (...)
            Beacon to lens.
        beacon_angle_rad, camera_angle_rad : (...)
            Of the line between them from the beacon's boresight, and from the camera's.
        """
        m = -math.log(2.0) / math.log(math.cos(self.half_power_angle_rad))
        lobe = np.maximum(np.cos(beacon_angle_rad), 0.0) ** m
        intensity = self.beacon_power_w * (m + 1.0) / (2.0 * math.pi) * lobe
        area = self.aperture_area_m2 * np.maximum(np.cos(camera_angle_rad), 0.0)
        power: Vector = self.transmission * intensity * area / np.asarray(distance_m) ** 2
        return power

    def background_power_w(self, size_m: tuple[float, float], focal_length_m: float) -> float:
        """Power of the background on a detector of this size behind this lens, W."""
        solid_angle = size_m[0] * size_m[1] / focal_length_m**2
        radiance = self.background_spectral_radiance_w_m3_sr * self.filter_bandwidth_m
        return self.transmission * radiance * self.aperture_area_m2 * solid_angle
