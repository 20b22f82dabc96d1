"""Solve a frame of spots with what is known of its camera: a model, or little more than its focal length."""

import math

from numpy.typing import ArrayLike

from relnav.arrays import Vector
from relnav.errors import UsageError
from relnav.files.models import load_model
from relnav.files.star_catalogue import load_star_catalogue
from relnav.files.star_frames import StarFrame
from relnav.sensors.dual_field.blind import WIDEST_RAD, Blind, solve_blind
from relnav.sensors.dual_field.measure import (
    in_order_of_spots,
    measure,
    observer_velocity,
    spot_magnitudes,
    usable_spots,
)
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.solution import StarSolution

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


def solve_frame(
    frame: StarFrame,
    model_name: str | None,
    focal_px: float | None,
    epoch_jyear: float | None = None,
    velocity_km_s: tuple[float, float, float] | None = None,
) -> StarSolution:
    """Attitude of a frame: with a model's optics as known, or with the focal length estimated where one is given.

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
    if model is not None and focal_px is None:
        return measure(
            frame.spots_px,
            model,
            flux=frame.flux,
            magnitude=frame.magnitude,
            epoch_jyear=epoch_jyear,
            velocity_km_s=velocity_km_s,
        )
    return _solve_with_focal(frame, model, float(focal_px or 0.0), epoch_jyear, velocity_km_s)


def _solve_with_focal(
    frame: StarFrame,
    model: StarSensor | None,
    focal_px: float,
    epoch_jyear: float | None,
    velocity_km_s: tuple[float, float, float] | None,
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
    solution = solve_blind(blind, load_star_catalogue(), year if epoch_jyear is None else epoch_jyear)
    return in_order_of_spots(solution, order, len(frame.spots_px), solution.focal_length_px)
