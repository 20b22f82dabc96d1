"""Every pose that explains the spots of labelled markers, each with its covariance, and which one the prior means."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from relnav.arrays import Matrix, Stack, Vector, one_piece
from relnav.geometry.rotation_vector import rotation_vector_between
from relnav.sensors.three_marker.roots import (
    MISFIT,
    MOST_ROOTS,
    ROOT,
    WORK,
    explain_into,
    explains_its_error,
    rank_into,
)
from relnav.sensors.three_marker.sensor import MarkerCamera, View


@dataclass(frozen=True)
class Pose:
    """Position and attitude of the target relative to the camera.

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


Explained: TypeAlias = tuple[Matrix, Matrix, float]
"""A pose (4, 3) that explains an image, its information (6, 6) and its misfit."""


def explaining_poses(xy: Matrix, weights: Matrix, points_m: Matrix) -> list[Explained]:
    """Every pose (4, 3) that explains the normalised image (n, 2) of n >= 3 markers, its information and its misfit.

    P3P of the widest triples, real solutions and pairs that noise may have made complex, each refined on all spots.
    """
    poses, information, misfit, work = scratch()
    image, information_of_spots, points = whole(xy, weights, points_m)
    count = explain_into(image, information_of_spots, points, poses, information, misfit, work)
    return [(poses[k], information[k], float(misfit[k])) for k in range(count)]


def pose_error(pose: Matrix, reference: Matrix) -> Vector:
    """(dr, dtheta) (6,) of a pose (4, 3) about another: r - r_ref, and v with C = C_ref exp([v x])."""
    return np.concatenate([pose[3] - reference[3], rotation_vector_between(pose[:3], reference[:3])])


def belief_of(prior: Pose | View) -> Vector:
    """A prior as the compiled code reads it (`roots.BELIEF`)."""
    if isinstance(prior, View):
        return prior.belief
    parts = (prior.dcm_cam_from_target, prior.position_m, prior.covariance, np.ones(1))
    return np.concatenate([np.ravel(part) for part in parts])


def rank_roots(found: list[Explained], prior: Pose | View) -> list[Root]:
    """The roots in the order in which spots and prior together believe in them."""
    if not found:
        return []
    poses, information, misfit = (np.array(part, dtype=np.float64) for part in zip(*found, strict=True))
    return roots_of(ranked_rows(poses, information, misfit, len(found), belief_of(prior), np.empty((WORK, 6, 6)))[0])


def ranked_rows(
    poses: Stack, information: Stack, misfit: Vector, count: int, belief: Vector, work: Stack
) -> tuple[Matrix, float]:
    """The first `count` poses as rows (count, 50), the most credible first, and the gap of `rank_into`."""
    rows = np.empty((count, ROOT))
    gap = rank_into(poses, information, misfit, count, belief, work, rows)
    return rows, gap


def roots_of(rows: Matrix) -> list[Root]:
    """Rows as roots, which share their memory: it is read-only from here on."""
    rows.setflags(write=False)
    n = len(rows)
    positions, dcms, covariances = rows[:, 9:12], rows[:, :9].reshape(n, 3, 3), rows[:, 12:MISFIT].reshape(n, 6, 6)
    return [
        Root(Pose(position, dcm, covariance), misfit, score)
        for position, dcm, covariance, (misfit, score) in zip(
            positions, dcms, covariances, rows[:, MISFIT:].tolist(), strict=True
        )
    ]


def is_gaussian(root: Root, xy: Matrix, weights: Matrix, points_m: Matrix) -> bool:
    """Whether the spots' misfit about a root is what its covariance says (`roots.explains_its_error`)."""
    pose = root.pose
    parts = (pose.dcm_cam_from_target.ravel(), pose.position_m, pose.covariance.ravel(), [root.misfit, root.score])
    image, information, points = whole(xy, weights, points_m)
    return bool(explains_its_error(np.concatenate(parts), image, information, points, np.empty((WORK, 6, 6))))


def scratch() -> tuple[Stack, Stack, Vector, Stack]:
    """Poses, information, misfits and work of `roots.explain_into`."""
    most = MOST_ROOTS + 1
    return np.empty((most, 4, 3)), np.empty((most, 6, 6)), np.empty(most), np.empty((WORK, 6, 6))


def whole(xy: Matrix, weights: Matrix, points_m: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Image, information and points as compiled code takes them."""
    return one_piece("xy", xy), one_piece("weights", weights), one_piece("points_m", points_m)


def root_gap_rad(roots: list[Root]) -> float:
    """Angle from the first root to the nearest other one; infinite if there is no other."""
    angles = [
        float(np.linalg.norm(rotation_vector_between(r.pose.dcm_cam_from_target, roots[0].pose.dcm_cam_from_target)))
        for r in roots[1:]
    ]
    return min(angles, default=math.inf)
