"""Poses that explain one image, as hypotheses of `engine="filterpy"`: the sensor's closed form, the rest done anew."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Codes, Flags, Matrix
from relnav.estimation.gating import chi_square_limit
from relnav.geometry.linear_algebra import cross_matrix
from relnav.mission import VisionMission
from relnav.navigation.observation.marker_poses import WIDENED
from relnav.navigation.pose_filter import DROP
from relnav.navigation.reference.bank import Exposure, turn_between, turned_by
from relnav.navigation.reference.marker_rows import SEEN, MarkerOptics, PoseTrack
from relnav.navigation.reference.motion import rate_and_gravity
from relnav.sensors.three_marker.measure import measure
from relnav.sensors.three_marker.outcome import MISFIT_PROBABILITY
from relnav.sensors.three_marker.pose import Pose, Root


@dataclass(frozen=True)
class Found:
    """Hypotheses of an image, which markers they rest on (n,), whether one was left out for contradicting the view."""

    tracks: list[PoseTrack]
    used: Flags
    contradicted: bool


def find_poses(
    optics: MarkerOptics,
    mission: VisionMission,
    image: Exposure,
    believed: PoseTrack | None,
    near: Sequence[Matrix],
    view_sigma_rad: float,
) -> Found:
    """Hypotheses on the poses that explain an image and are not a million times less credible than the best.

    A pose farther from the expected view, and from every attitude of `near` (dcm_cam_from_target), than chance allows
    to view_sigma_rad is none. believed: the hypothesis whose velocity they take.
    """
    own = image.covariances if len(image.covariances) else None
    spots = np.where(np.isfinite(image.spots).all(axis=1, keepdims=True), image.spots, np.nan)
    result = measure(spots, mission, spot_covariance_px2=own)
    used = np.array(result.labels) >= 0
    worst = chi_square_limit(1.0 - MISFIT_PROBABILITY, result.dof) if result.dof > 0 else math.inf
    tracks, contradicted = [], False
    roots = [_explained(optics, mission, image, root, np.flatnonzero(used), result.dof) for root in result.roots]
    best = min((root.score for root in roots), default=0.0)
    for root in roots:
        if root.score - best > DROP or root.misfit > worst:
            continue
        if any(_agrees(root.pose, dcm, view_sigma_rad) for dcm in (mission.view.dcm_cam_from_target, *near)):
            tracks.append(_track_on(optics, mission, image, root.pose, np.flatnonzero(used), believed, view_sigma_rad))
        else:
            contradicted = True
    return Found(tracks, used, contradicted)


def _explained(
    optics: MarkerOptics, mission: VisionMission, image: Exposure, root: Root, used: Codes, dof: int
) -> Root:
    """A root with the misfit that pose and lasting errors together leave: r^T (noise + slopes slopes^T)^-1 r."""
    if dof <= 0 or mission.tolerances is None or not mission.tolerances.considered:
        return root
    mount, back = mission.camera.dcm_cam_from_chaser, image.chaser.T
    place = mount.T @ root.pose.position_m + np.array(mission.camera.position_m)
    dcm, motion = back @ mount.T @ root.pose.dcm_cam_from_target, np.concatenate([-back @ place, np.zeros(3)])
    nothing = np.zeros((optics.considered, 12))
    at = PoseTrack(motion, dcm, np.zeros(3), np.zeros((12, 12)), nothing)
    expected, slopes = optics.derivatives(at, image.chaser, used)
    r, g = (image.spots[used] - expected).ravel(), optics.by_lasting(slopes, used)
    h = slopes[:, :, :6].reshape(len(r), 6)
    own = np.zeros((len(r), len(r)))
    for i, marker in enumerate(used):
        part = slice(2 * i, 2 * i + 2)
        own[part, part] = image.covariances[marker] if len(image.covariances) else optics.spot_noise**2 * np.eye(2)
    root_of = np.linalg.inv(np.linalg.cholesky(own + g @ g.T))
    free, _ = np.linalg.qr(root_of @ h, mode="complete")
    left = free[:, 6:].T @ root_of @ r
    misfit = float(left @ left)
    return replace(root, misfit=misfit, score=root.score + misfit - root.misfit)


def _agrees(pose: Pose, dcm: Matrix, sigma_rad: float) -> bool:
    off = turn_between(pose.dcm_cam_from_target, dcm)
    spread = pose.covariance[3:, 3:] + sigma_rad**2 * np.eye(3)
    return bool(off @ np.linalg.solve(spread, off) <= chi_square_limit(1.0 - MISFIT_PROBABILITY, 3))


def _track_on(
    optics: MarkerOptics,
    mission: VisionMission,
    image: Exposure,
    pose: Pose,
    used: Codes,
    believed: PoseTrack | None,
    view_sigma_rad: float,
) -> PoseTrack:
    """A hypothesis on a pose joined with the expected view: at rest in the turning frame, or as one believed."""
    settings, mount, back = mission.filter, mission.camera.dcm_cam_from_chaser, image.chaser.T
    spots = np.linalg.inv(pose.covariance)
    known = np.zeros((6, 6))
    known[3:, 3:] = np.eye(3) / view_sigma_rad**2
    joined = np.linalg.inv(spots + known)
    off = turn_between(mission.view.dcm_cam_from_target, pose.dcm_cam_from_target)
    shift = joined[:, 3:] @ off / view_sigma_rad**2
    in_cam = turned_by(pose.dcm_cam_from_target, shift[3:])
    lens = np.array(mission.camera.position_m)
    seen_at, place = (mount.T @ at + lens for at in (pose.position_m, pose.position_m + shift[:3]))  # chaser axes
    dcm = back @ mount.T @ in_cam
    by_pose = np.eye(6)
    by_pose[:3, :3] = -back @ mount.T
    of_spots = by_pose @ joined @ by_pose.T
    by_chaser = np.vstack([back @ cross_matrix(place), (mount.T @ in_cam).T])
    covariance = np.zeros((12, 12))
    covariance[np.ix_(SEEN, SEEN)] = WIDENED * of_spots + image.attitude_noise**2 * by_chaser @ by_chaser.T
    covariance[3:6, 3:6] = settings.initial_velocity_sigma_m_s**2 * np.eye(3)
    covariance[9:, 9:] = settings.initial_rate_sigma_rad_s**2 * np.eye(3)
    motion, considered = np.concatenate([-back @ place, np.zeros(3)]), np.zeros((optics.considered, 12))
    track = PoseTrack(motion, dcm, -rate_and_gravity(mission.orbit, image.t_s)[0] * dcm[1], covariance, considered)
    shown = np.concatenate([-back @ seen_at, np.zeros(3)])  # by the spots alone, whose covariance was joined
    unjoined = replace(track, motion=shown, dcm=back @ mount.T @ pose.dcm_cam_from_target)
    _, slopes = optics.derivatives(unjoined, image.chaser, used)
    left = optics.by_lasting(slopes, used).reshape(len(used), 2, -1)
    for i, marker in enumerate(used):
        own = image.covariances[marker] if len(image.covariances) else optics.spot_noise**2 * np.eye(2)
        considered[:, SEEN] += left[i].T @ np.linalg.solve(own, slopes[i, :, :6]) @ of_spots
    if believed is not None:  # the velocity is common to all: unknown, its width alone would cost the odds
        motion[3:], considered[:, 3:6] = believed.motion[3:], believed.considered[:, 3:6]
        covariance[3:6, 3:6] = WIDENED * believed.covariance[3:6, 3:6]
    return track
