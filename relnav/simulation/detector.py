"""What the detector of a true trajectory shows: projected spots, noise, and the faults a real one has."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.codegen.kernel import kernel, long_entry, long_kernel
from relnav.codegen.together import attempt, lanes_of, new_lanes, select
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


@kernel
def _project_one(state: Vector, dcm: Matrix, lever: Vector, beacons: Matrix, focal_length: float, out: Matrix) -> None:
    """Write central projections (beacons, 2) of beacons from a state (6,)."""
    for b in range(beacons.shape[0]):
        u, v, w = beacons[b, 0] - state[0], beacons[b, 1] - state[1], beacons[b, 2] - state[2]
        x = -lever[0] + dcm[0, 0] * u + dcm[0, 1] * v + dcm[0, 2] * w
        y = -lever[1] + dcm[1, 0] * u + dcm[1, 1] * v + dcm[1, 2] * w
        z = -lever[2] + dcm[2, 0] * u + dcm[2, 1] * v + dcm[2, 2] * w
        depth = select(z > 0.0, z, math.nan)
        out[b, 0], out[b, 1] = focal_length * (x / depth), focal_length * (y / depth)


@kernel
def _detect_one(noise: Matrix, sigma: float, half: Vector, spots: Matrix) -> None:
    """Add noise (beacons, 2), in sigma, to spots; NaN where one then is beside the detector."""
    for b in range(spots.shape[0]):
        x, y = spots[b, 0] + noise[b, 0] * sigma, spots[b, 1] + noise[b, 1] * sigma
        seen = (abs(x) <= half[0]) & (abs(y) <= half[1])
        spots[b, 0], spots[b, 1] = select(seen, x, math.nan), select(seen, y, math.nan)


@long_kernel
def _project(state: Matrix, dcm: Stack, lever: Vector, beacons: Matrix, focal_length: float, out: Stack) -> None:
    """`_project_one` of n states; dcm (n, 3, 3) or (1, 3, 3)."""
    for e in range(state.shape[0]):
        _project_one(state[e], dcm[e if dcm.shape[0] > 1 else 0], lever, beacons, focal_length, out[e])


@long_kernel
def _detect(noise: Stack, sigma: float, half: Vector, spots: Stack) -> None:
    """`_detect_one` of n images."""
    for e in range(spots.shape[0]):
        _detect_one(noise[e], sigma, half, spots[e])


class _Detector(NamedTuple):
    """What images are seen with, as the functions above take it."""

    dcm: Matrix
    lever: Vector
    beacons: Matrix
    focal_length: float
    sigma: float
    half: Vector


@kernel
def _image(state: Matrix, seen_by: _Detector, noise: Stack, out: Stack) -> None:
    """What is seen of the beacons from n states."""
    for e in range(state.shape[0]):
        _project_one(state[e], seen_by.dcm, seen_by.lever, seen_by.beacons, seen_by.focal_length, out[e])
        _detect_one(noise[e], seen_by.sigma, seen_by.half, out[e])


@long_entry
def _image_together(
    state: Stack,
    dcm: Matrix,
    lever: Vector,
    beacons: Matrix,
    focal_length: float,
    sigma: float,
    half: Vector,
    noise: Stack,
    out: Stack,
) -> bool:
    """`_image` of RUNS runs; whether all went the same way."""
    seen_by = _Detector(dcm, lever, beacons, focal_length, sigma, half)
    divided, _ = attempt(_image, lanes_of(state), seen_by, lanes_of(noise), lanes_of(out))
    return divided == 0


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


@dataclass(frozen=True)
class Happens:
    """What goes wrong with the spots of n epochs, of (n beacons,) spots.

    Attributes
    ----------
    glints : (k,)
        Which spots are elsewhere.
    places : (k, 2)
        Where, in half widths of the detector.
    unseen : (m,)
        Which are not seen.
    """

    glints: Codes
    places: Matrix
    unseen: Codes


def image(
    model: Model, state: Matrix, faults: Faults, rng: np.random.Generator, sigma_m: Stack | float | None = None
) -> Stack:
    """Spots (n, 3, 2) m that a log of the true states (n, 6) holds; NaN = not seen.

    sigma_m: noise of each coordinate, (n, 3, 2) or one number; the sensor's `spot_noise_m` if left out.
    """
    places = misplaced(model, project_beacons(model, state), rng)
    noise, aside = rng.normal(size=places.shape), rng.uniform(-1.0, 1.0, size=places.shape)
    glint, unseen = rng.uniform(size=places[..., 0].size), rng.uniform(size=places[..., 0].size)
    glints = np.flatnonzero(glint < faults.outliers)
    spots = detected(model, places, noise, sigma_m)
    happen(model, spots, Happens(glints, aside.reshape(-1, 2)[glints], np.flatnonzero(unseen < faults.dropout)))
    return spots


def detected(model: Model, places_m: Stack, noise: Stack, sigma_m: Stack | float | None = None) -> Stack:
    """Spots (n, 3, 2) m where the detector says that they are, of those where its light falls; NaN beside it.

    noise (n, 3, 2): standard normal; sigma_m as in `image`.
    """
    sigma, spots = model.sensor.spot_noise_m if sigma_m is None else sigma_m, np.array(places_m)
    if isinstance(sigma, np.ndarray):
        noise, sigma = noise * sigma, 1.0
    _detect(np.ascontiguousarray(noise), float(sigma), 0.5 * np.array(model.sensor.detector_size_m), spots)
    return spots


def detected_together(model: Model, state: Stack, noise: Stack) -> Stack:
    """What is `detected` of true states (n, 6, RUNS), each to the bit as alone; noise and result (n, 3, 2, RUNS)."""
    beacons, sensor = model.beacons_lvlh_m, model.sensor
    half = 0.5 * np.array(sensor.detector_size_m)
    out: Stack = new_lanes(len(state), len(beacons), 2, make=np.empty)
    geometry = model.dcm_cam_from_lvlh, model.camera_lever_cam_m, beacons, sensor.focal_length_m
    agreed = _image_together(state, *geometry, sensor.spot_noise_m, half, noise, out)
    assert agreed, "nothing in an image is decided by its numbers"
    return out


def happen(model: Model, spots: Stack, what: Happens) -> None:
    """Let faults happen to spots (n, 3, 2) m, in place."""
    beacons = spots.shape[1]
    if len(what.glints):
        half = 0.5 * np.array(model.sensor.detector_size_m)
        spots[what.glints // beacons, what.glints % beacons] = what.places * half
    spots[what.unseen // beacons, what.unseen % beacons] = np.nan
