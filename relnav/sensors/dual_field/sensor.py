"""What was built: camera, fold and identification of a star sensor with one or two fields, in SI units and pixels."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from relnav.arrays import Matrix, Vector
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.dual_field.catalogue import StarCatalogue
from relnav.sensors.dual_field.fold import mirror_fold
from relnav.sensors.dual_field.identify import Limits
from relnav.sensors.dual_field.sky import Sky, prepare_sky
from relnav.sensors.loaded_model import LoadedModel

Positive = Annotated[float, Gt(0.0)]
Pair = tuple[float, float]
Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class StarCamera:
    """Lens and detector; spots are measured from the detector's centre, x right, y down.

    Attributes
    ----------
    focal_length_px : float
        In pixels.
    principal_point_px : (2,)
        Where the optical axis meets the detector, from its centre.
    distortion : (2,)
        k1, k2 of p = d (1 + k1 |d|^2 + k2 |d|^4), d = (spot - principal point) / f, p on the plane z = 1: from spot to
        ray. OpenCV's, and a marker camera's, lead from ray to spot, the inverse: k1 has about the opposite sign.
    detector_size_px : (2,)
        Width and height; a spot outside is not used.
    spot_noise_px : float
        1-sigma of each coordinate, with what the distortion model leaves.
    first_pixel_px : {"none", "0", "0.5"}
        How spots count in this sensor's files: from the detector's centre ("none"), or from its corner, the first
        pixel's centre being (0, 0) or (0.5, 0.5). In calls they always count from the centre.
    focal_length_relative_sigma : float
        1-sigma by which the focal length may be off; zero: it is exact. Where it may be off it is estimated with every
        frame, and what is left of the error is in the covariance. Of both fields, which share the lens.
    """

    focal_length_px: Positive
    principal_point_px: Pair
    distortion: Pair
    detector_size_px: tuple[Positive, Positive]
    spot_noise_px: Positive
    first_pixel_px: Literal["none", "0", "0.5"] = "none"
    focal_length_relative_sigma: Annotated[float, Ge(0.0), Le(0.01)] = 0.0

    @property
    def widest_rad(self) -> float:
        """Angle across the detector's diagonal."""
        return 2.0 * math.atan(0.5 * math.hypot(*self.detector_size_px) / self.focal_length_px)


@dataclass(frozen=True)
class Fold:
    """How the second field comes onto the detector: see `relnav/sensors/dual_field/fold.py`.

    Attributes
    ----------
    kind : {"none", "mirror", "rotation"}
        One field; a half mirror; or two reflections (a prism), which turn the second field.
    mirror_normal : (3,)
        Unit normal of the mirror, camera axes, either sign.
    rotation : (4,)
        Of the turned field: quaternion (x, y, z, w) of the R in s = R u. R is multiplied by u, the ray as the detector
        shows it, and gives s, the direction on the sky from which the light came, both in camera axes. So R turns the
        camera's boresight +z into that of field 1, and R^T leads from the sky to the detector.
    error_rad : float
        1-sigma by which the mirror's normal is off about each axis across it, or the turned field about any axis. It
        lasts, is estimated with every frame, and what is left of it is in the covariance.
    transmission, reflectance : float
        Share of the light that comes through the mirror from field 0, and by it from field 1.
    """

    kind: Literal["none", "mirror", "rotation"] = "none"
    mirror_normal: Triple = (math.sqrt(0.5), 0.0, -math.sqrt(0.5))
    rotation: Quaternion = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
    error_rad: Annotated[float, Ge(0.0), Lt(1e-4)] = math.radians(10.0 / 3600.0)
    transmission: Annotated[float, Gt(0.0), Le(1.0)] = 0.5
    reflectance: Annotated[float, Gt(0.0), Le(1.0)] = 0.5

    def __post_init__(self) -> None:
        if self.transmission + self.reflectance > 1.0 + 1e-9:
            raise ValueError(
                "transmission and reflectance are shares of the same light, together 1 at most; got "
                f"{self.transmission:g} and {self.reflectance:g}"
            )
        if abs(math.hypot(*self.mirror_normal) - 1.0) > 1e-6:
            raise ValueError(f"mirror_normal is a unit vector; its length is {math.hypot(*self.mirror_normal):.9g}")
        if abs(math.hypot(*self.rotation) - 1.0) > 1e-6:
            raise ValueError(
                f"rotation is a unit quaternion (x, y, z, w); its norm is {math.hypot(*self.rotation):.9g}"
            )

    @property
    def fainter_mag(self) -> float:
        """By how much a star looks fainter in field 1 than in field 0: 2.5 log10(transmission / reflectance)."""
        return 2.5 * math.log10(self.transmission / self.reflectance)

    @property
    def matrix(self) -> Matrix | None:
        """M of s = M u, (3, 3); None for one field."""
        if self.kind == "none":
            return None
        return (
            mirror_fold(self.mirror_normal) if self.kind == "mirror" else dcm_from_quaternion(np.array(self.rotation))
        )

    @property
    def covariance(self) -> Matrix:
        """Of the small turn phi (3,) in s + phi x s, s = M u, rad^2, (3, 3); zero for one field.

        A mirror whose normal n turns by omega across n turns M into R M R^T, and its ray by phi = omega + M omega, that
        is 2 omega.
        """
        if self.kind == "none":
            return np.zeros((3, 3))
        if self.kind == "rotation":
            return self.error_rad**2 * np.eye(3)
        n = np.asarray(self.mirror_normal) / math.hypot(*self.mirror_normal)
        across: Matrix = 4.0 * self.error_rad**2 * (np.eye(3) - np.outer(n, n))
        return across


@dataclass(frozen=True)
class Identification:
    """Which stars are looked for, and when an attitude is believed.

    Attributes
    ----------
    faintest_star_mag, faintest_pair_mag : float
        Hipparcos magnitude of the faintest star that a spot may be, and of the faintest that the search starts from.
    magnitude_zero_point : float
        m = zero point - 2.5 log10(flux).
    magnitude_gate : float
        Largest difference of magnitude between a spot and its star, where the frame has fluxes.
    shortest_pair_rad : float
        Pairs closer than this are not started from.
    false_alarm_probability : float
        Bound on the probability of an attitude from false spots alone.
    most_attitudes_tried : int
        Then a frame is given up: it bounds the time that a hopeless frame costs.
    epoch_jyear : float
        Julian year of the stars' places unless a frame says otherwise.
    """

    faintest_star_mag: float
    faintest_pair_mag: float
    magnitude_zero_point: float
    magnitude_gate: Positive
    shortest_pair_rad: Positive
    false_alarm_probability: Annotated[float, Gt(0.0), Lt(1.0)]
    most_attitudes_tried: Annotated[int, Gt(0)]
    epoch_jyear: Annotated[float, Ge(1900.0), Lt(2200.0)]

    @property
    def limits(self) -> Limits:
        """As the search takes them."""
        return Limits(self.false_alarm_probability, self.most_attitudes_tried, shortest_rad=self.shortest_pair_rad)


@dataclass(frozen=True, repr=False)
class StarSensor(LoadedModel, sensor_type="dual_field"):
    """One star sensor with its catalogue.

    `provenance` maps a key path to where its value comes from; `path` is the file it was loaded from.
    """

    name: str
    title: str
    camera: StarCamera
    fold: Fold
    identification: Identification
    catalogue: StarCatalogue = field(compare=False)
    provenance: Mapping[str, str] = field(default_factory=dict)
    path: str = ""

    @cached_property
    def parameters(self) -> Vector:
        """Camera, search and fold as the compiled solver reads them, at rest; (36,), see `frame_solver.PARAMETERS`."""
        camera, fold = self.camera, self.fold.matrix
        return np.concatenate(
            [
                [camera.focal_length_px, *camera.principal_point_px, *camera.distortion],
                [0.5 * camera.detector_size_px[0], 0.5 * camera.detector_size_px[1], camera.spot_noise_px],
                [self.identification.magnitude_gate, 1.0 if fold is None else 2.0],
                self.identification.limits.settings,
                np.zeros(3),
                (np.eye(3) if fold is None else fold).ravel(),
                self.fold.covariance.ravel(),
                [self.fold.fainter_mag],
            ]
        )

    @cached_property
    def _own_sky(self) -> Sky:
        return self._sky_at(self.identification.epoch_jyear)

    def sky(self, epoch_jyear: float | None = None) -> Sky:
        """The star tables of an epoch (the model's own if left out), computed once for each epoch."""
        if epoch_jyear is None or epoch_jyear == self.identification.epoch_jyear:
            return self._own_sky
        return self._sky_at(epoch_jyear)

    def _sky_at(self, epoch_jyear: float) -> Sky:
        limits = self.identification
        return prepare_sky(
            self.catalogue,
            epoch_jyear,
            limits.faintest_star_mag,
            limits.faintest_pair_mag,
            limits.shortest_pair_rad,
            self.camera.widest_rad,
        )
