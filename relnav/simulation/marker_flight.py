"""A flight before the markers' camera: integrated orbits and a turning target, imaged with noise, drops, occlusion."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import VisionMission
from relnav.sensors.three_marker.camera import project
from relnav.simulation.target_rotation import rotate_target, true_inertia, turning_rad_s
from relnav.simulation.trajectory import Approach, fly


@dataclass(frozen=True)
class MarkerFaults:
    """What goes wrong with the images.

    Attributes
    ----------
    dropout, outliers : float
        Probability that a spot is not seen, or is a glint somewhere on the image, each spot and image.
    hidden : tuple of (marker, from s, to s)
        Markers behind something for a while.
    """

    dropout: float = 0.0
    outliers: float = 0.0
    hidden: tuple[tuple[int, float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ("dropout", "outliers"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} is a probability, 0 <= {name} < 1; got {getattr(self, name)!r}")


@dataclass(frozen=True)
class MarkerFlight:
    """A log and its truth.

    Attributes
    ----------
    t_s : (n,)
    spots_px : (n, markers, 2)
        NaN = not seen.
    acceleration_m_s2 : (n, 3)
        As commanded, held over the interval that ends at the row, `lvlh_ccsds`.
    dcm_chaser_from_lvlh : (n, 3, 3)
        As the chaser knows it.
    motion : (n, 6)
        True relative state, `lvlh_ccsds`.
    dcm_lvlh_from_target, rate_rad_s : (n, 3, 3), (n, 3)
        True attitude and inertial rate of the target.
    chaser_error_rad : (n, 3)
        By what the chaser is turned against the attitude that it knows, chaser axes.
    """

    t_s: Vector
    spots_px: Stack
    acceleration_m_s2: Matrix
    dcm_chaser_from_lvlh: Stack
    motion: Matrix
    dcm_lvlh_from_target: Stack
    rate_rad_s: Matrix
    chaser_error_rad: Matrix

    @property
    def true_dcm_chaser_from_lvlh(self) -> Stack:
        """The chaser's attitude as it is, (n, 3, 3)."""
        turned: Stack = Rotation.from_rotvec(-self.chaser_error_rad).as_matrix() @ self.dcm_chaser_from_lvlh
        return turned


def true_spots(mission: VisionMission, motion: Matrix, dcm_target: Stack, dcm_chaser: Stack) -> Stack:
    """Spots (n, markers, 2) px of true states, no noise; NaN where a marker is not on the image."""
    camera = mission.camera
    mount, lens, points = camera.dcm_cam_from_chaser, np.array(camera.position_m), mission.markers.points_m
    in_lvlh = points @ dcm_target.transpose(0, 2, 1) - motion[:, None, :3]
    in_camera = (in_lvlh @ dcm_chaser.transpose(0, 2, 1) - lens) @ mount.T
    return project(in_camera.reshape(-1, 3), camera).spots_px.reshape(len(motion), len(points), 2)


def inertia_off(seed: int) -> Vector:
    """Standard normal numbers (6,), by which the inertia of a flight's target is off; its other numbers are as ever."""
    return np.random.default_rng(np.random.SeedSequence(seed).spawn(5)[4]).normal(size=6)  # as built: the one before


def simulate_flight(
    mission: VisionMission, approach: Approach | None = None, faults: MarkerFaults | None = None, seed: int = 0
) -> MarkerFlight:
    """Fly an approach with a target that turns: its attitude within the expected view, its rate as the filter assumes.

    The chaser holds the model's attitude but for its stated error, drawn once a flight, and the noise of every image.
    The target's inertia is off by the error that the model states. The same seed gives the same flight.
    """
    faults = faults or MarkerFaults()
    streams = [np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(3)]
    t, motion, command = fly(mission, approach or Approach(), streams[0])
    rng, n = streams[1], turning_rad_s(0.0, mission.orbit)
    off = mission.view.attitude_sigma_rad * rng.normal(size=3)
    start = Rotation.from_matrix(mission.target.dcm_target_from_lvlh.T) * Rotation.from_rotvec(off)
    spread = np.minimum(mission.filter.initial_rate_sigma_rad_s, math.radians(10.0) / max(float(t[-1]), 1.0))
    rate = start.inv().apply([0.0, -n, 0.0]) + spread * rng.normal(size=3)
    dcm, rates = rotate_target(
        t,
        start.as_quat()[None],
        rate[None],
        true_inertia(mission.target, inertia_off(seed)),
        mission.orbit,
        mission.target.rate_noise_density_rad2_s3,
        rng,
    )
    rng = streams[2]
    known = np.broadcast_to(mission.dcm_chaser_from_lvlh, (len(t), 3, 3))
    alpha = mission.chaser.attitude_sigma_rad * rng.normal(size=3)
    alpha = alpha + mission.chaser.attitude_noise_rad * rng.normal(size=(len(t), 3))
    error = Rotation.from_rotvec(-alpha)
    spots = true_spots(mission, motion, dcm[:, 0], error.as_matrix() @ known)
    spots += mission.camera.spot_noise_px * rng.normal(size=spots.shape)
    size = np.array(mission.camera.image_size_px)
    glint = (rng.uniform(size=spots.shape[:2]) < faults.outliers) & np.isfinite(spots).all(axis=-1)
    spots = np.where(glint[..., None], rng.uniform(size=spots.shape) * (size - 1.0), spots)
    spots[rng.uniform(size=spots.shape[:2]) < faults.dropout] = np.nan
    for marker, begin, end in faults.hidden:
        spots[(t >= begin) & (t < end), marker] = np.nan
    return MarkerFlight(t, spots, command, known, motion, dcm[:, 0], rates[:, 0], alpha)
