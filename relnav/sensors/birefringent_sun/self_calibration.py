"""Constants of the sensor from its own frames, without any attitude: four coordinates, two unknowns a frame.

Each frame's direction is eliminated, and what is left of its four coordinates speaks about the constants. A plain hole
cannot do this: there a shift of the detector looks like another direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector, numbers
from relnav.sensors.birefringent_sun.direction import fit_two_spots
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor
from relnav.sensors.birefringent_sun.spots import spots_jacobian, spots_of_transverse

# name: step of the numeric derivative, SI or px
PARAMETERS = {
    "zero_spot_x_px": 1e-3,
    "zero_spot_y_px": 1e-3,
    "crystal_thickness_m": 1e-8,
    "axis_polar_rad": 1e-6,
    "axis_azimuth_rad": 1e-6,
    "ordinary_index": 1e-6,
    "extraordinary_index": 1e-6,
}
PASSES = 8
LEAST_SHARE = 1e-9
"""Of what the spots would say of a constant if the directions were known, that must be left where they are not."""
NOTABLE = 2.0
"""In standard deviations of a chi-square per degree of freedom: residuals larger by more are not of the stated noise,
of which chance shows one calibration in forty."""


@dataclass(frozen=True)
class SelfCalibration:
    """Estimated constants.

    Attributes
    ----------
    sensor : BirefringentSunSensor
        With the estimates in place.
    free : tuple of str
        What was estimated.
    values, covariance : (p,), (p, p)
        Estimates and their covariance, units as the names say, `covariance_factor` times that of the stated noise.
    chi2_per_dof : float
        1 if the model is right and the noise as stated.
    covariance_factor : float
        chi2_per_dof where that is significantly above 1, so that the residuals and not the model say how large the
        noise is; else 1.
    """

    sensor: BirefringentSunSensor
    free: tuple[str, ...]
    values: Vector
    covariance: Matrix
    chi2_per_dof: float
    covariance_factor: float = 1.0

    @property
    def spot_noise_found_px(self) -> float:
        """1-sigma of a spot coordinate that the residuals show."""
        return self.sensor.spot_noise_px * math.sqrt(self.chi2_per_dof)


def factor_of(chi2_per_dof: float, dof: int) -> float:
    """By what a covariance of the stated noise is to be multiplied: `SelfCalibration.covariance_factor`."""
    return chi2_per_dof if chi2_per_dof > 1.0 + NOTABLE * math.sqrt(2.0 / dof) else 1.0


def self_calibrate(
    sensor: BirefringentSunSensor, spots_px: ArrayLike, *, free: Sequence[str] = ("zero_spot_x_px", "zero_spot_y_px")
) -> SelfCalibration:
    """Estimate constants from frames of labelled spots (N, 2, 2) px, rows o, e; Gauss-Newton from the sensor's values.

    Where the residuals are larger than the sensor's spot noise explains, the covariance is that of their size.

    Raises
    ------
    ValueError
        For another shape, unknown names, too few frames, spots without a direction, or frames that do not determine
        the constants.
    """
    spots, names = numbers("spots_px", spots_px), tuple(free)
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown:
        raise ValueError(f"unknown parameter {unknown[0]!r}; known are {', '.join(PARAMETERS)}")
    if spots.shape[1:] != (2, 2) or 2 * len(spots) <= len(names):
        raise ValueError(f"more than {len(names) // 2} frames (N, 2, 2), rows o, e, are expected; got {spots.shape}")
    noise = sensor.spot_noise_px
    for _ in range(PASSES):
        u, miss = _fitted(sensor, spots)
        if not np.all(np.isfinite(miss)):
            raise ValueError("some pair of spots has no sun direction; leave it out")
        normal, right, alone = _reduced(sensor, names, u, miss)
        if np.linalg.eigvalsh(normal / np.sqrt(np.outer(alone, alone)))[0] < LEAST_SHARE:
            raise ValueError(f"these frames do not determine {', '.join(names)} together; spread them or free fewer")
        sensor = with_constants(sensor, names, values_of(sensor, names) + np.linalg.solve(normal, right))
    u, miss = _fitted(sensor, spots)
    normal, _, _ = _reduced(sensor, names, u, miss)
    dof = 2 * len(spots) - len(names)
    chi2 = float(np.sum(miss**2) / noise**2 / dof)
    factor = factor_of(chi2, dof)
    covariance = np.asarray(factor * noise**2 * np.linalg.inv(normal), dtype=np.float64)
    return SelfCalibration(sensor, names, values_of(sensor, names), covariance, chi2, factor)


def self_calibration_bound(sensor: BirefringentSunSensor, u: ArrayLike, free: Sequence[str]) -> Matrix:
    """Cramer-Rao bound (p, p) of the constants from frames of directions u (N, 2), without having made any image."""
    u = numbers("u", u)
    normal, _, _ = _reduced(sensor, tuple(free), u, np.zeros((len(u), 4)))
    return np.asarray(sensor.spot_noise_px**2 * np.linalg.inv(normal), dtype=np.float64)


def _fitted(sensor: BirefringentSunSensor, spots_px: Stack) -> tuple[Matrix, Matrix]:
    """Best directions u (N, 2) of every frame, and what is left of the spots (N, 4) px."""
    pitch = sensor.pixel_pitch_m
    measured = (spots_px - np.array(sensor.zero_spot_px)) * pitch
    u = fit_two_spots(sensor, measured, pitch**2 * np.eye(4)).u
    return u, ((measured - spots_of_transverse(sensor, u)) / pitch).reshape(-1, 4)


def _reduced(
    sensor: BirefringentSunSensor, names: tuple[str, ...], u: Matrix, miss: Matrix
) -> tuple[Matrix, Vector, Vector]:
    """Normal equations of the constants with every frame's direction eliminated, px.

    Third: the diagonal that they would have if the directions were known.
    """
    along = spots_jacobian(sensor, u) / sensor.pixel_pitch_m
    pseudo = np.linalg.solve(np.swapaxes(along, 1, 2) @ along, np.swapaxes(along, 1, 2))
    free_part = np.eye(4) - along @ pseudo
    values, columns = values_of(sensor, names), []
    for k, name in enumerate(names):
        ends = []
        for sign in (1.0, -1.0):
            moved = values.copy()
            moved[k] += sign * PARAMETERS[name]
            there = with_constants(sensor, names, moved)
            ends.append(np.array(there.zero_spot_px) + spots_of_transverse(there, u) / there.pixel_pitch_m)
        columns.append(((ends[0] - ends[1]) / (2.0 * PARAMETERS[name])).reshape(-1, 4))
    whole = np.stack(columns, axis=-1)
    flat: Matrix = (free_part @ whole).reshape(-1, len(names))
    return flat.T @ flat, flat.T @ miss.ravel(), np.sum(whole**2, axis=(0, 1))


def values_of(sensor: BirefringentSunSensor, names: tuple[str, ...]) -> Vector:
    """Values (p,) of constants."""
    place = {"zero_spot_x_px": 0, "zero_spot_y_px": 1}
    return np.array([sensor.zero_spot_px[place[n]] if n in place else getattr(sensor, n) for n in names])


def with_constants(sensor: BirefringentSunSensor, names: tuple[str, ...], values: Vector) -> BirefringentSunSensor:
    """The sensor with constants replaced."""
    changes = dict(zip(names, values.tolist(), strict=True))
    x, y = sensor.zero_spot_px
    zero = (changes.pop("zero_spot_x_px", x), changes.pop("zero_spot_y_px", y))
    return replace(sensor, zero_spot_px=zero, **changes)
