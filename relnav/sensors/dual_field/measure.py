"""The sensor's public call: spots of one frame in, inertial attitude with covariance and matched stars out."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from relnav.arrays import Codes, Matrix, Vector, number, numbers, one_piece
from relnav.geometry.rotation import is_rotation
from relnav.geometry.star_places import LIGHT_KM_S
from relnav.sensors.dual_field.frame_solver import (
    BETA,
    GATE,
    LEAST_SPOTS,
    MISFIT,
    SETTINGS,
    TOO_FEW,
    solve_spots,
    usable_spots_into,
)
from relnav.sensors.dual_field.identify import SINGLE_FIELD_REASON
from relnav.sensors.dual_field.search import AMBIGUOUS, FOUND, MOST_TRIED, WORK_ROWS
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution
from relnav.sensors.dual_field.tracking import IN_LINE, LEAST_STARS, WIDEST_PRIOR_RAD, track_spots

NO_MAGNITUDE = np.empty(0)
LOG_10 = math.log(10.0)

FASTEST_KM_S = 300.0
"""No spacecraft is faster; the search's first-order aberration is then off by (v/c)^2, 0.2 arcsec."""

WITHOUT_BRIGHTNESS = 30.0
"""A frame without brightness takes so many times more attitudes: every star may be every spot."""


def measure(
    spots_px: ArrayLike,
    model: StarSensor,
    *,
    flux: ArrayLike | None = None,
    magnitude: ArrayLike | None = None,
    epoch_jyear: float | None = None,
    velocity_km_s: ArrayLike | None = None,
) -> StarSolution:
    """Inertial attitude of the camera from the star spots of one frame, lost in space.

    Parameters
    ----------
    spots_px : (n, 2)
        Spots from the detector's centre, px, x right, y down; rows with NaN or off the detector are not used.
    model : StarSensor
        A loaded model, `relnav.load_model("dual_field_star")`.
    flux, magnitude : (n,), optional
        Brightness, one or the other; with it brightness is compared. Without, spots are brightest first.
    epoch_jyear : float, optional
        Julian year; the model's own if left out.
    velocity_km_s : (3,), optional
        Observer's barycentric velocity, ICRS, for aberration. With two fields it must be given (zeros if the frame has
        no aberration): 30 km/s change the angle between the fields by up to 21 arcsec, ten times a spot's error.

    Returns
    -------
    StarSolution
        Bad data never raise: the status says why there is no attitude.

    Raises
    ------
    ValueError
        For arrays of the wrong shape, both flux and magnitude, or two fields without a velocity.
    """
    frame = _checked(spots_px, model, flux, magnitude, velocity_km_s)
    n, sky, parameters = len(frame.spots), model.sky(_epoch(epoch_jyear)), frame.parameters
    if frame.without_brightness:
        parameters[SETTINGS + MOST_TRIED] *= WITHOUT_BRIGHTNESS
    found, star = np.empty(4 * n, dtype=np.int64), np.empty(n, dtype=np.int32)
    block = np.empty(21 + 10 * n + 3 * WORK_ROWS)
    verdict = solve_spots(frame.spots, frame.magnitude, parameters, *sky.arrays, sky.hip, star, found, block)
    focal = model.camera.focal_length_px
    if verdict != FOUND:
        return _refused(verdict, block, n, focal)
    return _solved(block, block[21 : 21 + n], star, found[3 * n :], model)


def _solved(block: Vector, residual: Vector, star: NDArray[np.int32], field: Codes, model: StarSensor) -> StarSolution:
    """What the kernels wrote, as a solution."""
    single = model.fold.kind != "none" and (not (field == 0).any() or not (field == 1).any())
    return StarSolution(
        StarStatus.SINGLE_FIELD if single else StarStatus.OK,
        SINGLE_FIELD_REASON if single else "",
        block[:9].reshape(3, 3),
        block[9:18].reshape(3, 3),
        star,
        field,
        residual,
        float(block[18]) / LOG_10,
        int(block[19]),
        model.camera.focal_length_px,
    )


def _refused(verdict: int, block: Vector, spots: int, focal_px: float) -> StarSolution:
    """Why there is no attitude."""
    tried = int(block[19])
    if verdict == TOO_FEW:
        status, reason = StarStatus.TOO_FEW, f"{int(block[20])} spots; {LEAST_SPOTS} or more are needed"
    elif verdict == MISFIT:
        status, reason = (
            StarStatus.NO_MATCH,
            f"stars are found, but the spots lie {block[20]:.1f} times as far from them as the model's noise: are "
            "focal length, distortion and mirror those of this camera, and is the velocity right?",
        )
    elif verdict == AMBIGUOUS:
        status, reason = StarStatus.AMBIGUOUS, "two attitudes explain the spots equally well"
    else:
        status, reason = StarStatus.NO_MATCH, f"none of {tried} attitudes explains the spots"
    return no_solution(status, reason, spots, tried=tried, focal_length_px=focal_px)


def track(
    spots_px: ArrayLike,
    model: StarSensor,
    dcm_prior: ArrayLike,
    sigma_prior_rad: float,
    *,
    flux: ArrayLike | None = None,
    magnitude: ArrayLike | None = None,
    epoch_jyear: float | None = None,
    velocity_km_s: ArrayLike | None = None,
) -> StarSolution:
    """Attitude near a predicted one, from two stars or more; arguments as in `measure`.

    Parameters
    ----------
    dcm_prior : (3, 3)
        Predicted dcm_cam_from_icrs: it says where to look, and nothing of the result.
    sigma_prior_rad : float
        Its 1-sigma about each axis, up to 6e-4 rad (124 arcsec).

    Raises
    ------
    ValueError
        As `measure`, and for a prior that is no rotation or too wide.
    """
    frame, prior = _checked(spots_px, model, flux, magnitude, velocity_km_s), numbers("dcm_prior", dcm_prior)
    if not is_rotation(prior):
        raise ValueError(f"dcm_prior is a rotation matrix (3, 3); got {prior.tolist()}")
    sigma_prior_rad = number("sigma_prior_rad", sigma_prior_rad)
    if not 0.0 < sigma_prior_rad <= WIDEST_PRIOR_RAD:
        raise ValueError(f"sigma_prior_rad is above 0 and up to {WIDEST_PRIOR_RAD:g} rad; got {sigma_prior_rad}")
    n, sky = len(frame.spots), model.sky(_epoch(epoch_jyear))
    found, star, block = np.empty(4 * n, dtype=np.int64), np.empty(n, dtype=np.int32), np.empty(27 + 10 * n)
    block[:9] = prior.ravel()
    verdict = track_spots(
        frame.spots, frame.magnitude, frame.parameters, sigma_prior_rad, *sky.arrays, sky.hip, star, found, block
    )
    if verdict == FOUND:
        return _solved(block, block[27 : 27 + n], star, found[3 * n :], model)
    seen, focal = int(block[20]), model.camera.focal_length_px
    if verdict == TOO_FEW:
        return no_solution(
            StarStatus.TOO_FEW, f"{seen} spots; {LEAST_STARS} or more are needed", n, focal_length_px=focal
        )
    reason = f"{seen} spots fall on stars near the prior attitude: chance might do as much"
    if verdict == IN_LINE:
        reason = "the stars found lie along one line"
    return no_solution(StarStatus.NO_MATCH, reason, n, tried=1, focal_length_px=focal)


class _Frame(NamedTuple):
    """A frame as the kernels read it: spots (n, 2) px, magnitude (n,) or (0,), parameters, and whether it has none."""

    spots: Matrix
    magnitude: Vector
    parameters: Vector
    without_brightness: bool


def _checked(
    spots_px: ArrayLike,
    model: StarSensor,
    flux: ArrayLike | None,
    magnitude: ArrayLike | None,
    velocity_km_s: ArrayLike | None,
) -> _Frame:
    """A frame for the kernels, or a ValueError that says what is wrong with it."""
    spots = one_piece("spots_px", spots_px)
    if spots.ndim != 2 or spots.shape[1] != 2:
        raise ValueError(f"spots_px has shape (n, 2), columns x, y in pixels; got {spots.shape}")
    if not isinstance(model, StarSensor):
        raise ValueError(f"model is a star sensor, relnav.load_model('dual_field_star'); got {type(model).__name__}")
    if velocity_km_s is None and model.fold.kind != "none":
        raise ValueError(
            "two fields need velocity_km_s, the observer's barycentric velocity (ICRS): aberration changes the angle "
            "between the fields; give zeros for a simulated frame without it"
        )
    parameters = model.parameters.copy()
    if velocity_km_s is not None:
        parameters[BETA : BETA + 3] = observer_velocity(velocity_km_s) / LIGHT_KM_S
    known = spot_magnitudes(flux, magnitude, len(spots), model.identification.magnitude_zero_point)
    if known is None:
        parameters[GATE] = math.inf
    return _Frame(spots, NO_MAGNITUDE if known is None else known, parameters, known is None)


def _epoch(jyear: float | None) -> float | None:
    return None if jyear is None else number("epoch_jyear", jyear)


def observer_velocity(value: ArrayLike) -> Vector:
    """A velocity (3,) km/s that stars can be seen from, or a ValueError that says so."""
    vector = numbers("velocity_km_s", value)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise ValueError(f"velocity_km_s is three finite numbers; got {vector.tolist()}")
    if np.abs(vector).max() > FASTEST_KM_S or np.linalg.norm(vector) > FASTEST_KM_S:
        raise ValueError(f"velocity_km_s is in km/s and up to {FASTEST_KM_S:g} in size; got {vector.tolist()}")
    return vector


def spot_magnitudes(
    flux: ArrayLike | None, magnitude: ArrayLike | None, spots: int, zero_point: float
) -> Vector | None:
    """Magnitudes (n,) from fluxes or as given; NaN for a flux that is not positive."""
    if flux is not None and magnitude is not None:
        raise ValueError("flux or magnitude is given, not both")
    given = flux if flux is not None else magnitude
    if given is None:
        return None
    name = "flux" if flux is not None else "magnitude"
    values = one_piece(name, given)
    if values.shape != (spots,):
        raise ValueError(f"{name} has one number a spot, shape ({spots},); got {values.shape}")
    if flux is None:
        return values
    lit = values > 0.0
    out: Vector = np.where(lit, zero_point - 2.5 * np.log10(np.where(lit, values, 1.0)), np.nan)
    return out


def usable_spots(spots: Matrix, magnitude: Vector | None, size_px: tuple[float, float]) -> Codes:
    """Indices of the spots that can be used, brightest first, at most `MOST_SPOTS`."""
    half = 0.5 * np.array(size_px)
    order = np.empty(len(spots), dtype=np.int64)
    given = NO_MAGNITUDE if magnitude is None else np.ascontiguousarray(magnitude)
    count = usable_spots_into(np.ascontiguousarray(spots), given, float(half[0]), float(half[1]), order)
    return order[:count]


def in_order_of_spots(solution: StarSolution, order: Codes, spots: int, focal_px: float) -> StarSolution:
    """The solution with its arrays in the order in which the spots were handed in."""
    hip, field, residual = np.zeros(spots, dtype=np.int32), np.full(spots, -1, dtype=np.int64), np.full(spots, np.nan)
    hip[order], field[order], residual[order] = solution.hip, solution.field, solution.residual_rad
    return dataclasses.replace(solution, hip=hip, field=field, residual_rad=residual, focal_length_px=focal_px)
