"""Poses that explain an image, where the marker filter asks for them: to start from, or beside those it has."""

from dataclasses import replace

import numpy as np

from relnav.dynamics.error_state import POSE
from relnav.mission import VisionMission
from relnav.navigation.observation.marker_poses import add_uncovered, open_trial, roots, state_of, twins, view_at
from relnav.navigation.pose_call import Event
from relnav.navigation.pose_filter import NEW_ROOTS
from relnav.navigation.pose_memory import PoseMemory
from relnav.navigation.pose_propagation import is_wide
from relnav.navigation.status import OUT_OF_VIEW


def look_for_roots(m: PoseMemory, mission: VisionMission, event: Event, wants: int) -> None:
    """Open a trial on the poses that explain an image, or take up those that no hypothesis covers."""
    mission, running = mission_as_told(mission, event), m.clock["running"] > 0
    effects = m.bank_sensitivities[0]
    keeps = running and (wants == NEW_ROOTS or is_wide(m.bank[0], effects[m.lasting["shown"] :]))
    believed = (state_of(m.bank[0], np.zeros((0, POSE))), effects.copy()) if keeps else None
    own = event.covariance_px2 if len(event.covariance_px2) else None
    spots = np.where(np.isfinite(event.spots_px).all(axis=1, keepdims=True), event.spots_px, np.nan)
    mount, chaser = mission.camera.dcm_cam_from_chaser, event.dcm_chaser_from_lvlh
    near = [mount @ chaser @ mission.target.dcm_target_from_lvlh.T]
    if running:
        near.append(mount @ chaser @ m.bank[0]["dcm"])
    elapsed, rate_sigma = event.t_s - float(m.clock["begun"]), mission.filter.initial_rate_sigma_rad_s
    view = view_at(mission.view, elapsed, rate_sigma)
    # the poses of a trial begin as equals: of these the view as it is stated decides
    model = replace(mission, view=view) if wants == NEW_ROOTS else mission
    found, used, contradicted = roots(spots, own, chaser, model, believed, near, view, event.t_s)
    if wants == NEW_ROOTS:
        add_uncovered(m, found + twins(m, model, chaser), view.dcm_cam_from_target)
    elif found:
        open_trial(m, found, used)
    elif contradicted:
        m.result["alarm"] |= OUT_OF_VIEW


def mission_as_told(mission: VisionMission, event: Event) -> VisionMission:
    """The mission with what an event says of the chaser's attitude."""
    noise, sigma = event.attitude_noise_rad, event.attitude_sigma_rad
    return replace(mission, chaser=replace(mission.chaser, attitude_noise_rad=noise, attitude_sigma_rad=sigma))
