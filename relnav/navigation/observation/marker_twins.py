"""Other poses that look like the leading hypothesis, in every image: where a hypothesis of each begins.

All roots of three spots fit them exactly. The leading hypothesis knows its pose better than one image shows it, and
with it its twins: they are the other roots of the spots that it predicts, which have no noise. Two poses that are less
apart than the noise of an image are still told apart by this. A twin moves as its image demands: velocity and rate
follow from the roots of two predicted images.
"""

from dataclasses import replace

import numpy as np

from relnav.arrays import Matrix
from relnav.dynamics.error_state import POSE, RATE, THETA
from relnav.dynamics.relative_motion import frame_rate
from relnav.dynamics.rigid_body import lvlh_rate
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import VisionMission
from relnav.navigation.memory import orbit_values
from relnav.navigation.pose_state import PoseState, camera_pose, state_from_pose
from relnav.sensors.three_marker.camera import image_of
from relnav.sensors.three_marker.measure import measure

APART_S = 0.1
"""Between the two predicted images: a target at a degree a second turns by 0.1 deg in it."""


def twins_of(
    lead: PoseState, t_s: float, mission: VisionMission, dcm_chaser_from_lvlh: Matrix, least_credible: float
) -> list[PoseState]:
    """States whose images are those of the leading one, with its covariance.

    mission: its view is the expected one by now. One that misfits the spots, or is farther from the expected attitude
    or rate, than least_credible (chi-square) allows is left out.
    """
    at_camera, view = mission.camera.dcm_cam_from_chaser @ dcm_chaser_from_lvlh, mission.view

    def is_expected(pose: PoseState) -> bool:
        off = rotation_vector_between(at_camera @ pose.dcm_lvlh_from_target, view.dcm_cam_from_target)
        return float(off @ off) <= least_credible * view.attitude_sigma_rad**2

    poses = _poses_like(lead, t_s, mission, dcm_chaser_from_lvlh, least_credible)
    others = sorted(poses, key=lambda pose: _angle(pose, lead))[1:]  # the first is the leading one's own
    twins = [pose for pose in others if is_expected(pose)]
    if not twins:
        return []
    n = frame_rate(orbit_values(mission.orbit), t_s)
    slow = lead.rate_rad_s - lvlh_rate(lead.dcm_lvlh_from_target, n)
    moved = lead.motion.copy()
    moved[:3] += APART_S * lead.motion[3:]
    later = replace(lead, motion=moved, dcm_lvlh_from_target=turned(lead.dcm_lvlh_from_target, APART_S * slow))
    soon = _poses_like(later, t_s + APART_S, mission, dcm_chaser_from_lvlh, least_credible)
    out = []
    for pose in twins:
        following = min(soon, key=lambda other: _angle(other, pose), default=pose)
        motion, dcm = pose.motion.copy(), pose.dcm_lvlh_from_target
        motion[3:] = (following.motion[:3] - pose.motion[:3]) / APART_S
        turn = rotation_vector_between(following.dcm_lvlh_from_target, dcm) / APART_S
        fast = turn / mission.filter.initial_rate_sigma_rad_s
        if fast @ fast <= least_credible:
            out.append(PoseState(motion, dcm, turn + lvlh_rate(dcm, n), _in_axes(dcm, lead)))
    return out


def _in_axes(dcm_lvlh_from_target: Matrix, lead: PoseState) -> Matrix:
    """Covariance (12, 12) of the leading one, the target's axes being those of another attitude."""
    errors, across = np.eye(POSE), dcm_lvlh_from_target.T @ lead.dcm_lvlh_from_target
    errors[THETA:RATE, THETA:RATE] = errors[RATE:, RATE:] = across
    out: Matrix = errors @ lead.covariance @ errors.T
    return out


def _poses_like(
    state: PoseState, t_s: float, mission: VisionMission, dcm_chaser_from_lvlh: Matrix, most_misfit: float
) -> list[PoseState]:
    """All poses that look like a state, itself among them, at rest."""
    pose = camera_pose(state, mission, dcm_chaser_from_lvlh)
    spots, _ = image_of(mission.markers.points_m @ pose[:3].T + pose[3], mission.camera)
    found = measure(spots, mission).roots
    poses = [root.pose for root in found if root.misfit <= most_misfit]
    return [state_from_pose(pose, mission, dcm_chaser_from_lvlh, t_s=t_s) for pose in poses]


def _angle(one: PoseState, other: PoseState) -> float:
    return float(np.linalg.norm(rotation_vector_between(one.dcm_lvlh_from_target, other.dcm_lvlh_from_target)))
