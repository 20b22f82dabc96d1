"""What was built: hole, dome, cover glass and detector of the APS sun sensor.

Source: "Error compensation method for the APS sun sensor of a Mars rover" (Chinese patent, 2021).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from relnav.sensors.loaded_model import LoadedModel
from relnav.sensors.spot_centroid import SpotImage
from relnav.sensors.sun_direction import Mounting

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]
Tilt = Annotated[float, Gt(-0.2), Lt(0.2)]
Index = Annotated[float, Ge(1.0), Lt(4.0)]


@dataclass(frozen=True)
class ApsSunSensor:
    """A hole above a glass-covered pixel detector; z is the boresight, spots are seen at +h tan(angle).

    Attributes
    ----------
    hole_height_m : float
        h: from the hole down to the detector, along z. Mechanical; the optical one is `paraxial_height_m`.
    glass_depth_m, glass_thickness_m, glass_index : float
        a, t, n of the cover glass: its top lies a below the hole. Thickness 0: no glass.
    glass_tilt_rad, detector_tilt_rad : (2,)
        Tilt of the normal toward x and toward y.
    detector_rotation_rad : float
        kappa: rotation of the pixel axes about z.
    misalignment_rad : (3,)
        Small rotations about x, y, z that take the reference (cube) axes into those of the optics: R_z R_y R_x.
    pixel_pitch_m, detector_size_px, zero_spot_px : float, (2,), (2,)
        Pixel, their number, and (x0, y0), the pixel under the hole; 0-based, centres are integers.
    field_half_angle_rad : float
        Calibrated field: both projection angles within it.
    spot_noise_px : float
        1-sigma of each spot coordinate.
    """

    hole_height_m: Positive
    glass_depth_m: NonNegative
    glass_thickness_m: NonNegative
    glass_index: Index
    glass_tilt_rad: tuple[Tilt, Tilt]
    detector_tilt_rad: tuple[Tilt, Tilt]
    detector_rotation_rad: Tilt
    misalignment_rad: tuple[Tilt, Tilt, Tilt]
    pixel_pitch_m: Positive
    detector_size_px: tuple[Annotated[int, Ge(8)], Annotated[int, Ge(8)]]
    zero_spot_px: tuple[float, float]
    field_half_angle_rad: Annotated[float, Gt(0.0), Le(1.3)]
    spot_noise_px: Positive

    def __post_init__(self) -> None:
        if self.glass_depth_m + self.glass_thickness_m >= self.hole_height_m:
            raise ValueError(
                f"the cover glass (depth {self.glass_depth_m:g} m, thickness {self.glass_thickness_m:g} m) must end "
                f"above the detector (hole_height {self.hole_height_m:g} m)"
            )

    @property
    def paraxial_height_m(self) -> float:
        """Optical h: slope of the spot over tan(angle) on axis, h - t + t/n."""
        t = self.glass_thickness_m
        return self.hole_height_m - t + t / self.glass_index


@dataclass(frozen=True)
class Dome:
    """A hemispherical window around the hole; thickness 0: none.

    Attributes
    ----------
    radius_m, thickness_m, index : float
        Outer radius R1, thickness, refractive index.
    centre_m : (3,)
        c1: centre of the outer sphere, from the hole.
    wedge_m : (2,)
        Centre of the inner sphere from that of the outer one, x and y.
    """

    radius_m: Positive = 0.016
    thickness_m: NonNegative = 0.0
    index: Index = 1.4585
    centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wedge_m: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        reach = np.linalg.norm(self.centre_m) + np.hypot(*self.wedge_m) + self.thickness_m
        if self.thickness_m > 0.0 and reach >= self.radius_m:
            raise ValueError("the hole must lie inside the dome: centre, wedge and thickness reach beyond its radius")


@dataclass(frozen=True, repr=False)
class ApsSunModel(LoadedModel, sensor_type="aps_sun"):
    """One APS sun sensor; `provenance` and `path` say where its values come from."""

    name: str
    title: str
    sensor: ApsSunSensor
    dome: Dome
    image: SpotImage
    mounting: Mounting
    provenance: Mapping[str, str] = field(default_factory=dict, compare=False, hash=False)
    path: str = field(default="", compare=False)

    @cached_property
    def kept(self) -> dict[str, Any]:
        """Results computed once from the model, by name; a lookup by the model's value takes longer than their use."""
        return {}
