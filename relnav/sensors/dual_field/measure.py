"""The sensor's public call: spots of one frame in, inertial attitude with covariance and matched stars out."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from relnav.arrays import LARGEST, Codes, Matrix, Stack, Vector, number, numbers, one_piece
from relnav.geometry.star_places import LIGHT_KM_S
from relnav.sensors.dual_field.focal_length import OFF_FOCAL, SUSPECTED, Outcome, solve_with_tolerance
from relnav.sensors.dual_field.frame_solver import (
    BETA,
    BLOCK,
    BLOCK_SPOT,
    GATE,
    OFF_FOLD,
    SETTINGS,
    TOO_FEW,
    solve_spots,
    usable_spots_into,
)
from relnav.sensors.dual_field.identify import OFF_FOLD_REASON, SINGLE_FIELD_REASON
from relnav.sensors.dual_field.optics import plane_points, ray_sigma, rays
from relnav.sensors.dual_field.refusal import (
    BY_FOCAL_LENGTH,
    FOR_THE_REASON,
    OFF_FOCAL_REASON,
    SURELY,
    off_focal,
    refused,
)
from relnav.sensors.dual_field.search import FOUND, MOST_TRIED
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution
from relnav.sensors.dual_field.tracking import (
    ALONG_A_LINE,
    FOUND_ALONE,
    LEAST_STARS,
    NO_ROTATION,
    WIDEST_PRIOR_RAD,
    track_spots,
)

NO_MAGNITUDE = np.empty(0)
NO_COVARIANCES = np.empty((0, 2, 2))
LOG_10 = math.log(10.0)

FASTEST_KM_S = 300.0
"""No spacecraft is faster; the search's first-order aberration is then off by (v/c)^2, 0.2 arcsec."""

FARTHEST_JYEAR = 1e4
"""A Julian day, or seconds since some date, is no year."""

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
    spot_covariance_px2: ArrayLike | None = None,
) -> StarSolution:
    """Inertial attitude of the camera from the star spots of one frame, lost in space.

    Parameters
    ----------
    spots_px : (n, 2)
        Spots from the detector's centre, px, x right, y down; rows with NaN or off the detector are not used.
    model : StarSensor
        A loaded model, `relnav.load_model("dual_field_star")`.
    flux, magnitude : (n,), optional
        Brightness, one or the other, which is compared with the catalogue. Without it spots are in order, brightest
        first.
    epoch_jyear : float, optional
        Julian year; the model's own if left out.
    velocity_km_s : (3,), optional
        Observer's barycentric velocity, ICRS, for aberration. With two fields it must be given (zeros if the frame has
        no aberration): 30 km/s change the angle between the fields by up to 21 arcsec, ten times a spot's error.
    spot_covariance_px2 : (n, 2, 2), optional
        Of each spot, with what the distortion model leaves; (model's spot_noise_px)^2 of each coordinate if left out.
        Bright spots then count for more than faint ones.

    Returns
    -------
    StarSolution
        Bad data never raise: the status says why there is no attitude.

    Raises
    ------
    ValueError
        For arrays of the wrong shape, both flux and magnitude, two fields without a velocity, or a matrix that is no
        covariance.
    """
    spots, mag, velocity = _checked(spots_px, model, flux, magnitude, velocity_km_s)
    sky, parameters = model.sky(_epoch(epoch_jyear)), _parameters(model, mag, velocity)
    own = _covariances(spot_covariance_px2, spots)
    star, found, block = _room(len(spots))
    brightness = NO_MAGNITUDE if mag is None else mag
    focal, sigma = model.camera.focal_length_px, model.camera.focal_length_relative_sigma

    def solve(covariances: Stack, numbers: Vector) -> Outcome:
        room = _room(len(spots))
        return Outcome(
            solve_spots(spots, covariances, brightness, numbers, *sky.arrays, sky.hip, *room), room[2], *room[:2]
        )

    if sigma > 0.0:
        outcome, focal, _ = solve_with_tolerance(solve, spots, brightness, own, parameters, sky, sigma)
        verdict, block, star, found = outcome
    else:
        verdict = solve_spots(spots, own, brightness, parameters, *sky.arrays, sky.hip, star, found, block)
    if verdict == FOUND:
        return _solution(StarStatus.OK, "", block, star, found, focal)
    if verdict in BY_FOCAL_LENGTH:
        suspected, parameters = max(SUSPECTED, 3.0 * sigma), parameters.copy()
        parameters[SETTINGS + MOST_TRIED] *= FOR_THE_REASON
        outcome, focal, sigmas = solve_with_tolerance(solve, spots, brightness, own, parameters, sky, suspected)
        if outcome.ok and sigmas > SURELY:
            return off_focal(focal, int(block[19]), len(spots), model.camera)
    return refused(verdict, block, len(spots), model.camera, told=len(own) > 0)


def _parameters(model: StarSensor, magnitude: Vector | None, velocity_km_s: Vector | None) -> Vector:
    """The model's numbers for one frame."""
    parameters = model.parameters
    if velocity_km_s is not None or magnitude is None:
        parameters = parameters.copy()
        if velocity_km_s is not None:
            parameters[BETA : BETA + 3] = velocity_km_s / LIGHT_KM_S
        if magnitude is None:
            parameters[GATE] = math.inf
            parameters[SETTINGS + MOST_TRIED] *= WITHOUT_BRIGHTNESS
    return parameters


def _room(n: int) -> tuple[NDArray[np.int32], Codes, Vector]:
    """Star, `found` and `block` of a frame of n spots, for the compiled solvers."""
    return np.empty(n, dtype=np.int32), np.empty(4 * n, dtype=np.int64), np.empty(BLOCK + BLOCK_SPOT * n)


def _solution(
    status: StarStatus, reason: str, block: Vector, star: NDArray[np.int32], found: Codes, focal_px: float
) -> StarSolution:
    n = len(star)
    return StarSolution(
        status,
        reason,
        block[:9].reshape(3, 3),
        block[9:18].reshape(3, 3),
        star,
        found[3 * n :],
        block[21 : 21 + n],
        float(block[18]) / LOG_10,
        int(block[19]),
        focal_px,
    )


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
    spot_covariance_px2: ArrayLike | None = None,
) -> StarSolution:
    """Attitude near a predicted one, from two stars or more; arguments as in `measure`.

    Parameters
    ----------
    dcm_prior : (3, 3)
        Predicted dcm_cam_from_icrs: it limits the search and does not enter the result.
    sigma_prior_rad : float
        Its 1-sigma about each axis, up to 6e-4 rad (124 arcsec).

    Raises
    ------
    ValueError
        As `measure`, and for a prior that is no rotation or too wide.
    """
    prior = one_piece("dcm_prior", dcm_prior)
    sigma_prior_rad = number("sigma_prior_rad", sigma_prior_rad)
    if not 0.0 < sigma_prior_rad <= WIDEST_PRIOR_RAD:
        raise ValueError(f"sigma_prior_rad is above 0 and up to {WIDEST_PRIOR_RAD:g} rad; got {sigma_prior_rad}")
    spots, mag, velocity = _checked(spots_px, model, flux, magnitude, velocity_km_s)
    own = _covariances(spot_covariance_px2, spots)
    sky, (star, found, block) = model.sky(_epoch(epoch_jyear)), _room(len(spots))
    verdict, focal, sigma = NO_ROTATION, model.camera.focal_length_px, model.camera.focal_length_relative_sigma
    if prior.shape == (3, 3):
        brightness = NO_MAGNITUDE if mag is None else mag
        parameters = _parameters(model, mag, velocity)

        def solve(covariances: Stack, numbers: Vector) -> Outcome:
            star, found, block = _room(len(spots))
            block[:9] = prior.ravel()
            told = track_spots(
                spots, covariances, brightness, numbers, sigma_prior_rad, *sky.arrays, sky.hip, star, found, block
            )
            return Outcome(told, block, star, found)

        outcome = solve(own, parameters)
        if sigma > 0.0 and outcome.verdict != NO_ROTATION:
            outcome, focal, _ = solve_with_tolerance(solve, spots, brightness, own, parameters, sky, sigma)
        verdict, block, star, found = outcome
    if verdict == NO_ROTATION:
        raise ValueError(f"dcm_prior is a rotation matrix (3, 3); got {prior.tolist()}")
    seen = int(block[20])
    if verdict == FOUND:
        return _solution(StarStatus.OK, "", block, star, found, focal)
    if verdict == FOUND_ALONE:
        return _solution(StarStatus.SINGLE_FIELD, SINGLE_FIELD_REASON, block, star, found, focal)
    status, reason = {
        TOO_FEW: (StarStatus.TOO_FEW, f"{seen} spots; {LEAST_STARS} or more are needed"),
        ALONG_A_LINE: (StarStatus.NO_MATCH, "the stars found lie along one line"),
        OFF_FOLD: (StarStatus.NO_MATCH, OFF_FOLD_REASON),
        OFF_FOCAL: (StarStatus.NO_MATCH, OFF_FOCAL_REASON),
    }.get(
        verdict,
        (StarStatus.NO_MATCH, f"{seen} spots fall on stars near the prior attitude: chance might do as much"),
    )
    return no_solution(status, reason, len(spots), tried=int(block[19]), focal_length_px=focal)


class Ready(NamedTuple):
    """A frame's usable spots, brightest first, as rays; `order` leads back to the spots as handed in."""

    rays: Matrix
    sigma_rad: Vector
    magnitude: Vector | None
    fold: Matrix | None
    velocity_km_s: Vector | None
    order: Codes
    spots: int


def _checked(
    spots_px: ArrayLike,
    model: StarSensor,
    flux: ArrayLike | None,
    magnitude: ArrayLike | None,
    velocity_km_s: ArrayLike | None,
) -> tuple[Matrix, Vector | None, Vector | None]:
    """Spots, magnitudes and velocity as arrays, or a ValueError that says what is wrong with them."""
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
    velocity = None if velocity_km_s is None else observer_velocity(velocity_km_s)
    return spots, spot_magnitudes(flux, magnitude, len(spots), model.identification.magnitude_zero_point), velocity


def prepare(
    spots_px: ArrayLike,
    model: StarSensor,
    flux: ArrayLike | None,
    magnitude: ArrayLike | None,
    velocity_km_s: ArrayLike | None,
) -> Ready:
    """Spots as rays; arguments, and the ValueError, as in `measure`."""
    spots, mag, velocity = _checked(spots_px, model, flux, magnitude, velocity_km_s)
    camera = model.camera
    order = usable_spots(spots, mag, camera.detector_size_px)
    points = plane_points(spots[order], camera.focal_length_px, camera.principal_point_px, camera.distortion)
    sigma = ray_sigma(points, camera.spot_noise_px, camera.focal_length_px)
    fold = model.fold.matrix
    return Ready(rays(points), sigma, None if mag is None else mag[order], fold, velocity, order, len(spots))


def _covariances(spot_covariance_px2: ArrayLike | None, spots: Matrix) -> Stack:
    """The spots' own (n, 2, 2), or none (0, 2, 2), or a ValueError that says what is wrong with them."""
    if spot_covariance_px2 is None:
        return NO_COVARIANCES
    own = one_piece("spot_covariance_px2", spot_covariance_px2)
    if own.shape != (len(spots), 2, 2):
        raise ValueError(f"spot_covariance_px2 has shape ({len(spots)}, 2, 2), one a spot; got {own.shape}")
    xx, xy, yx, yy = own.reshape(-1, 4).T
    with np.errstate(over="ignore", invalid="ignore"):
        even = np.abs(xy - yx) <= 1e-9 * np.sqrt(xx * yy)
        usable = even & (xx > 0.0) & (xy * yx < xx * yy) & np.isfinite(xx * yy) & (np.maximum(xx, yy) <= LARGEST**2)
    wrong = np.flatnonzero(~usable & np.isfinite(spots).all(axis=1))
    if len(wrong):
        raise ValueError(
            "spot_covariance_px2 has symmetric, positive definite matrices in px^2; got "
            f"{own[wrong[0]].tolist()} for spot {wrong[0]}"
        )
    return own


def _epoch(jyear: float | None) -> float | None:
    year = None if jyear is None else number("epoch_jyear", jyear)
    if year is not None and not abs(year) <= FARTHEST_JYEAR:
        raise ValueError(f"epoch_jyear is a Julian year, up to {FARTHEST_JYEAR:g}; got {jyear!r}")
    return year


def observer_velocity(value: ArrayLike) -> Vector:
    """A velocity (3,) km/s that stars can be seen from, or a ValueError that says so."""
    vector = numbers("velocity_km_s", value)
    if vector.shape != (3,) or not all(map(math.isfinite, vector.tolist())):
        raise ValueError(f"velocity_km_s is three finite numbers; got {vector.tolist()}")
    if math.hypot(*vector.tolist()) > FASTEST_KM_S:
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
    half = 0.5 * np.asarray(size_px, dtype=np.float64)
    order = np.empty(len(spots), dtype=np.int64)
    given = NO_MAGNITUDE if magnitude is None else np.ascontiguousarray(magnitude)
    count = usable_spots_into(np.ascontiguousarray(spots), given, float(half[0]), float(half[1]), order)
    return order[:count]


def in_order_of_spots(solution: StarSolution, order: Codes, spots: int, focal_px: float) -> StarSolution:
    """The solution with its arrays in the order in which the spots were handed in."""
    hip, field, residual = np.zeros(spots, dtype=np.int32), np.full(spots, -1, dtype=np.int64), np.full(spots, np.nan)
    hip[order], field[order], residual[order] = solution.hip, solution.field, solution.residual_rad
    return dataclasses.replace(solution, hip=hip, field=field, residual_rad=residual, focal_length_px=focal_px)
