"""What was built: the camera on the chaser, the markers on the target, and how the one is meant to see the other."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from relnav.arrays import Matrix, Vector
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.sensors.loaded_model import LoadedModel

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]
Pair = tuple[float, float]
Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def _constant(array: Matrix) -> Matrix:
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class MarkerCamera:
    """A camera: axes x right, y down, z boresight; pixel (0, 0) has its centre at (0.0, 0.0) px.

    Attributes
    ----------
    focal_length_px, principal_point_px : (2,)
        Along x and y: u = fx x + cx, v = fy y + cy of the distorted normalised image (x, y).
    image_size_px : (2,)
        Width and height; the image spans -0.5 to width - 0.5.
    spot_noise_px : float
        1-sigma of each coordinate of a spot, unless a spot comes with its own covariance.
    distortion : (5,)
        k1, k2, p1, p2, k3 as in `relnav.geometry.distortion`: factors of powers of the normalised radius, from ray to
        spot as OpenCV's. A star camera's `distortion` is the inverse, from spot to ray.
    position_m : (3,)
        Lens from the chaser's centre of mass, chaser axes.
    q_cam_from_chaser : (4,)
        Mounting rotation v_cam = R v_chaser, scalar last.
    """

    focal_length_px: tuple[Positive, Positive]
    principal_point_px: Pair
    image_size_px: tuple[Annotated[int, Ge(1)], Annotated[int, Ge(1)]]
    spot_noise_px: Positive
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    position_m: Triple = (0.0, 0.0, 0.0)
    q_cam_from_chaser: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        dcm_from_quaternion(np.array(self.q_cam_from_chaser))

    @cached_property
    def lens(self) -> Vector:
        """What the compiled code reads, (12,): focal length, principal point, size, spot noise and distortion."""
        plane = [*self.focal_length_px, *self.principal_point_px, *self.image_size_px]
        return np.array([*plane, self.spot_noise_px, *self.distortion], dtype=np.float64)

    @cached_property
    def dcm_cam_from_chaser(self) -> Matrix:
        """v_cam = dcm @ v_chaser, (3, 3), read-only."""
        return _constant(dcm_from_quaternion(np.array(self.q_cam_from_chaser)))


def span_a_plane(points_m: Matrix) -> bool:
    """Whether three points or more (n, 3) do not all stand on one line."""
    spread = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 1e-6 * spread[0])


@dataclass(frozen=True)
class Markers:
    """Light spots on the target.

    Attributes
    ----------
    positions_m : (n, 3)
        Each marker from the target's centre of mass, target axes; three or more, not on one line.
    """

    positions_m: tuple[Triple, ...]

    def __post_init__(self) -> None:
        points = np.array(self.positions_m, dtype=np.float64).reshape(-1, 3)
        if len(points) < 3:
            raise ValueError(f"positions_m holds three markers or more; got {len(points)}")
        if not span_a_plane(points):
            raise ValueError("positions_m: the markers stand on one line; move one of them off it")

    @cached_property
    def points_m(self) -> Matrix:
        """The markers as rows of (n, 3), m, read-only."""
        return _constant(np.array(self.positions_m, dtype=np.float64))


@dataclass(frozen=True)
class View:
    """How the camera is expected to see the target: the attitude about which the paper's angles are small.

    Attributes
    ----------
    q_cam_from_target : (4,)
        Nominal relative attitude v_cam = R v_target, scalar last.
    attitude_sigma_rad : float
        1-sigma of the true relative attitude about it, each axis; it distinguishes the solutions of three spots. A
        filter takes it for that of its first event, and wider afterwards, by the sigma of the target's rate.
    """

    q_cam_from_target: Quaternion
    attitude_sigma_rad: Annotated[float, Gt(0.0), Le(math.pi)]

    def __post_init__(self) -> None:
        dcm_from_quaternion(np.array(self.q_cam_from_target))

    @property
    def dcm_cam_from_target(self) -> Matrix:
        """Nominal attitude, v_cam = dcm @ v_target, (3, 3)."""
        return dcm_from_quaternion(np.array(self.q_cam_from_target))

    @cached_property
    def belief(self) -> Vector:
        """The expected view as the compiled code reads it (`roots.BELIEF`), (49,): of the attitude alone."""
        covariance = np.diag([0.0] * 3 + [self.attitude_sigma_rad**2] * 3)
        return np.concatenate([self.dcm_cam_from_target.ravel(), np.zeros(3), covariance.ravel(), [0.0]])


@dataclass(frozen=True)
class Imager:
    """How an image becomes spots.

    Attributes
    ----------
    spot_sigma_px : float
        Radius (1-sigma of a Gaussian) of a distant marker's blob: what the simulator draws.
    read_noise_dn : float
        1-sigma noise of a dark pixel, in digital numbers.
    electrons_per_dn : float
        Photo-electrons per digital number: the shot noise of a pixel of s dn is sqrt(s / electrons_per_dn) dn.
    saturation_dn : float
        Largest number a pixel can hold.
    threshold_sigma : float
        A pixel belongs to a spot if it exceeds the background by this many noise sigmas.
    centroid_floor_px : float
        1-sigma error of a centroid that more light does not reduce (unequal pixels, lens calibration), each coordinate.
    """

    spot_sigma_px: Positive
    read_noise_dn: Positive
    electrons_per_dn: Positive
    saturation_dn: Positive
    threshold_sigma: Positive = 6.0
    centroid_floor_px: NonNegative = 0.0


@dataclass(frozen=True, repr=False)
class ThreeMarkerModel(LoadedModel, sensor_type="three_marker"):
    """One three-marker vision system: camera, markers, expected view, imager.

    `provenance` maps a key path ("camera.spot_noise_px") to where its value comes from; `path` is the file it was
    loaded from.
    """

    name: str
    title: str
    camera: MarkerCamera
    markers: Markers
    view: View
    imager: Imager
    provenance: Mapping[str, str] = field(default_factory=dict)
    path: str = ""
