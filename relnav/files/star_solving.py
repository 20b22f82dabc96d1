"""Solve a frame of spots with what is known of its camera: a model, or little more than its focal length."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Vector
from relnav.errors import UsageError
from relnav.files.models import load_model
from relnav.files.star_catalogue import load_star_catalogue
from relnav.files.star_frames import StarFrame
from relnav.sensors.dual_field.blind import FIRST_SEARCH, FOCAL_RANGE, OTHER_SEARCHES, WIDEST_RAD, Blind, solve_blind
from relnav.sensors.dual_field.measure import (
    in_order_of_spots,
    measure,
    observer_velocity,
    spot_magnitudes,
    usable_spots,
)
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.solution import StarLens, StarSolution, StarStatus, no_solution
from relnav.sensors.dual_field.star_spots import picture_centre

FOCAL_STEP = 1.09
"""Between focal lengths that are tried: each covers 5 % to both sides."""
EPOCH_JYEAR = 2020.0
"""Of the stars' places where neither frame nor model says one: good to 2 arcsec for most stars within ten years."""


def load_star_sensor(name: str) -> StarSensor:
    """A model that describes a star sensor.

    Raises
    ------
    UsageError
        For a model of another kind.
    """
    model = load_model(name)
    if not isinstance(model, StarSensor):
        raise UsageError(f"{model.path}: a star sensor is expected (sensor_type dual_field), such as ground_camera")
    return model


def velocity_option(name: str, value: ArrayLike) -> Vector:
    """A velocity (3,) km/s from the command line.

    Raises
    ------
    UsageError
        For one that stars cannot be seen from, naming the option.
    """
    try:
        return observer_velocity(value)
    except ValueError as error:
        raise UsageError(f"{name}: {error}") from error


def origin_of_spots(
    model: StarSensor | None,
    centre_px: tuple[float, float] | None = None,
    size_px: tuple[float, float] | None = None,
    first_pixel_px: str | None = None,
) -> Vector:
    """Where the image's centre (2,) stands in a file's coordinates, from what options and model say.

    Raises
    ------
    UsageError
        If they contradict one another.
    """
    if centre_px is not None:
        if not all(math.isfinite(value) for value in centre_px):
            raise UsageError(f"--centre-px is two numbers of pixels; got {centre_px[0]} {centre_px[1]}")
        if size_px is not None or first_pixel_px is not None:
            raise UsageError("--centre-px and --image-size-px say the same; keep one")
        return np.array(centre_px)
    if first_pixel_px is None:
        first_pixel_px = "0" if model is None or model.camera.first_pixel_px == "none" else model.camera.first_pixel_px
        if size_px is None and (model is None or model.camera.first_pixel_px == "none"):
            return np.zeros(2)
    if size_px is None:
        if model is None:
            raise UsageError("--first-pixel-px needs --image-size-px WIDTH HEIGHT, or --model")
        size_px = model.camera.detector_size_px
    return picture_centre(size_px, float(first_pixel_px))


def solve_frame(
    frame: StarFrame,
    model_name: str | None,
    focal_px: float | None,
    epoch_jyear: float | None = None,
    velocity_km_s: tuple[float, float, float] | None = None,
    *,
    focal_error: float = FOCAL_RANGE,
    mirrored: bool = False,
) -> StarSolution:
    """Attitude of a frame: with a model's optics as known, or with the focal length estimated where one is given.

    `focal_error` is how far it may be off, relative; of a mirrored frame the spots' y counts up.

    Raises
    ------
    UsageError
        Without model and focal length, or for one that is no number; for two fields without a velocity or with an
        unknown focal length; for an impossible velocity.
    """
    model = None if model_name is None else load_star_sensor(model_name)
    if model is None and focal_px is None:
        raise UsageError("--model or --focal-px is needed: the camera, or at least its focal length to 5 %")
    if focal_px is not None and not 0.0 < focal_px < math.inf:
        raise UsageError(f"--focal-px is a focal length in pixels; got {focal_px}")
    if velocity_km_s is not None:
        velocity_option("--velocity-km-s", velocity_km_s)
    two_fields = model is not None and model.fold.kind != "none"
    if two_fields and focal_px is not None:
        raise UsageError(
            "--focal-px estimates the camera of a single field; a two-field model needs its own focal length"
        )
    if two_fields and velocity_km_s is None:
        raise UsageError(
            "two fields need --epoch and --velocity-km-s: aberration changes the angle between them by up to 21 arcsec "
            "(0 0 0 for a simulated frame without it)"
        )
    if focal_px is not None and frame.covariance_px2 is not None:
        raise UsageError("--residual-px needs a camera that is known: --model without --focal-px")
    if mirrored:
        frame = _unmirrored(frame)
    if model is not None and focal_px is None:
        solution = _solve_with_model(frame, model, epoch_jyear, velocity_km_s)
        return replace(solution, lens=_known_lens(model, solution)) if solution.ok else solution
    solution, steps = no_solution(StarStatus.NO_MATCH, "", 0), focal_steps(focal_error)
    tried = dict.fromkeys(steps, 0)
    for searches in (FIRST_SEARCH, OTHER_SEARCHES):  # the short one with every focal length before the long ones
        for step in steps:
            focal = step * float(focal_px or 0.0)
            solution = _solve_with_focal(frame, model, focal, epoch_jyear, velocity_km_s, searches, tried[step])
            if solution.status is not StarStatus.NO_MATCH:
                return solution
            tried[step] = solution.tried
    if focal_error > FOCAL_RANGE:
        reason = f"no attitude with a focal length within {focal_error:.0%} of {focal_px:g} px explains the spots"
        return replace(solution, reason=reason)
    return solution


def _unmirrored(frame: StarFrame) -> StarFrame:
    """The frame with y counted the other way."""
    flip, own = np.array([1.0, -1.0]), frame.covariance_px2
    return replace(
        frame,
        spots_px=frame.spots_px * flip,
        covariance_px2=None if own is None else own * np.outer(flip, flip),
    )


def focal_steps(error: float) -> list[float]:
    """Factors of a focal length known to `error`, relative, the nearest to 1 first; each covers `FOCAL_RANGE`."""
    steps, k = [1.0], 1
    if error <= FOCAL_RANGE:
        return steps
    while FOCAL_STEP ** (k - 1) * (1.0 + FOCAL_RANGE) < 1.0 / (1.0 - error) - 1e-9:
        steps += [FOCAL_STEP**k, FOCAL_STEP**-k]
        k += 1
    return steps


def _solve_with_model(
    frame: StarFrame,
    model: StarSensor,
    epoch_jyear: float | None,
    velocity_km_s: tuple[float, float, float] | None,
) -> StarSolution:
    """By brightness; where nothing matches, by the order of the fluxes alone: an exposure has its own zero point."""
    solution = measure(
        frame.spots_px,
        model,
        flux=frame.flux,
        magnitude=frame.magnitude,
        epoch_jyear=epoch_jyear,
        velocity_km_s=velocity_km_s,
        spot_covariance_px2=frame.covariance_px2,
    )
    if solution.status is not StarStatus.NO_MATCH or frame.flux is None:
        return solution
    order = np.argsort(-frame.flux, kind="stable")
    own = None if frame.covariance_px2 is None else frame.covariance_px2[order]
    again = measure(
        frame.spots_px[order], model, epoch_jyear=epoch_jyear, velocity_km_s=velocity_km_s, spot_covariance_px2=own
    )
    if not again.ok:
        return solution
    again = replace(again, reason="brightness was not compared: the fluxes do not fit the model's magnitude_zero_point")
    return in_order_of_spots(again, order, len(order), again.focal_length_px)


def _known_lens(model: StarSensor, solution: StarSolution) -> StarLens:
    camera = model.camera
    return StarLens(camera.focal_length_px, camera.principal_point_px, camera.distortion, solution.dcm_cam_from_icrs)


def _solve_with_focal(
    frame: StarFrame,
    model: StarSensor | None,
    focal_px: float,
    epoch_jyear: float | None,
    velocity_km_s: tuple[float, float, float] | None,
    searches: slice,
    tried: int,
) -> StarSolution:
    magnitude = spot_magnitudes(frame.flux, frame.magnitude, len(frame.spots_px), 0.0)
    widest = 2.0 * focal_px * math.tan(WIDEST_RAD)
    width, height = (widest, widest) if model is None else model.camera.detector_size_px
    order = usable_spots(frame.spots_px, magnitude, (min(width, widest), min(height, widest)))
    blind = Blind(
        frame.spots_px[order],
        None if magnitude is None else magnitude[order],
        focal_px,
        principal_px=(0.0, 0.0) if model is None else model.camera.principal_point_px,
        distortion=(0.0, 0.0) if model is None else model.camera.distortion,
        lens_known=model is not None,
        velocity_km_s=velocity_km_s,
    )
    year = EPOCH_JYEAR if model is None else model.identification.epoch_jyear
    epoch = year if epoch_jyear is None else epoch_jyear
    solution = solve_blind(blind, load_star_catalogue(), epoch, searches=searches, tried=tried)
    return in_order_of_spots(solution, order, len(frame.spots_px), solution.focal_length_px)
