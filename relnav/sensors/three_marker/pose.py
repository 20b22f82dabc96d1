"""Every pose that explains the spots of labelled markers, each with its covariance, and which one the prior means."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.geometry.p3p import p3p
from relnav.geometry.pose_refinement import BEHIND, WORK_ROWS, invertible, pose_information, refine_pose
from relnav.geometry.rotation_vector import rotation_vector_between, turn_by_rotation_vector
from relnav.sensors.three_marker.camera import unit_rays
from relnav.sensors.three_marker.sensor import MarkerCamera, View

_MOST_TRIPLES = 4
_TRIED_SIGMA = 3.0
_SAME_POSE = 1e-3  # in units of chi-square: two results of Gauss-Newton this near are one


@dataclass(frozen=True)
class Pose:
    """Where the target is and how it is turned, seen from the camera.

    Attributes
    ----------
    position_m : (3,)
        The target's centre of mass, camera axes: r of p = C s + r.
    dcm_cam_from_target : (3, 3)
        C, v_cam = C v_target.
    covariance : (6, 6)
        Of (position error in camera axes, m; attitude error in target axes, rad), the true attitude being
        C exp([error x]).
    """

    position_m: Vector
    dcm_cam_from_target: Matrix
    covariance: Matrix

    @property
    def camera_in_target_m(self) -> Vector:
        """The camera seen from the target's centre of mass, target axes (3,) m."""
        position: Vector = -(self.dcm_cam_from_target.T @ self.position_m)
        return position

    @property
    def attitude_sigma_rad(self) -> Vector:
        """1-sigma of the attitude about the target's axes (3,)."""
        return np.sqrt(np.diag(self.covariance)[3:])

    @property
    def range_sigma_m(self) -> float:
        """1-sigma of the distance from camera to target."""
        along = self.position_m / np.linalg.norm(self.position_m)
        return float(np.sqrt(along @ self.covariance[:3, :3] @ along))

    def seen_from_chaser(self, camera: MarkerCamera) -> "Pose":
        """The same from the chaser's centre of mass in chaser axes, eq. (1b): v_chaser = C_BK v_cam + c_B."""
        turn = camera.dcm_cam_from_chaser.T
        spread = np.eye(6)
        spread[:3, :3] = turn
        return Pose(
            turn @ self.position_m + np.array(camera.position_m),
            turn @ self.dcm_cam_from_target,
            spread @ self.covariance @ spread.T,
        )


@dataclass(frozen=True)
class Root:
    """One pose that explains the spots.

    Attributes
    ----------
    pose : Pose
        With the covariance of the spots' noise alone.
    misfit : float
        Chi-square of the spots about it; zero for three spots.
    score : float
        Minus twice the logarithm of its probability, up to a constant common to all roots.
    """

    pose: Pose
    misfit: float
    score: float


def triples(points_m: Matrix) -> list[tuple[int, int, int]]:
    """Up to four triples of points, those that span the largest triangles first."""
    chosen = list(itertools.combinations(range(len(points_m)), 3))

    def area(triple: tuple[int, int, int]) -> float:
        first, second, third = (points_m[i] for i in triple)
        return float(np.linalg.norm(np.cross(second - first, third - first)))

    return sorted(chosen, key=area, reverse=True)[:_MOST_TRIPLES]


def refined(xy: Matrix, weights: Matrix, points_m: Matrix, start: Matrix) -> tuple[Matrix, Matrix, float] | None:
    """Pose (4, 3), information (6, 6) and misfit after Gauss-Newton from a start (4, 3); None if a marker is behind.

    Where two solutions merge, a direction is not seen to first order: it is given the information of knowing nothing.
    """
    pose, information = np.array(start), np.empty((6, 6))
    steps, misfit = refine_pose(points_m, xy, weights, pose, information, np.empty((WORK_ROWS, 6, 6)))
    if steps == BEHIND:
        return None
    if not invertible(information):
        information[3:, 3:] += np.eye(3) / math.pi**2
    return (pose, information, float(misfit)) if invertible(information) else None


def explaining_poses(xy: Matrix, weights: Matrix, points_m: Matrix) -> list[tuple[Matrix, Matrix, float]]:
    """Every pose (4, 3) that explains the normalised image (n, 2) of n >= 3 markers, its information and its misfit.

    P3P of the widest triples, real solutions and pairs that noise may have made complex, each refined on all spots.
    """
    rays = unit_rays(xy)
    starts = [
        pose for triple in triples(points_m) for pose in p3p(rays[list(triple)], points_m[list(triple)], near=True)
    ]
    found: list[tuple[Matrix, Matrix, float]] = []
    for candidate in starts:
        result = refined(xy, weights, points_m, candidate)
        if result is not None and not any(_same(result, other) for other in found):
            found.append(result)
    return found


def pose_error(pose: Matrix, reference: Matrix) -> Vector:
    """(dr, dtheta) (6,) of a pose (4, 3) about another: r - r_ref, and v with C = C_ref exp([v x])."""
    return np.concatenate([pose[3] - reference[3], rotation_vector_between(pose[:3], reference[:3])])


def _same(one: tuple[Matrix, Matrix, float], other: tuple[Matrix, Matrix, float]) -> bool:
    difference = pose_error(one[0], other[0])
    return bool(difference @ other[1] @ difference < _SAME_POSE) and bool(np.abs(difference[3:]).max() < 0.1)


def score(pose: Pose, misfit: float, prior: Pose | View) -> float:
    """Minus twice the log-probability of a root under spots and prior, up to a constant.

    The integral of likelihood times prior about the root, both Gaussian: misfit + d^T S^-1 d + ln |S| - ln |R| with R
    the root's own covariance, S = R + P, d its distance from the prior. A root with a wide covariance of its own is
    thereby not ruled out, and the determinants are the share of the prior that leads to such spots. A View says nothing
    of the position: S and d are then those of the attitude alone.
    """
    turn = rotation_vector_between(pose.dcm_cam_from_target, prior.dcm_cam_from_target)
    if isinstance(prior, View):
        difference = turn
        covariance = pose.covariance[3:, 3:] + prior.attitude_sigma_rad**2 * np.eye(3)
    else:
        difference = np.concatenate([pose.position_m - prior.position_m, turn])
        covariance = pose.covariance + prior.covariance
    distance = float(difference @ np.linalg.solve(covariance, difference))
    own = float(np.linalg.slogdet(pose.covariance)[1])
    return misfit + distance + float(np.linalg.slogdet(covariance)[1]) - own


def rank_roots(found: list[tuple[Matrix, Matrix, float]], prior: Pose | View) -> list[Root]:
    """The roots in the order in which spots and prior together believe in them."""
    roots = []
    for pose, information, misfit in found:
        value = Pose(pose[3].copy(), pose[:3].copy(), np.asarray(np.linalg.inv(information), dtype=np.float64))
        roots.append(Root(value, misfit, score(value, misfit, prior)))
    return sorted(roots, key=lambda root: root.score)


def is_gaussian(root: Root, xy: Matrix, weights: Matrix, points_m: Matrix) -> bool:
    """Whether the spots' misfit about a root is what its covariance says: k^2 within a factor of 2, k sigma away.

    Tried along the least certain attitude, both ways. Near a danger cylinder or a second root it is not, and the
    covariance then describes nothing.
    """
    pose = root.pose
    variances, axes = np.linalg.eigh(pose.covariance[3:, 3:])
    step = _TRIED_SIGMA * pose.covariance[:, 3:] @ axes[:, -1] / math.sqrt(float(variances[-1]))
    moved, spare = np.empty((4, 3)), np.empty((6, 6))
    for sign in (1.0, -1.0):
        turn_by_rotation_vector(pose.dcm_cam_from_target, sign * step[3:], moved)
        moved[3] = pose.position_m + sign * step[:3]
        rise = pose_information(points_m, xy, weights, moved, spare, np.empty(6)) - root.misfit
        if not 0.5 * _TRIED_SIGMA**2 < rise < 2.0 * _TRIED_SIGMA**2:
            return False
    return True


def root_gap_rad(roots: list[Root]) -> float:
    """Angle from the first root to the nearest other one; infinite if there is no other."""
    angles = [
        float(np.linalg.norm(rotation_vector_between(r.pose.dcm_cam_from_target, roots[0].pose.dcm_cam_from_target)))
        for r in roots[1:]
    ]
    return min(angles, default=math.inf)
