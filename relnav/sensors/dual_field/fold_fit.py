"""The mirror's normal from frames of spots: each field identified by itself, one fit over all that agree."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Vector
from relnav.geometry.star_places import LIGHT_KM_S, aberration
from relnav.sensors.dual_field.fold_calibration import (
    FoldEstimate,
    IdentifiedFrame,
    calibrate_fold,
    identify_fields,
    mirror_of,
)
from relnav.sensors.dual_field.measure import prepare
from relnav.sensors.dual_field.sensor import StarSensor

ARCSEC = 648000.0 / math.pi
CONTRADICTION = 5.0
"""A frame whose own normal is so many of its own sigmas from that of all others is left out."""

LEAST_ERROR_RAD = 0.05 / ARCSEC
"""Of the model's star places: no fit over frames is better."""


@dataclass(frozen=True)
class FoldFit:
    """A mirror fitted over frames.

    Attributes
    ----------
    estimate : FoldEstimate
        The fit.
    used, left_out : tuple of int
        Frames that were fitted, and those that contradict them.
    """

    estimate: FoldEstimate
    used: tuple[int, ...]
    left_out: tuple[int, ...]

    @property
    def error_rad(self) -> float:
        """For a model's `[fold] error`: the larger of both sigmas."""
        return max(LEAST_ERROR_RAD, float(np.sqrt(np.max(np.diagonal(self.estimate.covariance)))))

    def figures(self, sensor: StarSensor) -> dict[str, Any]:
        """The normal and how well it is known, as plain values."""
        normal = np.asarray(sensor.fold.mirror_normal)
        off = math.acos(min(1.0, abs(float(self.estimate.normal @ normal))))
        return {
            "mirror_normal": self.estimate.normal.tolist(),
            "sigma_arcsec": (np.sqrt(np.diagonal(self.estimate.covariance)) * ARCSEC).tolist(),
            "error_arcsec": self.error_rad * ARCSEC,
            "off_model_arcsec": off * ARCSEC,
        }


def fit_fold(
    frames: Sequence[tuple[ArrayLike, ArrayLike | None, ArrayLike | None]],
    sensor: StarSensor,
    velocity_km_s: Vector,
    *,
    epoch_jyear: float | None = None,
) -> FoldFit:
    """Fit the mirror's normal over frames (spots_px (n, 2), flux, magnitude), without a prior for it.

    Raises
    ------
    ValueError
        If no frame shows both fields.
    """
    seen: list[tuple[int, IdentifiedFrame, FoldEstimate]] = []
    for k, (spots, flux, magnitude) in enumerate(frames):
        frame = _identified(sensor, spots, flux, magnitude, velocity_km_s, epoch_jyear)
        if frame is not None:
            normal = mirror_of(frame)
            if normal is not None:
                seen.append((k, frame, calibrate_fold([frame], normal)))
    if not seen:
        raise ValueError(f"none of {len(frames)} frames shows both fields with stars enough to identify each by itself")
    centre = _middle(np.array([estimate.normal for _, _, estimate in seen]))
    agree = [item for item in seen if _distance(item[2], centre) < CONTRADICTION]
    if not agree:
        raise ValueError(f"{len(seen)} frames show both fields, but no two agree on the mirror")
    estimate = calibrate_fold([frame for _, frame, _ in agree], centre)
    used = tuple(k for k, _, _ in agree)
    return FoldFit(estimate, used, tuple(k for k, _, _ in seen if k not in used))


def _identified(
    sensor: StarSensor,
    spots: ArrayLike,
    flux: ArrayLike | None,
    magnitude: ArrayLike | None,
    velocity_km_s: Vector,
    epoch_jyear: float | None,
) -> IdentifiedFrame | None:
    ready = prepare(spots, sensor, flux, magnitude, velocity_km_s)
    sky = sensor.sky(epoch_jyear)
    frame = identify_fields(
        ready.rays,
        sky,
        sigma_rad=ready.sigma_rad,
        magnitude=ready.magnitude,
        gate=sensor.identification.magnitude_gate,
        fainter_mag=sensor.fold.fainter_mag,
        velocity_km_s=velocity_km_s,
    )
    if frame is None:
        return None
    return dataclasses.replace(frame, v=aberration(frame.v, velocity_km_s / LIGHT_KM_S))


def _middle(normals: np.ndarray) -> Vector:
    """The normal with the smallest median distance from the others."""
    distance = np.linalg.norm(normals[:, None] - normals[None], axis=2)
    middle: Vector = normals[int(np.argmin(np.median(distance, axis=1)))]
    return middle


def _distance(estimate: FoldEstimate, normal: Vector) -> float:
    """Of a frame's normal from another one, in its own sigmas."""
    e = estimate.axes @ (estimate.normal - normal)
    return float(np.sqrt(e @ np.linalg.solve(estimate.covariance, e)))
