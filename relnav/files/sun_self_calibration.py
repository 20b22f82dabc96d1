"""A birefringent sun sensor's constants from a log of its own spots, without any attitude."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Flags, Stack, Vector
from relnav.errors import InputError
from relnav.files.sun_logs import read_sun_log
from relnav.sensors.birefringent_sun import BirefringentSunModel, SelfCalibration, self_calibrate
from relnav.sensors.birefringent_sun.direction import fit_two_spots, label_spots
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor

OUTLIER = 30.0
"""In medians of chi2: a pair that agrees so much worse than most is left out (1e-9 of good ones are)."""
MEDIAN_CHI2 = 2.0 * np.log(2.0)
MOST_LEFT_OUT, PASSES = 0.1, 10
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
    """

    model: str
    made: SelfCalibration
    frames: int
    not_seen: int
    left_out: list[int]

    def to_dict(self) -> dict[str, Any]:
        """Plain values, units as the names say."""
        sigma = np.sqrt(np.diag(self.made.covariance))
        return {
            "model": self.model,
            "frames": self.frames,
            "not_seen": self.not_seen,
            "left_out_lines": self.left_out,
            "chi2_per_dof": self.made.chi2_per_dof,
            "parameters": {
                name: {"value": float(value), "sigma": float(s)}
                for name, value, s in zip(self.made.free, self.made.values, sigma, strict=True)
            },
        }

    def section(self) -> str:
        """The keys of the model's [sensor] that were fitted, as they are to stand there."""
        lines, sensor = ["[sensor]"], self.made.sensor
        for name in dict.fromkeys(KEYS[name][0] for name in self.made.free):
            if name == "zero_spot_px":
                value = ", ".join(f"{entry:.4f}" for entry in sensor.zero_spot_px)
                lines.append(f'zero_spot_px = {{ value = [{value}], source = "derived", why = "self-calibration" }}')
                continue
            constant = next(key for key in self.made.free if KEYS[key][0] == name)
            value = f"{getattr(sensor, constant) * KEYS[constant][1]:.9g}"
            lines.append(f'{name} = {{ value = {value}, source = "derived", why = "self-calibration" }}')
        return "\n".join([*lines, ""])


def self_calibrate_sun(
    path: Path, model: BirefringentSunModel, free: tuple[str, ...], first_pixel_px: float = 0.0
) -> SunSelfCalibrationReport:
    """Fit constants to a log of spots (`read_sun_log`); pairs that contradict the others are left out and named.

    Raises
    ------
    InputError
        For a log that cannot be read, or frames that do not determine the constants.
    """
    log = read_sun_log(path, 2, first_pixel_px)
    seen = np.isfinite(log.spots_px).all(axis=(1, 2))
    spots, lines = log.spots_px[seen], log.lines[seen]
    try:
        made, used = _settled(model.sensor, spots, free)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    left_out = [int(line) for line in lines[~used]]
    return SunSelfCalibrationReport(model.name, made, int(used.sum()), int(np.sum(~seen)), left_out)


def _settled(sensor: BirefringentSunSensor, spots_px: Stack, free: tuple[str, ...]) -> tuple[SelfCalibration, Flags]:
    """The fit to the pairs that agree, and which these are; ValueError if it is not clear."""
    ordered, chi2 = _agreement(sensor, spots_px)
    used = _agreeing(chi2)
    for _ in range(PASSES):
        made = self_calibrate(sensor, ordered[used], free=free)
        ordered, chi2 = _agreement(made.sensor, spots_px)
        keep = _agreeing(chi2)
        if np.array_equal(keep, used):
            return made, used
        used = keep
    raise ValueError("which pairs of spots agree with the others does not settle; look at them")


def _agreeing(chi2: Vector) -> Flags:
    if len(chi2) == 0:
        raise ValueError("no image shows both spots")
    keep: Flags = chi2 < OUTLIER * max(MEDIAN_CHI2, float(np.median(chi2)))
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
