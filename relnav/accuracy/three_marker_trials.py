"""Random views of a marker pattern, and what the published and the exact solutions make of them."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.geometry.p3p import p3p
from relnav.geometry.pinhole import central_projection
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.sensors.measurement import Status
from relnav.sensors.three_marker.as_published import depth_iteration, small_angle
from relnav.sensors.three_marker.camera import project, unit_rays
from relnav.sensors.three_marker.measure import measure
from relnav.sensors.three_marker.pose import pose_error
from relnav.sensors.three_marker.sensor import ThreeMarkerModel

LATERAL = 0.05
"""Of the range: the target's centre of mass stands up to that far off the boresight, each axis."""


@dataclass(frozen=True)
class PoseTrials:
    """Measurements of random noisy views at one range.

    Attributes
    ----------
    error : (n, 6)
        Position error in camera axes, m; attitude error in target axes, rad; NaN where there is no value.
    nees : (n,)
        Of the six; NaN where there is no value.
    status : (n,)
        Status codes.
    """

    error: Matrix
    nees: Vector
    status: Codes

    @property
    def ok(self) -> Vector:
        """Which gave a value, (n,) bool."""
        return np.asarray(self.status == int(Status.OK))

    @property
    def attitude_rms_rad(self) -> float:
        """Root mean square of the whole attitude error, over the values given."""
        return float(np.sqrt(np.mean(np.sum(self.error[self.ok, 3:] ** 2, axis=-1))))

    @property
    def position_rms_m(self) -> float:
        """Root mean square of the whole position error, over the values given."""
        return float(np.sqrt(np.mean(np.sum(self.error[self.ok, :3] ** 2, axis=-1))))


def random_pose(model: ThreeMarkerModel, range_m: float, attitude: Vector, rng: np.random.Generator) -> Matrix:
    """Pose (4, 3): attitude (3,) rad off nominal, the target a little off the boresight."""
    aside = rng.uniform(-LATERAL, LATERAL, size=2) * range_m
    return np.concatenate([turned(model.view.dcm_cam_from_target, attitude), [[aside[0], aside[1], range_m]]])


def random_axis(rng: np.random.Generator) -> Vector:
    """Unit vector (3,) of uniform direction."""
    vector = rng.normal(size=3)
    axis: Vector = vector / np.linalg.norm(vector)
    return axis


def image_of(model: ThreeMarkerModel, pose: Matrix) -> Matrix:
    """Normalised image (n, 2) of the markers, whether or not the detector is that large."""
    return central_projection(model.markers.points_m @ pose[:3].T + pose[3])


def small_angle_errors(
    model: ThreeMarkerModel, range_m: float, angle_rad: float, runs: int, seed: int, *, passes: int = 1
) -> tuple[Vector, Vector]:
    """Attitude errors (runs,) rad and position errors (runs,) m of the small-angle solution, no noise.

    The true attitude is off the nominal one by the angle, about a random axis.
    """
    rng = np.random.default_rng(seed)
    attitude, position = np.empty(runs), np.empty(runs)
    for k in range(runs):
        truth = random_pose(model, range_m, angle_rad * random_axis(rng), rng)
        pose = small_angle(
            image_of(model, truth), model.markers.points_m, model.view.dcm_cam_from_target, passes=passes
        )
        error = pose_error(truth, pose)
        attitude[k], position[k] = np.linalg.norm(error[3:]), np.linalg.norm(error[:3])
    return attitude, position


def depth_iteration_success(
    model: ThreeMarkerModel, ranges_m: tuple[float, ...], largest_rad: float, runs: int, seed: int
) -> float:
    """Share of random views in which the depth iteration, from equal depths, reaches the true distances."""
    rng = np.random.default_rng(seed)
    points, reached = model.markers.points_m[:3], 0
    for k in range(runs):
        range_m = ranges_m[k % len(ranges_m)]
        truth = random_pose(model, range_m, rng.uniform(0.0, largest_rad) * random_axis(rng), rng)
        distance = np.linalg.norm(points @ truth[:3].T + truth[3], axis=-1)
        d, _ = depth_iteration(unit_rays(image_of(model, truth)[:3]), points, np.full(3, range_m))
        reached += bool(np.abs(d - distance).max() < 1e-6 * range_m)
    return reached / runs


def mean_number_of_poses(
    model: ThreeMarkerModel, ranges_m: tuple[float, ...], largest_rad: float, runs: int, seed: int
) -> float:
    """Mean number of poses from which three markers look as they do in random views: the real roots of the quartic."""
    rng = np.random.default_rng(seed)
    points, found = model.markers.points_m[:3], 0
    for k in range(runs):
        range_m = ranges_m[k % len(ranges_m)]
        truth = random_pose(model, range_m, rng.uniform(0.0, largest_rad) * random_axis(rng), rng)
        found += len(p3p(unit_rays(image_of(model, truth)[:3]), points))
    return found / runs


def scaled_orthography(xy: Matrix, points_m: Matrix) -> Stack:
    """Both attitudes (2, 3, 3) dcm_cam_from_target that an image (3, 2) of markers (3, 3) has if all have one depth.

    With the markers in axes e of their own plane the image is A = B / depth, B the first two rows of the attitude's
    columns e_1, e_2; of a unit vector's two images the longer one is not foreshortened, so that 1 / depth is A's larger
    singular value. The third row makes the columns unit vectors at a right angle, with either sign.
    """
    a, b = points_m[1] - points_m[0], points_m[2] - points_m[0]
    normal = np.cross(a, b)
    e = np.stack([a / np.linalg.norm(a), np.cross(normal, a) / np.linalg.norm(np.cross(normal, a))])
    e = np.vstack([e, np.cross(e[0], e[1])])
    in_plane = np.column_stack([e[:2] @ a, e[:2] @ b])
    A = np.column_stack([xy[1] - xy[0], xy[2] - xy[0]]) @ np.linalg.inv(in_plane)
    B = A / np.linalg.svd(A, compute_uv=False)[0]
    depth = np.sqrt(np.maximum(0.0, 1.0 - np.sum(B**2, axis=0)))
    depth[1] *= -1.0 if B[:, 0] @ B[:, 1] > 0.0 else 1.0
    columns = [np.vstack([B, sign * depth]).T for sign in (1.0, -1.0)]
    return np.stack([np.column_stack([*c, np.cross(c[0], c[1])]) @ e for c in columns])


def scaled_orthography_errors(
    model: ThreeMarkerModel, range_m: float, angle_rad: float, runs: int, seed: int
) -> Vector:
    """Attitude errors (runs,) rad of the better of both attitudes by scaled orthography, no noise, three markers.

    The target is on the boresight: off it scaled orthography errs by the angle of the line of sight as well.
    """
    rng = np.random.default_rng(seed)
    out = np.empty(runs)
    for k in range(runs):
        truth = random_pose(model, range_m, angle_rad * random_axis(rng), rng)
        truth[3, :2] = 0.0
        both = scaled_orthography(image_of(model, truth)[:3], model.markers.points_m[:3])
        out[k] = min(float(np.linalg.norm(rotation_vector_between(truth[:3], turn))) for turn in both)
    return out


def pose_trials(model: ThreeMarkerModel, range_m: float, runs: int, seed: int, *, noise: float = 1.0) -> PoseTrials:
    """Measure noisy random views at one range; attitudes are drawn from the model's expected view.

    noise: of the spots, in units of the camera's spot noise; the reported covariance is that of the model.
    """
    rng = np.random.default_rng(seed)
    error, nees = np.full((runs, 6), np.nan), np.full(runs, np.nan)
    status = np.empty(runs, dtype=np.int64)
    for k in range(runs):
        truth = random_pose(model, range_m, model.view.attitude_sigma_rad * rng.normal(size=3), rng)
        spots = project(model.markers.points_m @ truth[:3].T + truth[3], model.camera).spots_px
        result = measure(spots + noise * model.camera.spot_noise_px * rng.normal(size=spots.shape), model)
        status[k] = int(result.status)
        if result.ok:
            turn = rotation_vector_between(truth[:3], result.dcm_cam_from_target)
            error[k] = np.concatenate([truth[3] - result.position_m, turn])
            nees[k] = error[k] @ np.linalg.solve(result.covariance, error[k])
    return PoseTrials(error, nees, status)
