"""A birefringent sun sensor's constants from its spots: of known directions, or without any attitude."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Flags, Stack, Vector
from relnav.errors import InputError
from relnav.files.log_columns import Columns
from relnav.files.logs import read_csv
from relnav.files.sun_logs import columns_of, log_columns, sun_log_of
from relnav.files.sun_measurements import has_angles, turntable_columns
from relnav.files.sun_turntable import MOST_CHI2, KnownSuns, known_suns
from relnav.sensors.birefringent_sun import (
    BirefringentSunModel,
    SelfCalibration,
    TurntableCalibration,
    calibrate_known,
    self_calibrate,
)
from relnav.sensors.birefringent_sun.direction import fit_two_spots, label_spots
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor
from relnav.sensors.birefringent_sun.turntable import FREE as FREE_KNOWN
from relnav.sensors.birefringent_sun.turntable import in_order

OUTLIER = 30.0
"""In medians of chi2: a pair that agrees so much worse than most is left out (1e-9 of good ones are)."""
MEDIAN_CHI2, MEDIAN_CHI2_KNOWN = 2.0 * np.log(2.0), 3.357
MOST_LEFT_OUT, PASSES = 0.1, 10
FREE = ("zero_spot_x_px", "zero_spot_y_px")
KEYS = {
    "zero_spot_x_px": ("zero_spot_px", 1.0),
    "zero_spot_y_px": ("zero_spot_px", 1.0),
    "crystal_thickness_m": ("crystal_thickness_mm", 1e3),
    "axis_polar_rad": ("axis_polar_deg", 180.0 / np.pi),
    "axis_azimuth_rad": ("axis_azimuth_deg", 180.0 / np.pi),
    "ordinary_index": ("ordinary_index", 1.0),
    "extraordinary_index": ("extraordinary_index", 1.0),
}
"""Constant -> its key in a model's [sensor], and the factor to the key's unit."""


@dataclass(frozen=True)
class SunSelfCalibrationReport:
    """Constants found, and what they were found of.

    Attributes
    ----------
    made : SelfCalibration
        Constants and covariance.
    frames, not_seen : int
        Images with both spots, and without.
    left_out : list of int
        Lines of the file whose two spots contradict the others.
    known : TurntableCalibration, optional
        Where directions came with the spots; its errors are of the pairs that were fitted, each by the others.
    """

    model: str
    made: SelfCalibration
    frames: int
    not_seen: int
    left_out: list[int]
    known: TurntableCalibration | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain values, units as the names say."""
        sigma = np.sqrt(np.diag(self.made.covariance))
        figures: dict[str, Any] = {
            "model": self.model,
            "frames": self.frames,
            "not_seen": self.not_seen,
            "left_out_lines": self.left_out,
            "chi2_per_dof": self.made.chi2_per_dof,
            "spot_noise_px": self.made.sensor.spot_noise_px,
            "spot_noise_found_px": self.made.spot_noise_found_px,
            "covariance_factor": self.made.covariance_factor,
            "parameters": {
                name: {"value": float(value), "sigma": float(s)}
                for name, value, s in zip(self.made.free, self.made.values, sigma, strict=True)
            },
        }
        if self.known is not None:
            error = np.degrees(self.known.error_rad)
            figures |= {
                "alignment_deg": np.degrees(self.known.alignment_rad).tolist(),
                "alignment_sigma_deg": np.degrees(self.known.alignment_sigma_rad).tolist(),
                "error_after_3rms_deg": float(3.0 * np.sqrt(np.mean(error**2) / 2.0)),
                "error_after_max_deg": float(error.max()),
            }
        return figures

    def section(self) -> str:
        """The keys of the model's [sensor] that were fitted, as they are to stand there."""
        lines, sensor = ["[sensor]"], self.made.sensor
        why = "self-calibration" if self.known is None else "calibrated with known directions"
        for name in dict.fromkeys(KEYS[name][0] for name in self.made.free):
            if name == "zero_spot_px":
                value = ", ".join(f"{entry:.4f}" for entry in sensor.zero_spot_px)
                lines.append(f'zero_spot_px = {{ value = [{value}], source = "derived", why = "{why}" }}')
                continue
            constant = next(key for key in self.made.free if KEYS[key][0] == name)
            value = f"{getattr(sensor, constant) * KEYS[constant][1]:.9g}"
            lines.append(f'{name} = {{ value = {value}, source = "derived", why = "{why}" }}')
        return "\n".join([*lines, ""])


def calibrate_birefringent_sun(
    path: Path,
    model: BirefringentSunModel,
    free: tuple[str, ...] | None = None,
    first_pixel_px: float = 0.0,
    outer_axis: str = "x",
) -> SunSelfCalibrationReport:
    """Fit constants to spots: of known directions if the file has angles (`known_suns`), else to themselves.

    Pairs that contradict the others are left out and named. `free` are the constants; if left out, the opening's
    place, and with known directions the crystal's thickness and axis as well.

    Raises
    ------
    InputError
        For a file that cannot be read, or spots that do not determine the constants.
    """
    wanted = columns_of(2)

    def parse(names: list[str], where: str) -> Columns:
        return (
            turntable_columns(names, where, wanted, ("roll",))
            if has_angles(names)
            else log_columns(names, where, wanted)
        )

    _, columns, values, lines = read_csv(path, parse)
    try:
        if has_angles(list(columns.names)):
            suns = known_suns(path, columns, values, lines, model.sensor, first_pixel_px, outer_axis)
            return _known(model, suns, free)
        log = sun_log_of(path, columns, values, lines, 2, first_pixel_px)
        seen = np.isfinite(log.spots_px).all(axis=(1, 2))
        made, used = _settled(model.sensor, log.spots_px[seen], free or FREE)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    left_out = [int(line) for line in log.lines[seen][~used]]
    return SunSelfCalibrationReport(model.name, made, int(used.sum()), int(np.sum(~seen)), left_out)


def _known(model: BirefringentSunModel, suns: KnownSuns, free: tuple[str, ...] | None) -> SunSelfCalibrationReport:
    """The fit to the pairs that agree with their directions; ValueError if it is not clear which."""
    sensor = model.sensor
    spots, s = in_order(sensor, suns.spots_px, suns.directions), suns.directions
    used: Flags = np.ones(len(spots), dtype=bool)
    for _ in range(PASSES):
        made = calibrate_known(sensor, spots[used], s[used], free=free or FREE_KNOWN)
        keep = _agreeing(made.chi2_of(spots, s), MEDIAN_CHI2_KNOWN)
        if np.array_equal(keep, used):
            break
        used = keep
    else:
        raise ValueError("which pairs of spots agree with the others does not settle; look at them")
    if made.constants.chi2_per_dof > MOST_CHI2:
        raise ValueError(
            f"spots are {np.sqrt(made.constants.chi2_per_dof):.0f} times as far from where the angles put them as the "
            "model's spot_noise; are these a turntable's gimbal angles (columns outer, inner; --outer-axis), and not "
            "projection angles (alpha, beta), or the reverse, or is spot_noise too small?"
        )
    left_out = [int(line) for line in suns.lines[~used]]
    return SunSelfCalibrationReport(model.name, made.constants, int(used.sum()), suns.not_seen, left_out, made)


def _settled(sensor: BirefringentSunSensor, spots_px: Stack, free: tuple[str, ...]) -> tuple[SelfCalibration, Flags]:
    """The fit to the pairs that agree, and which these are; ValueError if it is not clear."""
    ordered, chi2 = _agreement(sensor, spots_px)
    used = _agreeing(chi2)
    for _ in range(PASSES):
        made = self_calibrate(sensor, ordered[used], free=free)
        ordered, chi2 = _agreement(made.sensor, spots_px)
        keep = _agreeing(chi2)
        if np.array_equal(keep, used):
            break
        used = keep
    else:
        raise ValueError("which pairs of spots agree with the others does not settle; look at them")
    if made.chi2_per_dof > MOST_CHI2:
        raise ValueError(
            f"the two spots of an image are {np.sqrt(made.chi2_per_dof):.0f} times as far from those of one direction "
            "as the model's spot_noise; are they of this sensor, or is spot_noise too small?"
        )
    return made, used


def _agreeing(chi2: Vector, median: float = MEDIAN_CHI2) -> Flags:
    if len(chi2) == 0:
        raise ValueError("no image shows both spots")
    keep: Flags = chi2 < OUTLIER * max(median, float(np.median(chi2)))
    if np.sum(~keep) > MOST_LEFT_OUT * len(keep):
        raise ValueError(
            f"{int(np.sum(~keep))} of {len(keep)} pairs of spots contradict the others; are they of this sensor?"
        )
    return keep


def _agreement(sensor: BirefringentSunSensor, spots_px: Stack) -> tuple[Stack, Vector]:
    """Pairs in the order o, e, and chi2 of each: two degrees of freedom, infinite where no direction explains it."""
    pitch = sensor.pixel_pitch_m
    spots_m = (spots_px - np.array(sensor.zero_spot_px)) * pitch
    swapped, _ = label_spots(sensor, spots_m, sensor.noise_m2)
    order = np.where(swapped[:, None, None], spots_px[:, ::-1], spots_px)
    chi2 = fit_two_spots(sensor, (order - np.array(sensor.zero_spot_px)) * pitch, sensor.noise_m2).chi2
    return order, np.where(np.isfinite(chi2), chi2, np.inf)
