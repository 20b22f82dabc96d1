"""One run of a scenario before the markers' camera: what is uncertain is drawn, then it is flown and imaged."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Stack, Vector
from relnav.dynamics.inertia_error import INERTIA_ENTRIES
from relnav.mission import VisionMission
from relnav.simulation.as_built import markers_off
from relnav.simulation.dispersions import Scenario
from relnav.simulation.marker_flight import MarkerFlight, true_spots
from relnav.simulation.run_draws import built_names, disturbed, lose, replaced
from relnav.simulation.streams import Draws, Stream
from relnav.simulation.target_rotation import rotate_target, true_inertia, turning_rad_s
from relnav.simulation.trajectory import fly_disturbed

MOST_TURN_RAD = math.radians(10.0)
"""The target turns so far in a run, 1-sigma, however fast the filter expects it to turn at the start."""
OF_TARGET = tuple(f"{what}_{axis}" for what in ("target_turn", "target_rate", "chaser_attitude") for axis in "xyz")

OF_INERTIA = tuple(f"inertia_{'xyz'[i]}{'xyz'[j]}" for i, j in INERTIA_ENTRIES)


def inertia_names(mission: VisionMission) -> tuple[str, ...]:
    """Names of the entries of the target's inertia that are off, by the sigma that the model states."""
    sigma = mission.target.inertia_sigma_kg_m2
    return tuple(name for name, (i, j) in zip(OF_INERTIA, INERTIA_ENTRIES, strict=True) if sigma[i][j] > 0.0)


def check_flyable(mission: VisionMission, scenario: Scenario) -> None:
    """Raise a ValueError where a scenario asks for what a model does not say."""
    if not isinstance(scenario, Scenario):
        raise ValueError(f"a scenario is expected, relnav.load_scenario(...); got a {type(scenario).__name__}")
    if scenario.images.by_received_power:
        raise ValueError("images.by_received_power is for beacons: the noise of markers is the camera's spot_noise_px")
    if scenario.as_built.by_tolerances and mission.tolerances is None:
        raise ValueError(f"model {mission.name} has no [tolerances], by which the scenario draws the sensor as built")


def fly_marker_run(
    mission: VisionMission, scenario: Scenario, seed: int, run: int, given: Mapping[str, float] | None = None
) -> tuple[MarkerFlight, dict[str, float]]:
    """Fly a run; with what was drawn once for it, in units of its 1-sigma. given: replaces these, by name.

    The target's attitude lies about the expected view, its rate about that of a target that is held, as the scenario's
    [spread] or the model says. The chaser holds the model's attitude but for its stated error, the target the inertia.
    """
    check_flyable(mission, scenario)
    draws, drawn = Draws(seed, run), dict[str, float]()
    approach, disturbances = disturbed(mission, scenario, draws, drawn, given)
    t, motion, command = fly_disturbed(mission, approach, disturbances)
    turned = replaced(draws.normals(Stream.TURN, (len(OF_TARGET),)), OF_TARGET, given)
    drawn |= dict(zip(OF_TARGET, turned.tolist(), strict=True))
    off = replaced(draws.normals(Stream.INERTIA, (len(OF_INERTIA),)), OF_INERTIA, given)
    stated = inertia_names(mission)
    drawn |= {name: float(off[k]) for k, name in enumerate(OF_INERTIA) if name in stated}
    attitude, rate = sigmas_of_target(mission, scenario)
    start = Rotation.from_matrix(mission.target.dcm_target_from_lvlh.T) * Rotation.from_rotvec(attitude * turned[:3])
    held = start.inv().apply([0.0, -turning_rad_s(0.0, mission.orbit), 0.0])
    dcm, rates = rotate_target(
        t,
        start.as_quat()[None],
        (held + rate * turned[3:6])[None],
        true_inertia(mission.target, off),
        mission.orbit,
        mission.target.rate_noise_density_rad2_s3,
        draws.generator(Stream.TORQUE),
    )
    known = np.broadcast_to(mission.dcm_chaser_from_lvlh, (len(t), 3, 3))
    alpha = mission.chaser.attitude_sigma_rad * turned[6:]
    alpha = alpha + mission.chaser.attitude_noise_rad * draws.normals(Stream.ATTITUDE_NOISE, (len(t), 3))
    flown = _as_built(mission, scenario, draws, drawn, given)
    spots = true_spots(flown, motion, dcm[:, 0], Rotation.from_rotvec(-alpha).as_matrix() @ known)
    _spoil(mission, scenario, draws, spots)
    lose(scenario, draws, t, spots)
    return MarkerFlight(t, spots, command, known, motion, dcm[:, 0], rates[:, 0], alpha), drawn


def sigmas_of_target(mission: VisionMission, scenario: Scenario) -> tuple[float, float]:
    """1-sigma of the target's attitude rad and rate rad/s at the start, each axis."""
    spread, seconds = scenario.spread, max(scenario.approach.duration_s, 1.0)
    attitude, rate = spread.target_attitude_sigma_rad, spread.target_rate_sigma_rad_s
    expected = min(mission.filter.initial_rate_sigma_rad_s, MOST_TURN_RAD / seconds)
    return mission.view.attitude_sigma_rad if attitude is None else attitude, expected if rate is None else rate


def _as_built(
    mission: VisionMission,
    scenario: Scenario,
    draws: Draws,
    drawn: dict[str, float],
    given: Mapping[str, float] | None,
) -> VisionMission:
    """The camera and the markers that fly; markers turn as one about the target's port."""
    errors, t = scenario.as_built, mission.tolerances
    if not errors.any:
        return mission
    points: Vector = mission.markers.points_m
    names = built_names(len(points))
    numbers = replaced(draws.normals(Stream.BUILT, (len(names),)), names, given)
    drawn |= dict(zip(names, numbers.tolist(), strict=True))
    focal, camera = errors.focal_length_relative_sigma, errors.camera_mounting_sigma_rad
    turn, place = errors.beacon_mounting_sigma_rad, errors.beacon_placement_sigma_m
    if errors.by_tolerances and t is not None:
        focal, camera = t.focal_length_relative_sigma, t.camera_mounting_sigma_rad
        turn, place = 0.0, t.marker_placement_sigma_m
    arm = points - np.array(mission.target.port_position_m)
    moved = Rotation.from_rotvec(numbers[4:7] * turn).apply(arm) - arm + numbers[7:].reshape(points.shape) * place
    return markers_off(mission, float(numbers[0]) * focal, -numbers[1:4] * camera, moved)


def _spoil(mission: VisionMission, scenario: Scenario, draws: Draws, spots: Stack) -> None:
    """Add noise, glints and dropouts to spots (n, markers, 2) px, in place."""
    images, shape = scenario.images, spots.shape[:2]
    spots += mission.camera.spot_noise_px * draws.normals(Stream.SPOT_NOISE, spots.shape)
    if images.outliers:
        glint = (draws.uniforms(Stream.GLINT, shape) < images.outliers) & np.isfinite(spots).all(axis=-1)
        place = draws.uniforms(Stream.GLINT_PLACE, spots.shape) * (np.array(mission.camera.image_size_px) - 1.0)
        spots[glint] = place[glint]
    if images.dropout:
        spots[draws.uniforms(Stream.DROPOUT, shape) < images.dropout] = np.nan
