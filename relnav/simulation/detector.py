"""What the detector of a true trajectory shows: projected spots, noise, and the faults a real one has."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import long_kernel
from relnav.mission import Model
from relnav.sensors.three_beacon.psd import spot_sigma
from relnav.simulation.distortion import Distortion

LEFT_LENGTH = 0.4
"""Length of what a calibration leaves, in half widths of its grid: its correlation has 1/e at 0.4 to 0.75 of them."""


@dataclass(frozen=True)
class Faults:
    """How often things go wrong, per spot and epoch.

    Attributes
    ----------
    dropout : float
        Probability that a spot is not seen.
    outliers : float
        Probability that a spot is somewhere else on the detector (glint): uniform over it.
    """

    dropout: float = 0.0
    outliers: float = 0.0

    def __post_init__(self) -> None:
        for name in ("dropout", "outliers"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} is a probability, 0 <= {name} < 1; got {getattr(self, name)!r}")


def beacons_in_camera(model: Model, state: Matrix, dcm_cam_from_lvlh: Stack | None = None) -> Stack:
    """Beacons A, B, C in camera axes (n, 3, 3) m from true states (n, 6); attitude (n, 3, 3) or the model's."""
    dcm = model.dcm_cam_from_lvlh[None] if dcm_cam_from_lvlh is None else dcm_cam_from_lvlh
    camera = state[:, :3] + np.einsum("nij,i->nj", dcm, model.camera_lever_cam_m)
    points: Stack = np.einsum("nij,nbj->nbi", dcm, model.beacons_lvlh_m[None] - camera[:, None])
    return points


@long_kernel
def _project(state: Matrix, dcm: Stack, lever: Vector, beacons: Matrix, focal_length: float, out: Stack) -> None:
    """Write central projections (n, beacons, 2) of beacons; dcm (n, 3, 3) or (1, 3, 3)."""
    for e in range(state.shape[0]):
        c = dcm[e if dcm.shape[0] > 1 else 0]
        for b in range(beacons.shape[0]):
            u, v, w = beacons[b, 0] - state[e, 0], beacons[b, 1] - state[e, 1], beacons[b, 2] - state[e, 2]
            x = -lever[0] + c[0, 0] * u + c[0, 1] * v + c[0, 2] * w
            y = -lever[1] + c[1, 0] * u + c[1, 1] * v + c[1, 2] * w
            z = -lever[2] + c[2, 0] * u + c[2, 1] * v + c[2, 2] * w
            depth = z if z > 0.0 else math.nan
            out[e, b, 0], out[e, b, 1] = focal_length * (x / depth), focal_length * (y / depth)


def project_beacons(model: Model, state: Matrix, dcm_cam_from_lvlh: Stack | None = None) -> Stack:
    """Noise-free spots (n, 3, 2) m of true states (n, 6); NaN where a beacon is behind. Attitude as above."""
    dcm = model.dcm_cam_from_lvlh[None] if dcm_cam_from_lvlh is None else np.ascontiguousarray(dcm_cam_from_lvlh)
    beacons = model.beacons_lvlh_m
    out, states = np.empty((len(state), len(beacons), 2)), np.ascontiguousarray(state, dtype=np.float64)
    _project(states, dcm, model.camera_lever_cam_m, beacons, model.sensor.focal_length_m, out)
    return out


def misplaced(model: Model, spots_m: Stack, rng: np.random.Generator) -> Stack:
    """Spots (n, 3, 2) m as the detector of a calibrated model measures them; those of another model as they are.

    The distortion that the calibration takes out, and what it leaves: a smooth field over the detector that lasts.
    """
    if model.calibration is None:
        return spots_m
    calibration = model.calibration
    measured = calibration.distorted(spots_m)
    left = calibration.corrected(measured)[1]
    places = (measured - np.array(calibration.center_m)) / np.array(calibration.half_width_m)
    field = Distortion(1.0, figure_sigma_m=1.0, figure_length_m=LEFT_LENGTH, seed=int(rng.integers(2**32)))
    return measured + field.error(places) * left[..., None]


def photocurrents(model: Model, state: Matrix, dcm_cam_from_lvlh: Stack | None = None) -> Matrix:
    """Photocurrent (n, 3) A that each beacon would draw while it is on, from true states (n, 6); 0 from behind.

    Raises
    ------
    ValueError
        If the model does not say what its detector and its light are.
    """
    if model.detector is None or model.light is None:
        raise ValueError(f"model {model.name} has no [detector] and [light]: photocurrents need both")
    c = beacons_in_camera(model, state, dcm_cam_from_lvlh)
    dcm = model.dcm_cam_from_lvlh[None] if dcm_cam_from_lvlh is None else dcm_cam_from_lvlh
    boresight = dcm @ model.dcm_dock_from_lvlh[0]  # the docking axis in camera axes
    distance = np.linalg.norm(c, axis=-1)
    beacon_angle = np.arccos(np.clip(-(c @ boresight[..., None])[..., 0] / distance, -1.0, 1.0))
    camera_angle = np.arccos(np.clip(c[..., 2] / distance, -1.0, 1.0))
    power = model.light.received_power_w(distance, beacon_angle, camera_angle)
    current: Matrix = model.detector.responsivity_a_w * power
    return current


def background_current_a(model: Model) -> float:
    """Current of the background on each of the four electrodes, A."""
    if model.detector is None or model.light is None:
        raise ValueError(f"model {model.name} has no [detector] and [light]: a background current needs both")
    power = model.light.background_power_w(model.sensor.detector_size_m, model.sensor.focal_length_m)
    return 0.5 * model.detector.axis_share * model.detector.responsivity_a_w * power


def spot_sigmas(model: Model, state: Matrix, dcm_cam_from_lvlh: Stack | None = None) -> Stack:
    """1-sigma (n, 3, 2) m of each spot coordinate by received power; NaN where a beacon is behind.

    A model without [detector] and [light] has its constant `spot_noise_m`.
    """
    spots = project_beacons(model, state, dcm_cam_from_lvlh)
    if model.detector is None or model.light is None:
        return np.where(np.isnan(spots), np.nan, model.sensor.spot_noise_m)
    samples = 1 if model.pulses is None else model.pulses.samples
    dark = model.pulses.dark_samples if model.pulses is not None and model.pulses.dark_slot else np.inf
    return spot_sigma(
        model.detector,
        model.sensor.detector_size_m,
        spots,
        photocurrents(model, state, dcm_cam_from_lvlh) * model.detector.axis_share,
        background_current_a(model),
        samples=samples,
        dark_samples=dark,
    )


@long_kernel
def _take_away(
    spots: Stack, half: Vector, outliers: float, glint: Matrix, place: Stack, dropout: float, unseen: Matrix
) -> None:
    """Let glints stand where spots (n, beacons, 2) were, and NaN where they are not seen or beside the detector."""
    for e in range(spots.shape[0]):
        for i in range(spots.shape[1]):
            x, y = spots[e, i, 0], spots[e, i, 1]
            if outliers > 0.0 and glint[e, i] < outliers:
                x, y = place[e, i, 0] * half[0], place[e, i, 1] * half[1]
            seen = abs(x) <= half[0] and abs(y) <= half[1]
            if dropout > 0.0 and unseen[e, i] < dropout:
                seen = False
            spots[e, i, 0], spots[e, i, 1] = (x, y) if seen else (math.nan, math.nan)


@dataclass(frozen=True)
class SpotDraws:
    """Random numbers of the images of n epochs.

    Attributes
    ----------
    noise : (n, beacons, 2)
        Standard normal.
    place : (n, beacons, 2)
        Uniform within -1 and 1: where a glint is on the detector.
    glint, unseen : (n, beacons)
        Uniform within 0 and 1: what is below the probability happens.
    """

    noise: Stack
    place: Stack | None
    glint: Matrix | None
    unseen: Matrix | None


def image(
    model: Model, state: Matrix, faults: Faults, rng: np.random.Generator, sigma_m: Stack | float | None = None
) -> Stack:
    """Spots (n, 3, 2) m that a log of the true states (n, 6) holds; NaN = not seen.

    sigma_m: noise of each coordinate, (n, 3, 2) or one number; the sensor's `spot_noise_m` if left out.
    """
    spots = misplaced(model, project_beacons(model, state), rng)
    noise, place = rng.normal(size=spots.shape), rng.uniform(-1.0, 1.0, size=spots.shape)
    glint, unseen = rng.uniform(size=spots.shape[:2]), rng.uniform(size=spots.shape[:2])
    return imaged(model, spots, faults, SpotDraws(noise, place, glint, unseen), sigma_m)


def imaged(
    model: Model, spots_m: Stack, faults: Faults, draws: SpotDraws, sigma_m: Stack | float | None = None
) -> Stack:
    """Spots (n, 3, 2) m where the detector says that they are, of those where its light falls; NaN = not seen.

    The draws of faults that do not happen may be None.
    """
    sigma = np.asarray(model.sensor.spot_noise_m if sigma_m is None else sigma_m)
    half, nothing = 0.5 * np.array(model.sensor.detector_size_m), np.empty((0, 0))
    outliers, glint, place, dropout, unseen = 0.0, nothing, np.empty((0, 0, 2)), 0.0, nothing
    if draws.glint is not None and draws.place is not None:
        outliers, glint, place = faults.outliers, draws.glint, draws.place
    if draws.unseen is not None:
        dropout, unseen = faults.dropout, draws.unseen
    spots: Stack = spots_m + draws.noise * sigma
    _take_away(spots, half, outliers, glint, place, dropout, unseen)
    return spots
