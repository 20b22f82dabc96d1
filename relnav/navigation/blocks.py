"""What the beacon filter and the marker filter estimate and consider, block by block.

The estimated errors come first, as `dynamics/error_state.py` orders them; those that last stand behind, one row of a
filter's `sensitivities` each. What `observation/` writes of them stands in the same order.
"""

import math

import numpy as np

from relnav.dynamics.error_state import MOTION, POSE
from relnav.dynamics.inertia_error import ENTRIES, INERTIA_ENTRIES
from relnav.estimation.state_layout import Role, StateLayout, stacked
from relnav.mission import Model, VisionMission

NODES = 4
"""Along each side of the detector's field of lasting errors."""
FIELD_ERRORS = 2 * NODES * NODES
ATTITUDE_ERRORS = 3
TOLERANCES_SHARED = 7
"""Tolerances that all beacons share: the focal length, three turns of the camera, three of the beacons."""

CHASER_ATTITUDE, MOUNTING, FOCAL_LENGTH, PLACEMENT = 0, 3, 6, 7
"""Where each begins among the lasting errors of markers; the first three always stand there. Those of the target's
inertia, if it is off, are the last: no image shows them."""

OF_IMAGE = math.nan

Sizes = list[tuple[str, int, float, Role]]


def beacon_layout(model: Model, method: str) -> StateLayout:
    """The errors of a beacon filter; method: "fix" or "spots".

    The attitude's turns what `spots` see of a state; of a `fix` it turns the arm to the camera.
    """
    blocks: Sizes = [
        ("position", 3, OF_IMAGE, "estimated"),
        ("velocity", 3, model.filter.initial_velocity_sigma_m_s, "estimated"),
    ]
    tolerances = model.tolerances if model.tolerances is not None and model.tolerances.considered else None
    if tolerances is not None or model.calibration is not None:
        blocks.append(("detector_field", FIELD_ERRORS, model.lasting_spot_sigma_m, "considered"))
    if tolerances is not None or (model.attitude.sigma_rad > 0.0 and attitude_counts(model, method)):
        blocks.append(("chaser_attitude", ATTITUDE_ERRORS, model.attitude.sigma_rad, "considered"))
    if tolerances is not None:
        placed = 3 * len(model.beacons_lvlh_m)
        blocks += [
            ("focal_length", 1, tolerances.focal_length_relative_sigma, "considered"),
            ("camera_mounting", 3, tolerances.camera_mounting_sigma_rad, "considered"),
            ("beacon_mounting", 3, tolerances.beacon_mounting_sigma_rad, "considered"),
            ("beacon_placement", placed, tolerances.beacon_placement_sigma_m, "considered"),
        ]
    return stacked(blocks)


def marker_layout(mission: VisionMission) -> StateLayout:
    """The errors of a marker filter."""
    settings, tolerances = mission.filter, mission.tolerances
    blocks: Sizes = [
        ("position", 3, OF_IMAGE, "estimated"),
        ("velocity", 3, settings.initial_velocity_sigma_m_s, "estimated"),
        ("target_attitude", 3, OF_IMAGE, "estimated"),
        ("target_rate", 3, settings.initial_rate_sigma_rad_s, "estimated"),
        ("chaser_attitude", 3, mission.chaser.attitude_sigma_rad, "considered"),
    ]
    if tolerances is not None and tolerances.considered:
        placed = 3 * len(mission.markers.positions_m)
        blocks += [
            ("camera_mounting", 3, tolerances.camera_mounting_sigma_rad, "considered"),
            ("focal_length", 1, tolerances.focal_length_relative_sigma, "considered"),
            ("marker_placement", placed, tolerances.marker_placement_sigma_m, "considered"),
        ]
    if inertia_errors(mission) > 0:
        sigma = mission.target.inertia_sigma_kg_m2
        blocks += [(f"inertia_{'xyz'[i]}{'xyz'[j]}", 1, sigma[i][j], "considered") for i, j in INERTIA_ENTRIES]
    return stacked(blocks)


def attitude_counts(model: Model, method: str) -> bool:
    """Whether an error of the attitude moves the state: of a `fix`, only by the arm to the camera."""
    return method == "spots" or bool(np.any(model.camera_lever_cam_m))


def considered_errors(model: Model, method: str) -> tuple[int, int]:
    """Which of all lasting errors a beacon filter considers: from the first to before the last.

    Of them all, the detector's field stands first: without it the attitude's are those from `FIELD_ERRORS` on.
    """
    layout = beacon_layout(model, method)
    first = 0 if "detector_field" in layout.by_name else FIELD_ERRORS
    return first, first + layout.size - MOTION


def marker_considered(mission: VisionMission) -> int:
    """How many lasting errors a marker filter considers."""
    return marker_layout(mission).size - POSE


def marker_shown(mission: VisionMission) -> int:
    """How many of them images show by themselves: those of chaser, camera and markers, which come first."""
    return marker_considered(mission) - inertia_errors(mission)


def inertia_errors(mission: VisionMission) -> int:
    """How many entries of the target's inertia are taken as off: none, unless a sigma is stated."""
    return ENTRIES if np.any(mission.target.inertia_sigma_kg_m2) else 0
