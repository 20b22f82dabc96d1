"""What was built: light filter, uniaxial crystal and detector of the birefringent sun sensor.

Source: "Birefringent sun sensor and its measurement of three-axis attitude" (Chinese patent).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from relnav.arrays import Matrix, Vector
from relnav.sensors.birefringent_sun.crystal import optic_axis
from relnav.sensors.loaded_model import LoadedModel
from relnav.sensors.spot_centroid import SpotImage
from relnav.sensors.sun_direction import Mounting

Positive = Annotated[float, Gt(0.0)]
Index = Annotated[float, Gt(1.0), Lt(4.0)]


@dataclass(frozen=True)
class BirefringentSunSensor:
    """A crystal plate behind a small opening; every sun direction makes an ordinary and an extraordinary spot.

    z is the boresight; detector axes are turned by 180 deg, so that spots move with the sun.

    Attributes
    ----------
    light_filter : {"hole", "dot", "lens"}
        The patent's three variants: a hole or a black dot on the crystal's face, or a lens before it.
    crystal_thickness_m : float
        d.
    air_path_m : float
        L: focal length of the lens, and any gap behind the crystal; both act alike.
    axis_polar_rad, axis_azimuth_rad : float
        theta_p from z and phi_p from x of the optic axis, constants of the crystal. (The patent's phi_p is counted from
        the plane of incidence and so is no constant.)
    ordinary_index, extraordinary_index : float
        n_o, n_e at the wavelength of the filter (`calcite`).
    pixel_pitch_m, detector_size_px, zero_spot_px : float, (2,), (2,)
        Pixel, their number, and the pixel under the opening.
    field_half_angle_rad : float
        Off the boresight.
    spot_noise_px : float
        1-sigma of each spot coordinate.
    separation_px : float
        Spots closer than this cannot be told apart.
    """

    light_filter: Literal["hole", "dot", "lens"]
    crystal_thickness_m: Positive
    air_path_m: Annotated[float, Ge(0.0)]
    axis_polar_rad: Annotated[float, Ge(0.0), Le(1.5708)]
    axis_azimuth_rad: float
    ordinary_index: Index
    extraordinary_index: Index
    pixel_pitch_m: Positive
    detector_size_px: tuple[Annotated[int, Ge(8)], Annotated[int, Ge(8)]]
    zero_spot_px: tuple[float, float]
    field_half_angle_rad: Annotated[float, Gt(0.0), Le(1.5)]
    spot_noise_px: Positive
    separation_px: Positive

    def __post_init__(self) -> None:
        if self.light_filter == "lens" and self.air_path_m == 0.0:
            raise ValueError("a lens stands its focal length before the crystal: air_path must be above zero")

    @property
    def axis(self) -> Vector:
        """c, unit optic axis (3,)."""
        return optic_axis(self.axis_polar_rad, self.axis_azimuth_rad)

    @cached_property
    def plate(self) -> Vector:
        """What the compiled code reads: L, d, n_o, n_e and c, (7,); no one else may write to it."""
        lengths = [self.air_path_m, self.crystal_thickness_m, self.ordinary_index, self.extraordinary_index]
        return np.array([*lengths, *self.axis])

    @cached_property
    def noise_m2(self) -> Matrix:
        """Covariance of two spots with the sensor's own noise, (4, 4) m^2; no one else may write to it."""
        return np.eye(4) * (self.pixel_pitch_m * self.spot_noise_px) ** 2

    @property
    def patent_f_m(self) -> float:
        """Length f of the patent's angles: the lens's focal length; the crystal's thickness for hole and dot."""
        return self.air_path_m if self.light_filter == "lens" else self.crystal_thickness_m

    @property
    def merging_angle_rad(self) -> float:
        """Sun angle at which the spots merge, the refracted wave running along the axis; NaN if there is none."""
        sine = self.ordinary_index * np.sin(self.axis_polar_rad)
        return float(np.arcsin(sine)) if sine <= 1.0 else float("nan")


@dataclass(frozen=True, repr=False)
class BirefringentSunModel(LoadedModel, sensor_type="birefringent_sun"):
    """One birefringent sun sensor; `provenance` and `path` say where its values come from."""

    name: str
    title: str
    sensor: BirefringentSunSensor
    image: SpotImage
    mounting: Mounting
    provenance: Mapping[str, str] = field(default_factory=dict, compare=False, hash=False)
    path: str = field(default="", compare=False)
