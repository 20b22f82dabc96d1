"""Constants of the sensor from spots of known directions: a turntable's, or in flight those that stars tell.

What stands between the axes in which the directions are known and the sensor's is estimated with the constants: a small
turn, so that the crystal's own axes are the sensor's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector, numbers
from relnav.geometry.rotation_vector import turned
from relnav.sensors.birefringent_sun.direction import fit_two_spots
from relnav.sensors.birefringent_sun.self_calibration import (
    PARAMETERS,
    SelfCalibration,
    factor_of,
    with_constants,
)
from relnav.sensors.birefringent_sun.self_calibration import values_of as constants_of
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor
from relnav.sensors.birefringent_sun.spots import project

FREE = ("zero_spot_x_px", "zero_spot_y_px", "crystal_thickness_m", "axis_polar_rad", "axis_azimuth_rad")
"""What known directions determine well; the indices follow from the filter's wavelength."""
TURN_STEP_RAD = 1e-6
PASSES = 12
LEAST_SHARE = 1e-9
"""Of a unit column, that must be left of some combination of them."""


@dataclass(frozen=True)
class TurntableCalibration:
    """Estimated constants, and the orientation of the sensor in the axes of the known directions.

    Attributes
    ----------
    constants : SelfCalibration
        The sensor with the estimates in place, the estimates and their covariance, the uncertainty of the rotation
        included.
    alignment_rad, alignment_sigma_rad : (3,), (3,)
        Rotation vector from the axes of the known directions to the sensor's, and its 1-sigma.
    miss_px : (N, 4)
        Residuals of every pair of spots.
    error_rad : (N,)
        Angle between the direction from both spots and the known one, by constants that have not seen that pair; NaN
        if they give none.
    """

    constants: SelfCalibration
    alignment_rad: Vector
    alignment_sigma_rad: Vector
    miss_px: Matrix
    error_rad: Vector

    def chi2_of(self, spots_px: Stack, s: Matrix) -> Vector:
        """Chi-square (N,), four degrees of freedom, of labelled spots (N, 2, 2) px of directions s (N, 3)."""
        expected = project(self.constants.sensor, _turned(s, self.alignment_rad))
        chi2 = np.sum((spots_px - expected) ** 2, axis=(1, 2)) / self.constants.sensor.spot_noise_px**2
        return np.where(np.isfinite(chi2), chi2, np.inf)


def in_order(sensor: BirefringentSunSensor, spots_px: Stack, s: Matrix) -> Stack:
    """Pairs of spots (N, 2, 2) px, in either order, in the order o, e of their known directions s (N, 3).

    Of the two orders the nearer one: where both spots are off by the same, it is right whatever that is.
    """
    expected = project(sensor, s)
    as_given = np.sum((spots_px - expected) ** 2, axis=(1, 2))
    exchanged = np.sum((spots_px[:, ::-1] - expected) ** 2, axis=(1, 2))
    return np.where((exchanged < as_given)[:, None, None], spots_px[:, ::-1], spots_px)


def calibrate_known(
    sensor: BirefringentSunSensor, spots_px: ArrayLike, s: ArrayLike, *, free: Sequence[str] = FREE
) -> TurntableCalibration:
    """Estimate constants from labelled spots (N, 2, 2) px, rows o, e, of known directions s (N, 3), unit vectors.

    Gauss-Newton, starting from the sensor's values and no rotation between the axes. Where the residuals are larger
    than the sensor's spot noise explains, the sigmas are those of their size.

    Raises
    ------
    ValueError
        For another shape, unknown names, too few pairs, directions without spots, or directions that do not determine
        the constants.
    """
    spots, known, names = numbers("spots_px", spots_px), numbers("s", s), tuple(free)
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown:
        raise ValueError(f"unknown parameter {unknown[0]!r}; known are {', '.join(PARAMETERS)}")
    if spots.shape != (len(known), 2, 2) or 4 * len(spots) <= len(names) + 3:
        raise ValueError(
            f"more than {(len(names) + 3) // 4} pairs of spots (N, 2, 2), rows o, e, with a direction (N, 3) each are "
            f"expected; got {spots.shape} and {known.shape}"
        )
    x, noise = np.concatenate([constants_of(sensor, names), np.zeros(3)]), sensor.spot_noise_px
    for _ in range(PASSES):
        J, miss = _jacobian(sensor, names, x, known), (spots - _spots(sensor, names, x, known)).reshape(-1)
        if not (np.isfinite(miss).all() and np.isfinite(J).all()):
            raise ValueError("a direction shows no spots: it lies beside or behind the sensor")
        lengths = np.linalg.norm(J, axis=0)
        normal = (J / lengths).T @ (J / lengths)
        if np.linalg.eigvalsh(normal)[0] < LEAST_SHARE:
            raise ValueError(
                f"these directions do not determine {', '.join(names)} together; spread them or free fewer"
            )
        x = x + np.linalg.solve(normal, (J / lengths).T @ miss) / lengths
    miss = (spots - _spots(sensor, names, x, known)).reshape(-1)
    count, dof = len(names), miss.size - x.size
    made = with_constants(sensor, names, x[:count])
    chi2 = float(miss @ miss) / noise**2 / dof
    factor = factor_of(chi2, dof)
    covariance = factor * noise**2 * np.linalg.inv(normal) / np.outer(lengths, lengths)
    constants = SelfCalibration(made, names, x[:count], covariance[:count, :count], chi2, factor)
    held_out = _held_out(J / lengths, normal, miss).reshape(spots.shape)
    error = direction_error(made, _spots(sensor, names, x, known) + held_out, _turned(known, x[count:]))
    return TurntableCalibration(constants, x[count:], np.sqrt(np.diag(covariance)[count:]), miss.reshape(-1, 4), error)


def _held_out(J: Matrix, normal: Matrix, miss: Vector) -> Matrix:
    """Residuals (N, 4) of every pair from the constants that all others give: (I - leverage)^-1 times its own."""
    rows = J.reshape(-1, 4, J.shape[1])
    own: Stack = np.eye(4) - rows @ np.linalg.inv(normal) @ rows.transpose(0, 2, 1)
    return np.asarray(np.linalg.solve(own, miss.reshape(-1, 4, 1))[..., 0], dtype=np.float64)


def direction_error(sensor: BirefringentSunSensor, spots_px: Stack, s: Matrix) -> Vector:
    """Angle (N,) rad between what labelled spots (N, 2, 2) px tell of the sun and its directions s (N, 3)."""
    places = (spots_px - np.array(sensor.zero_spot_px)) * sensor.pixel_pitch_m
    u = fit_two_spots(sensor, places, sensor.noise_m2).u
    z = np.sqrt(np.maximum(1.0 - np.sum(u**2, axis=-1, keepdims=True), 0.0))
    found = np.concatenate([u, z], axis=-1)
    angle: Vector = np.arctan2(np.linalg.norm(np.cross(found, s), axis=-1), np.sum(found * s, axis=-1))
    return angle


def _turned(s: Matrix, rotation_vector: Vector) -> Matrix:
    out: Matrix = s @ turned(np.eye(3), rotation_vector).T
    return out


def _spots(sensor: BirefringentSunSensor, names: tuple[str, ...], x: Vector, s: Matrix) -> Stack:
    return project(with_constants(sensor, names, x[: len(names)]), _turned(s, x[len(names) :]))


def _jacobian(sensor: BirefringentSunSensor, names: tuple[str, ...], x: Vector, s: Matrix) -> Matrix:
    """d(spots px)/d(constants, turn), (4 N, p + 3), by central differences."""
    columns = []
    for k, step in enumerate([*(PARAMETERS[name] for name in names), *[TURN_STEP_RAD] * 3]):
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[k] += sign * step
            ends.append(_spots(sensor, names, moved, s).reshape(-1))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.column_stack(columns)
