"""The memory of the beacon filter: one array (`codegen.memory_layout`), and the names of its parts."""

from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.memory_layout import WORD, Layout
from relnav.dynamics.error_state import MOTION
from relnav.dynamics.process_noise import NODES
from relnav.dynamics.relative_motion import orbit_vector
from relnav.estimation.gating import gate_limits
from relnav.estimation.monitors import WATCH, watched_type
from relnav.estimation.returning import RETURNING
from relnav.estimation.rows import group_type, track_type
from relnav.mission import FilterSettings, Model, Orbit, ProcessNoise
from relnav.navigation.blocks import considered_errors
from relnav.sensors.three_beacon.fix import COORDINATES, WORK_ROWS
from relnav.sensors.three_beacon.measure import PROJECTIONS

METHODS = {"spots": 0, "fix": 1}
SPOTS = METHODS["spots"]
FIX = METHODS["fix"]

_F, _I = np.float64, np.int64

SENSOR = np.dtype(
    [
        ("focal_length", _F),
        ("half_width", _F, 2),
        ("spot_sigma", _F),
        ("half_spacing", _F),
        ("c_distance", _F),
        ("projection", _I),
        ("method", _I),
        ("attitude_known", _I),
        ("held", _F, (3, 3)),  # the model's attitude, and whether it is known, for steps that are told no other
        ("held_known", _I),
        ("turned", _I),  # `mount` holds another attitude
        ("attitude_sigma", _F),  # of the stated attitude, each axis: the lasting part
        ("attitude_noise", _F),  # and what is new at every image
        ("field_center", _F, 2),  # where the spots were calibrated
        ("field_half_width", _F, 2),
        ("cam_from_dock", _F, (3, 3)),  # derived from the attitude, as the next (`sight.attitude_changed`)
        ("offset", _F, 3),  # camera minus chaser's centre of mass, minus the port: camera from O = state + offset
    ]
)
TOLERANCES = np.dtype(
    [("focal_length", _F), ("camera_mounting", _F), ("beacon_mounting", _F), ("beacon_placement", _F)]
)
MOTION_MODEL = np.dtype(
    [
        ("orbit", _F, 4),  # as `dynamics.relative_motion` describes it
        ("acceleration_noise_density", _F),
        ("control_magnitude_sigma", _F),
        ("control_direction_sigma", _F),
        ("control_correlation_time", _F),
        ("initial_velocity_sigma", _F),
        ("acceleration", _F, 3),  # commanded, held since the last epoch
        ("delta_v", _F, 3),  # just before this one
    ]
)
STEP = np.dtype(
    [
        ("dt", _F),  # what the rest was computed for
        ("acceleration", _F, 3),
        ("impulse", _I),
        ("phi", _F, (MOTION, MOTION)),
        ("noise", _F, (MOTION, MOTION)),  # factors of Q
        ("effect", _F, MOTION),
        ("nodes", _F, (NODES, MOTION, MOTION)),  # of the integral that Q is; the same for the same step
    ]
)
PRIOR = np.dtype([("place", _F, 3), ("range2", _F), ("variance", _F)])
"""Camera from O in the docking frame at the prediction, its range squared, the position's variance."""
POSITION_FIX = np.dtype(
    [
        ("rays", _F, (3, 3)),  # of the measured spots, camera axes
        ("position", _F, 3),  # of the fix, docking frame
        ("value", _F, 3),  # invariants measured
        ("inverse", _F, (3, 3)),  # (dg/dp)^-1
        ("jacobian", _F, (3, COORDINATES)),  # d value / d spots
        ("factor", _F, (3, 3)),  # L of R = L diag L^T
    ]
)
BEACON = np.dtype(
    [
        ("position", _F, 3),  # from the target's centre of mass, lvlh_ccsds
        ("spot_sigma", _F, 2),  # of its spot's noise
        ("lasting_sigma", _F),  # of its spot's lasting error
    ]
)
SCRATCH = np.dtype(
    [
        ("closed_form", _F, (WORK_ROWS, COORDINATES)),
        ("three", _F, (3, 3)),
        ("turn", _F, (3, 3)),
        ("triads", _F, (14, 3)),
        ("rays", _F, (3, 3)),
        ("pair", _F, (3, 3)),
        ("vectors", _F, (4, 3)),
        ("places", _F, (3, COORDINATES)),
        ("by_beacon", _F, (9, 3)),
        ("gradients", _F, (11, 3)),
        ("numbers", _F, (3, COORDINATES)),
        ("normal", _F, (5, 3)),
        ("covariance", _F, (MOTION, MOTION)),
        ("columns", _F, (3, COORDINATES)),
        ("density", _F, (3, 3)),
        ("six", _F, (MOTION, MOTION)),
    ]
)
CLOCK = np.dtype([("t", _F), ("running", _I), ("trial", _I), ("rejected", _I), ("starts", _I), ("beacons", _I)])
RESULT = np.dtype([("nis", _F), ("status", _I), ("dof", _I), ("reason", _I), ("iterations", _I), ("used", _I)])
TRACK = track_type(MOTION)
GROUP = group_type(MOTION)
WATCHED = watched_type()
RETURN = np.dtype(RETURNING)
KEPT = np.dtype(
    [
        ("dock", _F, (3, 4)),  # dcm_dock_from_lvlh | port position, lvlh_ccsds
        ("mount", _F, (3, 4)),  # dcm_cam_from_lvlh | camera from the chaser's centre of mass, camera axes
        ("clock", CLOCK),
        ("track", TRACK),
        ("result", RESULT),
    ]
)
"""What results from an epoch; behind it in memory stand the innovations."""
FIXED = np.dtype(
    [
        ("restart_after", _I),
        ("considered", _I),  # how many lasting errors
        ("first_error", _I),  # which of them all stands in the first row (`beacon_considered.py`)
        ("sensor", SENSOR),
        ("tolerances", TOLERANCES),
        ("motion", MOTION_MODEL),
        ("step", STEP),
        ("prior", PRIOR),
        ("fix", POSITION_FIX),
        ("scratch", SCRATCH),
        ("work", TRACK),
        ("at", _F, MOTION),
        ("set_aside", RESULT),
        ("trial", TRACK),
        ("watch", WATCH),
        ("unseen", _F, MOTION),  # the prediction; while a step is doubted, what it would be without images since
        ("kept", KEPT),
    ]
)
"""All that does not depend on the number of beacons. What an epoch leaves to the next stands at the end, and goes on in
the parts behind it (`LASTING`)."""


class Memory(NamedTuple):
    """A filter's memory by names: records, and arrays of a length of their own (n beacons, m lasting errors).

    In memory the arrays stand behind the records, in this order.
    """

    fixed: Record
    sensor: Record
    tolerances: Record
    motion: Record
    step: Record
    prior: Record
    fix: Record
    scratch: Record
    trial: Record
    work: Record
    kept: Record
    clock: Record
    track: Record
    result: Record
    watch: Record
    innovations: Annotated[Vector, "2n"]
    sensitivities: Annotated[Matrix, "m", MOTION]  # of the track
    trial_sensitivities: Annotated[Matrix, "m", MOTION]
    watched: Annotated[Record, WATCHED, "n"]  # groups of rows under watch
    returning: Annotated[Record, RETURN, "n"]  # how long each spot was refused, and how far off
    lasting_usual: Annotated[Matrix, "2n", "m"]  # what each lasting error has usually shown in innovations of `spots`
    lasting_fast: Annotated[Matrix, "2n", "m"]  # and in the last second
    beacons: Annotated[Record, BEACON, "n"]
    lasting_now: Annotated[Matrix, "2n", "m"]  # and shows now
    news: Annotated[Matrix, "m", MOTION]  # scratch
    innovations_aside: Annotated[Vector, "2n"]
    gate: Annotated[Vector, "2n"]  # chi-square limits
    groups: Annotated[Record, GROUP, "n"]
    independent: Annotated[Record, GROUP, "n"]  # scratch
    by_error: Annotated[Matrix, "2n", "m"]  # what one sigma of each lasting error does to each row
    turns: Annotated[Matrix, "2n", 3]  # each row by a turn of the camera
    noise: Annotated[Matrix, "2n", "2n"]  # of coordinates that share the attitude's noise
    factor: Annotated[Matrix, "2n", "2n"]  # scratch
    nothing: Annotated[Matrix, 0, 0]


_LAYOUT = Layout(
    Memory,
    FIXED,
    {"n": "kept.clock.beacons", "m": "considered"},
    {"clock": "kept.clock", "track": "kept.track", "result": "kept.result"},
)
views = _LAYOUT.views
"""The memory by names."""

LASTING = "trial", "lasting_now"
"""From the first of these parts to before the second stands what an epoch leaves to the next."""


def lasting_part(block: Vector) -> tuple[int, int]:
    """Where that stands: its first number, and that behind its last."""
    return _LAYOUT.between(block, *LASTING)


def step_parts() -> tuple[int, int, int]:
    """Where the prepared step stands, from its length on: what depends on that alone, and what stands behind it."""
    places = (_LAYOUT.within(name)[1] // WORD for name in ("step", "step.nodes", "prior"))
    return tuple(places)  # type: ignore[return-value]  # three


def starts_at() -> int:
    """Where the number of starts stands."""
    return _LAYOUT.within("kept.clock.starts")[1] // WORD


def new_memory(model: Model, method: str, projection: str) -> Vector:
    """A filter that has seen nothing yet."""
    sensor, noise, settings = model.sensor, model.process_noise, model.filter
    count = len(model.beacons_lvlh_m)
    tolerances = model.tolerances if model.tolerances is not None and model.tolerances.considered else None
    calibration = model.calibration
    first, last = considered_errors(model, method)
    block = _LAYOUT.new(n=count, m=last - first)
    m = views(block)
    m.fixed["first_error"], m.fixed["restart_after"] = first, settings.restart_after_epochs
    half = 0.5 * np.array(sensor.detector_size_m)
    fill(
        m.sensor,
        focal_length=sensor.focal_length_m,
        half_width=half,
        spot_sigma=model.spot_sigma_m,
        half_spacing=sensor.beacon_half_spacing_m,
        c_distance=sensor.beacon_c_distance_m,
        projection=PROJECTIONS[projection],
        method=METHODS[method],
        attitude_known=model.attitude.mode == "lvlh_hold",
        held=model.dcm_cam_from_lvlh,
        held_known=model.attitude.mode == "lvlh_hold",
        attitude_sigma=model.attitude.sigma_rad,
        attitude_noise=model.attitude.noise_rad,
        field_center=(0.0, 0.0) if calibration is None else calibration.center_m,
        field_half_width=half if calibration is None else calibration.half_width_m,
    )
    write_motion_model(m.motion, model.orbit, noise, settings)
    if tolerances is not None:
        fill(
            m.tolerances,
            focal_length=tolerances.focal_length_relative_sigma,
            camera_mounting=tolerances.camera_mounting_sigma_rad,
            beacon_mounting=tolerances.beacon_mounting_sigma_rad,
            beacon_placement=tolerances.beacon_placement_sigma_m,
        )
    m.step["dt"], m.clock["t"] = np.nan, -np.inf
    watch_anew(m.watch, m.watched)
    m.gate[:] = gate_limits(settings.gate_probability, 2 * count)
    m.kept["dock"][:, :3], m.kept["dock"][:, 3] = model.dcm_dock_from_lvlh, model.port_position_m
    m.kept["mount"][:, :3], m.kept["mount"][:, 3] = model.dcm_cam_from_lvlh, model.camera_lever_cam_m
    m.beacons["position"] = model.beacons_lvlh_m
    m.beacons["spot_sigma"], m.beacons["lasting_sigma"] = sensor.spot_noise_m, model.lasting_spot_sigma_m
    return block


@lru_cache(maxsize=8)
def orbit_values(orbit: Orbit) -> Vector:
    """The orbit as `dynamics.relative_motion` takes it, (4,), read-only."""
    values = orbit_vector(orbit.mean_motion_rad_s, orbit.eccentricity, orbit.true_anomaly_rad)
    values.setflags(write=False)
    return values


def write_motion_model(motion: Record, orbit: Orbit, noise: ProcessNoise, settings: FilterSettings) -> None:
    """Write what a filter knows of the relative motion."""
    fill(
        motion,
        orbit=orbit_values(orbit),
        acceleration_noise_density=noise.acceleration_noise_density_m2_s3,
        control_magnitude_sigma=noise.control_magnitude_sigma,
        control_direction_sigma=noise.control_direction_sigma_rad,
        control_correlation_time=noise.control_correlation_time_s,
        initial_velocity_sigma=settings.initial_velocity_sigma_m_s,
    )


def watch_anew(watch: Record, watched: Record) -> None:
    """Let monitors know nothing yet."""
    fill(watch, **dict.fromkeys(WATCH.names or (), 0))
    watch["jumped"] = np.inf
    watched[:] = np.zeros(1, dtype=WATCHED)
    watched["reading"] = np.nan


def fill(record: Record, **values: Any) -> None:
    """Write fields of a record by name."""
    for name, value in values.items():
        record[name] = value
