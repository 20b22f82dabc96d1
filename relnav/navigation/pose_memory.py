"""The memory of the marker filter by names: as `memory.py`, for a state of position, velocity, attitude and rate.

Twelve errors (drho, dv, theta, dw) about motion (rho, v; `lvlh_ccsds`), C = dcm_lvlh_from_target and w (the target's
inertial rate, target axes), the true attitude being C exp([theta x]).
"""

from typing import Annotated, NamedTuple

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.memory_layout import Layout
from relnav.dynamics.error_state import MOTION, POSE, ROTATION
from relnav.dynamics.inertia_error import ENTRIES
from relnav.dynamics.rigid_body import BODY_ROWS, RigidBody
from relnav.estimation.gating import gate_limits
from relnav.estimation.monitors import WATCH
from relnav.estimation.returning import RETURNING
from relnav.estimation.rows import group_type
from relnav.mission import VisionMission
from relnav.navigation.blocks import inertia_errors, marker_considered, marker_shown
from relnav.navigation.memory import MOTION_MODEL, STEP, WATCHED, fill, watch_anew, write_motion_model
from relnav.navigation.pose_bending import POSE_BENT

SEEN = 6
"""Position and attitude: of the errors, what an image shows."""
MOST_POSES = 8
"""Hypotheses that a bank holds."""

_F, _I = np.float64, np.int64

CAMERA = np.dtype(
    [
        ("focal_length", _F, 2),
        ("principal_point", _F, 2),
        ("size", _F, 2),
        ("noise", _F),
        ("distortion", _F, 5),
        ("distorts", _I),
        ("mount", _F, (3, 3)),  # dcm_cam_from_chaser
        ("lens", _F, 3),  # from the chaser's centre of mass, chaser axes
        ("chaser", _F, (3, 3)),  # dcm_chaser_from_lvlh at the image
        ("attitude_noise", _F),  # of the chaser's attitude, new at every image
        ("cam_from_lvlh", _F, (3, 3)),
    ]
)
BODY = np.dtype(
    [
        ("values", _F, (BODY_ROWS, 3)),  # as `dynamics.rigid_body` describes them
        ("noise_density", _F),
        ("phi", _F, (ROTATION, ROTATION)),
        ("noise", _F, (ROTATION, ROTATION)),
        ("factors", _F, (ROTATION, ROTATION)),
        ("work", _F, (50, ROTATION)),
        ("inertia_errors", _I),  # the last of the lasting errors; the rest is used where there are any
        ("inertia_sigma", _F, (3, 3)),
        ("before", _F, (3, ENTRIES)),  # what they do to the angular acceleration, at both ends of a piece
        ("after", _F, (3, ENTRIES)),
        ("other", _F, (BODY_ROWS, 3)),  # scratch: a body of another inertia
        ("pushed", _F, (ENTRIES, ROTATION)),  # what one sigma of each has done in a step
        ("piece_phi", _F, (ROTATION, ROTATION)),
        ("piece_noise", _F, (ROTATION, ROTATION)),
    ]
)
POSE_TRACK = np.dtype(
    [
        ("motion", _F, MOTION),
        ("dcm", _F, (3, 3)),
        ("rate", _F, 3),
        ("state", _F, POSE),  # errors about these, zero between updates
        ("ld", _F, (POSE, POSE)),
        ("score", _F),
        ("doubt", _F),
        ("prior", _F),
        ("added", _F),
    ]
)
"""One hypothesis; score: minus twice its log-likelihood, doubt: how much of that may be undeserved; the past fading.

prior: what was known against it before, which does not fade; added: when it was taken up beside others, -inf for those
of a start.
"""
POSE_GROUP = group_type(POSE)
POSE_SCRATCH = np.dtype(
    [
        ("covariance", _F, (MOTION, MOTION)),
        ("density", _F, (3, 3)),
        ("six", _F, (MOTION, MOTION)),
        ("phi", _F, (POSE, POSE)),
        ("noise", _F, (POSE, POSE)),
        ("seen_covariance", _F, (SEEN, SEEN)),
        ("pose", _F, (4, 3)),
        ("projection", _F, (2, 3)),
        ("point", _F, 3),
        ("bend", _F, (2, 2)),
        ("turned", _F, (3, 3)),
        ("error", _F, POSE),
        ("order", _I, 2 * MOST_POSES),
        ("fell", _I, MOST_POSES),  # 1: of `spare`, one that the bank has left out as far behind
        ("lead_used", _I),  # spots of the latest image that the leading hypothesis has used
        ("lead_width", _F),  # and ln |S| of them
        ("bending", _F),  # of the latest image: ln |R| by the second order of the errors
    ]
)
LASTING = np.dtype([("attitude", _F), ("focal_length", _F), ("mounting", _F), ("placement", _F), ("shown", _I)])
"""1-sigma of lasting errors: chaser's attitude, focal length (relative), camera's mounting, each marker's place.

shown: how many of all an image shows by itself, which these are; those of the target's inertia stand behind them.
"""
POSE_CLOCK = np.dtype(
    [
        ("t", _F),
        ("renewed", _F),  # when roots were last looked for; -inf: they are to be, at once
        ("begun", _F),  # of the first event
        ("confirmed", _F),  # when the bank was
        ("blurred", _F),  # when the leading hypothesis was last too wide to tell roots apart
        ("doubted", _F),  # when it was last contested (`pose_epoch.is_contested`); -inf: never since it was confirmed
        ("running", _I),  # hypotheses of the bank; 0: no state
        ("trial", _I),  # of the trial
        ("rejected", _I),
        ("agreed", _I),  # images that have confirmed the trial
        ("beaten", _I),  # where the next pose that is beaten is kept
        ("markers", _I),
        ("watched", _F),  # time of the latest image under watch
        ("used", _F),  # and of the latest that was used
        ("window", _F),  # when the witness began to compare images
        ("compared", _I),  # images since
        ("over", _I),  # the witness agrees again
        ("windows", _I),  # that it has compared
        ("leader", _F),  # `added` of the hypothesis under watch
        ("usurped", _F),  # since when another one leads; NaN: it does not
        ("denied", _I),  # 1: two spots bear a pose that another one contradicts, image after image
    ]
)
SPOT = np.dtype(
    [
        ("sums", _F, 2),  # of what it is off the witness'
        ("means", _F, (3, 2)),  # of that in the last three windows, the latest first; NaN: not known
        ("count", _F),  # of how many images
        ("speed", _F),  # px/s, as predicted
        ("denied", _I),  # images in a row that have refused it, others being used
        *RETURNING,
    ]
)
BEATEN = np.dtype([("dcm", _F, (3, 3)), ("t", _F)])
"""A pose that the leading hypothesis has beaten: its attitude seen from the leading one's, and when."""
NEWEST, OLDER, WITNESS = 0, 1, 2
"""Tracks as they were, by which it is told whether a fault is over (`marker_monitors.py`)."""
POSE_RESULT = np.dtype(
    [("nis", _F), ("dof", _I), ("status", _I), ("used", _I), ("seen", _I), ("wants", _I), ("alarm", _I)]
)
POSE_FIXED = np.dtype(
    [
        ("restart_after", _I),
        ("considered", _I),  # how many lasting errors
        ("evidence", _I),  # one more: rows of what images have told of them
        ("few_markers_limit", _F),
        ("camera", CAMERA),
        ("lasting", LASTING),
        ("body", BODY),
        ("motion", MOTION_MODEL),
        ("step", STEP),
        ("scratch", POSE_SCRATCH),
        ("work", POSE_TRACK),
        ("best", POSE_TRACK),
        ("joint", POSE_TRACK),  # scratch: a hypothesis with what its inertia has done to it in its factors
        ("clock", POSE_CLOCK),
        ("result", POSE_RESULT),
        ("watch", WATCH),
    ]
)


class PoseMemory(NamedTuple):
    """A marker filter's memory by names (n markers, m lasting errors)."""

    fixed: Record
    camera: Record
    lasting: Record
    body: Record
    motion: Record
    step: Record
    scratch: Record
    work: Record
    best: Record
    joint: Record
    clock: Record
    result: Record
    watch: Record
    bank: Annotated[Record, POSE_TRACK, MOST_POSES]  # the most credible first
    trial: Annotated[Record, POSE_TRACK, MOST_POSES]
    spare: Annotated[Record, POSE_TRACK, MOST_POSES]  # scratch
    bents: Annotated[Record, POSE_BENT, MOST_POSES]  # of the bank, since the latest image
    beaten: Annotated[Record, BEATEN, MOST_POSES]
    gate: Annotated[Vector, "2n"]  # chi-square limits
    points: Annotated[Matrix, "n", 3]  # the markers, target axes
    used_s: Annotated[Vector, "n"]  # when each was last used, NaN = never
    trial_used_s: Annotated[Vector, "n"]
    accepted: Annotated[Vector, "n"]  # 1 = its spot was used
    accepted_aside: Annotated[Vector, "n"]
    which: Annotated[Vector, "n"]  # marker of each group
    turns: Annotated[Matrix, "2n", 3]  # rows by the chaser's attitude error
    nearer: Annotated[Matrix, "n", SEEN]  # d(depth) / depth by (drho, theta)
    by_marker: Annotated[Matrix, "2n", 3]
    bends: Annotated[Matrix, "2n", SEEN * SEEN]  # second order times covariance
    noise: Annotated[Matrix, "2n", "2n"]
    factor: Annotated[Matrix, "2n", "2n"]
    plain_noise: Annotated[Matrix, "2n", "2n"]  # scratch: `noise` without the inertia's
    groups: Annotated[Record, POSE_GROUP, "n"]
    independent: Annotated[Record, POSE_GROUP, "n"]
    bank_sensitivities: Annotated[Stack, MOST_POSES, "m", POSE]  # by one sigma of each lasting error, of a hypothesis
    trial_sensitivities: Annotated[Stack, MOST_POSES, "m", POSE]
    spare_sensitivities: Annotated[Stack, MOST_POSES, "m", POSE]
    bank_evidence: Annotated[Stack, MOST_POSES, "e", "m"]  # what images have told of lasting errors, by a hypothesis
    trial_evidence: Annotated[Stack, MOST_POSES, "e", "m"]
    spare_evidence: Annotated[Stack, MOST_POSES, "e", "m"]
    by_error: Annotated[Matrix, "2n", "m"]  # what it does to each row
    news: Annotated[Matrix, "m", POSE]  # scratch
    shown: Annotated[Matrix, "2n", "m"]  # scratch: `by_error` of rows in use
    left: Annotated[Matrix, "2n", "m"]  # `by_error` of the leading hypothesis at its prediction
    spread: Annotated[Matrix, "2n", "2n"]  # scratch: their innovations' covariance without it
    along: Annotated[Matrix, "2n", POSE]  # scratch
    innovation: Annotated[Vector, "2n"]  # scratch
    told: Annotated[Vector, "m"]  # scratch
    exchanged: Annotated[Matrix, "n", 2]  # spots that have changed places, scratch
    watched: Annotated[Record, WATCHED, "2n"]  # groups of rows under watch, of which n + 1 are used
    lasting_now: Annotated[Matrix, "4n", "m"]  # what each lasting error shows in innovations under watch
    lasting_usual: Annotated[Matrix, "4n", "m"]  # and has usually shown
    lasting_fast: Annotated[Matrix, "4n", "m"]  # and in the last second
    past: Annotated[Record, POSE_TRACK, 3]  # the track as it was; `added`: when
    past_sensitivities: Annotated[Stack, 3, "m", POSE]
    spots: Annotated[Record, SPOT, "n"]  # what is known of each marker's spot


_LAYOUT = Layout(PoseMemory, POSE_FIXED, {"n": "clock.markers", "m": "considered", "e": "evidence"}, {})
pose_views = _LAYOUT.views
"""The memory by names."""


def new_pose_memory(mission: VisionMission) -> Vector:
    """A filter that has seen nothing yet."""
    count, camera, target = len(mission.markers.positions_m), mission.camera, mission.target
    tolerances = mission.tolerances if mission.tolerances is not None and mission.tolerances.considered else None
    considered = marker_considered(mission)
    block = _LAYOUT.new(n=count, m=considered, e=considered + 1)
    m = pose_views(block)
    m.fixed["restart_after"] = mission.filter.restart_after_epochs
    m.fixed["few_markers_limit"] = mission.filter.few_markers_limit_s
    fill(
        m.camera,
        focal_length=camera.focal_length_px,
        principal_point=camera.principal_point_px,
        size=camera.image_size_px,
        noise=camera.spot_noise_px,
        distortion=camera.distortion,
        distorts=any(camera.distortion),
        mount=camera.dcm_cam_from_chaser,
        lens=camera.position_m,
        chaser=mission.dcm_chaser_from_lvlh,
        attitude_noise=mission.chaser.attitude_noise_rad,
    )
    fill(m.lasting, attitude=mission.chaser.attitude_sigma_rad, shown=marker_shown(mission))
    if tolerances is not None:
        fill(
            m.lasting,
            focal_length=tolerances.focal_length_relative_sigma,
            mounting=tolerances.camera_mounting_sigma_rad,
            placement=tolerances.marker_placement_sigma_m,
        )
    body = RigidBody(np.array(target.inertia_kg_m2), mission.orbit.mean_motion_rad_s)
    fill(m.body, values=body.matrix, noise_density=target.rate_noise_density_rad2_s3)
    fill(m.body, inertia_errors=inertia_errors(mission), inertia_sigma=target.inertia_sigma_kg_m2)
    write_motion_model(m.motion, mission.orbit, mission.process_noise, mission.filter)
    m.step["dt"], m.clock["t"], m.clock["begun"] = np.nan, np.nan, np.nan
    m.clock["renewed"], m.clock["blurred"], m.clock["doubted"] = np.nan, -np.inf, -np.inf
    m.beaten["t"] = -np.inf
    m.gate[:] = gate_limits(mission.filter.gate_probability, 2 * count)
    m.points[:], m.used_s[:], m.trial_used_s[:] = mission.markers.points_m, np.nan, np.nan
    watch_markers_anew(m)
    return block


def watch_markers_anew(m: PoseMemory) -> None:
    """Let the monitors know nothing yet; the first image is watched from the clock's time on."""
    watch_anew(m.watch, m.watched)
    m.spots["refused"], m.spots["denied"], m.past["added"] = 0.0, 0, np.nan
    fill(m.clock, denied=0, watched=m.clock["t"], used=m.clock["t"], leader=-np.inf, usurped=np.nan)
