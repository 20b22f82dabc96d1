"""How the spots of one geometry move with everything that can be wrong, and what a fix or a settled filter makes of it.

A beacon B seen from p by a camera of attitude C and focal length f makes the spot s = f (c_x, c_y) / c_z,
c = C (B - p). With D = ds/dc = f / c_z [1 0 -c_x/c_z; 0 1 -c_y/c_z]: ds/dp = -D C, ds/dB = D C, ds/df = s / f; and for
a small turn theta of the camera, ds/dtheta = D [c]x. Docking-frame; coordinates are stacked A'x, A'y, B'x, ...
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from relnav.arrays import Codes, Flags, Matrix, Vector
from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.process_noise import acceleration_noise
from relnav.estimation.steady_state import SteadyState, steady_state
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection_jacobian
from relnav.geometry.spherical import range_azimuth_elevation_jacobian
from relnav.mission import Model
from relnav.sensors.three_beacon.fix import WORK_ROWS, fix_jacobian
from relnav.sensors.three_beacon.measure import PROJECTIONS
from relnav.simulation.detector import project_beacons, spot_sigmas


@dataclass(frozen=True)
class Sensitivity:
    """Spots of n beacons seen from one place, and their derivatives; rows are the 2 n coordinates.

    A beacon behind the camera has no spot (NaN) and no derivatives (0).

    Attributes
    ----------
    position_m : (3,)
        Camera in the docking frame.
    spots_m, sigma_m : (n, 2), (n, 2)
        Without noise; and their noise, by received power if the model says how.
    lasting_m : (n,)
        1-sigma of what a calibration leaves of each coordinate there: more outside its box; 0 without one.
    visible : (n,)
        Which beacons are on the detector.
    by_position, by_camera_turn : (2 n, 3)
        ds/dp and ds/dtheta (theta in camera axes).
    by_beacons : (2 n, 3 n)
        By the coordinates of the beacons in turn.
    by_focal_length : (2 n,)
        Per m.
    """

    position_m: Vector
    spots_m: Matrix
    sigma_m: Matrix
    lasting_m: Vector
    visible: Flags
    by_position: Matrix
    by_camera_turn: Matrix
    by_beacons: Matrix
    by_focal_length: Vector

    @property
    def rows(self) -> Codes:
        """Coordinates of visible beacons, numbers within 0 .. 2 n - 1."""
        return np.flatnonzero(np.repeat(self.visible, 2))


def place_state(model: Model, position_dock_m: Vector) -> Vector:
    """State (6,) of a chaser at rest whose camera, held as the model says, is at this docking-frame position."""
    lever = model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m
    state = np.zeros(6)
    state[:3] = model.port_position_m + model.dcm_dock_from_lvlh.T @ position_dock_m - lever
    return state


def sensitivity(model: Model, position_dock_m: Vector) -> Sensitivity:
    """Derivatives of the spots at a place, camera held as the model says."""
    position = np.asarray(position_dock_m, dtype=np.float64)
    state = place_state(model, position)[None]
    f = model.sensor.focal_length_m
    dcm = model.dcm_cam_from_lvlh @ model.dcm_dock_from_lvlh.T  # cam from dock
    spots = project_beacons(model, state)[0]
    beacons = model.sensor.beacons_dock_m
    n, c = len(beacons), (beacons - position) @ dcm.T
    by_point = f * np.nan_to_num(central_projection_jacobian(c))
    by_beacons = np.zeros((2 * n, 3 * n))
    for i in range(n):
        by_beacons[2 * i : 2 * i + 2, 3 * i : 3 * i + 3] = by_point[i] @ dcm
    half, lasting = 0.5 * np.array(model.sensor.detector_size_m), np.zeros(n)
    if model.calibration is not None:
        measured = 2.0 * spots - model.calibration.correct(spots)
        lasting = model.calibration.corrected(measured)[1]
    return Sensitivity(
        position_m=position,
        spots_m=spots,
        sigma_m=spot_sigmas(model, state)[0],
        lasting_m=lasting,
        visible=np.all(np.abs(spots) <= half, axis=1),
        by_position=-(by_point @ dcm).reshape(-1, 3),
        by_camera_turn=(by_point @ cross_matrix(c)).reshape(-1, 3),
        by_beacons=by_beacons,
        by_focal_length=np.nan_to_num(spots).ravel() / f,
    )


def angles_by_position(position_dock_m: Vector) -> Matrix:
    """d(range m, azimuth rad, elevation rad)/dp at a docking-frame position, (3, 3)."""
    out = np.empty((3, 3))
    range_azimuth_elevation_jacobian(position_dock_m, out)
    return out


def fix_by_spots(model: Model, at: Sensitivity) -> Matrix:
    """d(range m, azimuth rad, elevation rad)/d(spots) of the model's closed form, (3, 2 n); NaN where it has none.

    It uses A, B and C only.
    """
    sensor, jacobian = model.sensor, np.zeros((3, 6))
    usable = bool(at.visible[:3].all()) and fix_jacobian(
        at.position_m,
        np.ascontiguousarray(at.spots_m[:3]),
        sensor.focal_length_m,
        sensor.beacon_half_spacing_m,
        sensor.beacon_c_distance_m,
        PROJECTIONS[sensor.projection],
        jacobian,
        np.zeros((WORK_ROWS, 6)),
    )
    out = np.zeros((3, len(at.by_position)))
    out[:, :6] = jacobian if usable else math.nan
    return out


@dataclass(frozen=True)
class Settled:
    """A `spots` filter that has settled at one place.

    Attributes
    ----------
    state : SteadyState
        From the Riccati equation (`control`).
    covariance : (3, 3)
        Of (range m, azimuth rad, elevation rad), from noise alone, of spots and attitude; as the filter, with what a
        calibration leaves in R.
    bound : (3, 3)
        That of spot noise in closed form: each direction of the fix's information settles as a double integrator under
        white acceleration (Kalman-Bucy), sigma^2 = sqrt(2) q^(1/4) (r T)^(3/4) for noise r every T; NaN where
        unobservable.
    by_bias : (3, 2 n)
        Error of (range, azimuth, elevation) per lasting error of each coordinate; 0 for those not seen.
    """

    state: SteadyState
    covariance: Matrix
    bound: Matrix
    by_bias: Matrix


def settled(model: Model, at: Sensitivity, period_s: float) -> Settled:
    """The filter that takes every visible spot each `period_s`, camera staying where it is.

    With unknown attitude it takes what no turn of the camera moves, of A, B and C only. A lasting error e of the spots
    shifts the settled estimate by (I - (I - K H) Phi)^-1 K e.
    """
    n, density = model.orbit.mean_motion_rad_s, model.process_noise.acceleration_noise_density_m2_s3
    known, numbers = model.attitude.mode != "unknown", len(at.by_position)
    rows = at.rows if known else at.rows[at.rows < 6]
    nothing = np.full((3, 3), np.nan)
    to_angles = angles_by_position(at.position_m)
    if len(rows) < (1 if known else 6):
        nobody = SteadyState(False, np.full((6, 6), np.nan), np.full((6, 6), np.nan), np.empty((6, 0)), np.zeros(6))
        return Settled(nobody, nothing, nothing, np.full((3, numbers), np.nan))
    of_spots = whitener = np.diag(1.0 / np.hypot(at.sigma_m, at.lasting_m[:, None]).ravel()[rows])
    if not known:
        of_spots = whitener = null_space((whitener @ at.by_camera_turn[rows]).T).T @ whitener
    elif model.attitude.noise_rad > 0.0:
        turned = of_spots @ at.by_camera_turn[rows] * model.attitude.noise_rad
        whitener = np.linalg.inv(np.linalg.cholesky(np.eye(len(rows)) + turned @ turned.T)) @ of_spots
    h = np.zeros((len(rows), 6))
    h[:, :3] = at.by_position[rows] @ model.dcm_dock_from_lvlh
    phi = transition(n, period_s)
    state = _scaled_steady_state(phi, acceleration_noise(n, period_s, density), h, whitener)
    if not state.detectable:
        return Settled(state, nothing, nothing, np.full((3, numbers), np.nan))
    view = to_angles @ model.dcm_dock_from_lvlh
    gain = np.linalg.solve(np.eye(6) - (np.eye(6) - state.gain @ h) @ phi, state.gain)
    by_bias = np.zeros((3, numbers))
    by_bias[:, rows] = view @ gain[:3]
    whitened = of_spots @ at.by_position[rows]
    information = whitened.T @ whitened
    size, direction = np.linalg.eigh(information)
    if size[0] > 1e-12 * size[-1]:
        variance = np.sqrt(2.0) * density**0.25 * (period_s / size) ** 0.75
        bound = to_angles @ (direction * variance) @ direction.T @ to_angles.T
    else:
        bound = nothing
    return Settled(state, view @ state.posterior[:3, :3] @ view.T, bound, by_bias)


def _scaled_steady_state(phi: Matrix, q: Matrix, h: Matrix, whitener: Matrix) -> SteadyState:
    """`steady_state` in units in which its numbers are near one: close in, metres and the noise are far apart."""
    whitened = whitener @ h
    unit = float(1.0 / np.abs(whitened).max())
    scale = np.array([unit] * 3 + [unit / 10.0] * 3)  # m, m/s: seen within some ten seconds
    found = steady_state(
        phi * scale / scale[:, None], q / np.outer(scale, scale), whitened * scale, np.eye(len(whitened))
    )
    both = np.outer(scale, scale)
    return SteadyState(
        found.detectable,
        found.prior * both,
        found.posterior * both,
        found.gain * scale[:, None] @ whitener,
        found.observability,
    )
