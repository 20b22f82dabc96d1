"""Calibration files of the APS sun sensor: made from a table of measurements, written, and read back the same."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Matrix
from relnav.errors import InputError
from relnav.files.paths import path_of
from relnav.files.sun_measurements import SunMeasurements, read_sun_measurements
from relnav.files.tables import read_json, relnav_version, write_json
from relnav.geometry.projection_angles import direction_from_gimbal
from relnav.sensors.aps_sun.calibration import Calibration, CalibrationResult, calibrate
from relnav.sensors.aps_sun.patent import PatentTables
from relnav.sensors.aps_sun.physical import fit_physical
from relnav.sensors.aps_sun.rays import pinhole_angles
from relnav.sensors.aps_sun.sensor import ApsSunModel
from relnav.sensors.aps_sun.table import DirectionTable

FORMAT = "relnav sun calibration 1"
FEWEST_DEG = 5.0
SUSPICIOUS_NOISE = 5.0
TRIAL_POINTS = 200


@dataclass(frozen=True)
class SunCalibrationReport:
    """A calibration with the measurements it came from.

    Attributes
    ----------
    before_rad : (N, 2)
        Error of (alpha, beta) at every point of a plain hole with the model's optical height: nothing compensated.
    """

    model: str
    measurements: SunMeasurements
    result: CalibrationResult
    before_rad: Matrix

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Points (N,) that the figures of the error are of: fitted, and within the calibrated field."""
        return self.result.used & np.isfinite(self.result.error_rad).all(axis=1)

    @property
    def left_out(self) -> list[tuple[int, float]]:
        """Line in the file of every point that the others contradict, and how far its spot is off, px."""
        return [
            (int(self.measurements.lines[k]), float(self.result.left_px[k])) for k in np.flatnonzero(~self.result.used)
        ]

    def to_dict(self) -> dict[str, Any]:
        """Figures of the calibration as plain values; errors in deg, `after` of points held out, spots in px."""
        result, fit = self.result, self.result.fit
        before, after = self.before_rad[self.counted], self.result.error_rad[self.counted]
        figures: dict[str, Any] = {
            "model": self.model,
            "measurements": self.measurements.path.name,
            "points": len(self.measurements.spots_px),
            "points_in_field": int(self.counted.sum()),
            "left_out_lines": [line for line, _ in self.left_out],
            "not_seen": self.measurements.not_seen,
            "method": result.calibration.method,
            "field_half_angle_deg": float(np.degrees(result.calibration.field_half_angle_rad)),
            "spot_noise_px": result.calibration.spot_noise_px,
            "calibration_noise_px": result.calibration.calibration_noise_px,
            "error_before_3rms_deg": _three_rms(before),
            "error_before_max_deg": float(np.degrees(np.abs(before).max())),
            "error_after_3rms_deg": _three_rms(after),
            "error_after_max_deg": float(np.degrees(np.abs(after).max())),
            "compile_loss_deg": float(np.degrees(result.compile_loss_rad)),
        }
        if fit is not None:
            sigma = np.sqrt(np.diag(fit.covariance))
            figures |= {
                "spot_residual_rms_px": fit.rms_px,
                "chi2_per_dof": fit.chi2_per_dof,
                "condition": fit.condition,
                "parameters": {
                    name: {"value": float(value), "sigma": float(s)}
                    for name, value, s in zip(fit.free, fit.values, sigma, strict=True)
                },
            }
        if result.residual is not None:
            figures["held_out_rms_px"] = {
                "no spline" if np.isinf(key) else f"stiffness {key:g}": float(np.sqrt(value))
                for key, value in result.residual.tried.items()
            }
        return figures


def calibrate_sun(
    path: Path,
    model: ApsSunModel,
    *,
    method: str = "auto",
    outer_axis: str = "x",
    incomplete: bool = False,
    seed: int = 0,
) -> SunCalibrationReport:
    """Calibrate a sun sensor from a file of measurements.

    The field of the calibration is what the points reach on every side, at most the model's.

    Raises
    ------
    InputError
        For measurements that cannot be used, see `read_sun_measurements`; if gimbal angles came under the names of
        projection angles; or if the points do not determine the calibration.
    """
    if incomplete and method == "patent":
        raise InputError(f"{path}: the patent's tables need the full grid; leave out --incomplete")
    measured = read_sun_measurements(path, model, outer_axis=outer_axis, incomplete=incomplete)
    angles = measured.angles_rad
    reach = float(min(angles.max(axis=0).min(), -angles.min(axis=0).max()))
    if np.degrees(reach) < FEWEST_DEG:
        raise InputError(
            f"{path}: the points reach {np.degrees(reach):.1f} deg on the shortest side; measure over the whole field"
        )
    field = min(model.sensor.field_half_angle_rad, reach)
    try:
        result = calibrate(measured.spots_px, measured.directions, _with_field(model, field), method=method, seed=seed)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    if result.fit is not None and not measured.gimbal:
        _refuse_gimbal_angles(measured, model, result.fit.rms_px, outer_axis)
    return SunCalibrationReport(model.name, measured, result, pinhole_angles(model, measured.spots_px) - angles)


def write_sun_calibration(report: SunCalibrationReport, path: Path) -> None:
    """Write a calibration file (.json): the run-time form, and the figures of the calibration for the reader."""
    calibration = report.result.calibration
    form = calibration.form
    head = {"format": FORMAT, "relnav": relnav_version(), **report.to_dict()}
    if isinstance(form, DirectionTable):
        head["table"] = {
            "x_px": form.x_px.tolist(), "y_px": form.y_px.tolist(), "tangents": form.tangents.tolist(),
        }  # fmt: skip
    else:
        head["patent"] = {
            "x0_px": form.x0_px, "y0_px": form.y0_px, "h_px": form.h_px, "limit_deg": form.limit_deg,
            "radial": form.radial.tolist(), "rows": form.rows.tolist(),
        }  # fmt: skip
    write_json(head, path)


def load_sun_calibration(path: str | os.PathLike[str]) -> Calibration:
    """Read a calibration file that `relnav calibrate sun` wrote.

    Raises
    ------
    InputError
        If it is not one, or a value is missing or of the wrong shape.
    """
    source = path_of(path, "a calibration's path")
    try:
        content = read_json(source, "a calibration file")
    except OSError as error:
        raise InputError(f"{source}: cannot be read: {error.strerror}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{source}: 'format' must be {FORMAT!r}; make the file with relnav calibrate sun")
    try:
        form = _patent(content["patent"]) if "patent" in content else _table(content["table"])
        values = [float(content[key]) for key in ("field_half_angle_deg", "spot_noise_px", "calibration_noise_px")]
        if not (0.0 < values[0] < 75.0 and values[1] > 0.0 and values[2] >= 0.0):
            raise ValueError(f"field_half_angle_deg, spot_noise_px, calibration_noise_px are {values}")
        return Calibration(str(content["method"]), form, float(np.radians(values[0])), values[1], values[2])
    except KeyError as error:
        raise InputError(f"{source}: {error} is missing; make the file anew with relnav calibrate sun") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{source}: {error}; make the file anew with relnav calibrate sun") from error


def _table(content: dict[str, Any]) -> DirectionTable:
    x, y, tangents = (np.array(content[key], dtype=np.float64) for key in ("x_px", "y_px", "tangents"))
    if x.ndim != 1 or y.ndim != 1 or min(len(x), len(y)) < 4 or tangents.shape != (len(x), len(y), 2):
        raise ValueError(f"table: tangents of shape {tangents.shape} do not fit nodes {x.shape} and {y.shape}")
    if not all(np.all(np.isfinite(part)) for part in (x, y, tangents)):
        raise ValueError("table: a value is not a finite number")
    for nodes in (x, y):
        if (
            not np.allclose(np.diff(nodes), (nodes[-1] - nodes[0]) / (len(nodes) - 1), rtol=1e-6)
            or nodes[1] <= nodes[0]
        ):
            raise ValueError("table: nodes must be evenly spaced and grow")
    return DirectionTable(x, y, tangents)


def _patent(content: dict[str, Any]) -> PatentTables:
    limit = int(content["limit_deg"])
    radial, rows = (np.array(content[key], dtype=np.float64) for key in ("radial", "rows"))
    if radial.shape != (2, 3) or rows.ndim != 3 or rows.shape[:2] != (2, 2 * limit + 1):
        raise ValueError(f"patent: radial {radial.shape} and rows {rows.shape} do not fit limit_deg {limit}")
    if not (np.all(np.isfinite(radial)) and np.all(np.isfinite(rows))):
        raise ValueError("patent: a value is not a finite number")
    x0, y0, h = (float(content[key]) for key in ("x0_px", "y0_px", "h_px"))
    return PatentTables(x0, y0, h, radial, rows, limit)


def _refuse_gimbal_angles(measured: SunMeasurements, model: ApsSunModel, rms_px: float, outer_axis: str) -> None:
    """Gimbal angles under the names of projection angles leave residuals that vanish when taken for what they are."""
    if rms_px < SUSPICIOUS_NOISE * model.sensor.spot_noise_px:
        return
    some = slice(None, None, max(1, len(measured.spots_px) // TRIAL_POINTS))
    angles, spots = measured.angles_rad[some], measured.spots_px[some]
    for axis, (outer, inner) in (("x", (1, 0)), ("y", (0, 1))):
        directions = direction_from_gimbal(angles[:, outer], angles[:, inner], axis)
        try:
            other = fit_physical(spots, directions, model).rms_px
        except ValueError:
            continue
        if other < rms_px / SUSPICIOUS_NOISE:
            names = ("beta", "alpha") if axis == "x" else ("alpha", "beta")
            raise InputError(
                f"{measured.path}: taken for projection angles these leave {rms_px:.2f} px, taken for a turntable's "
                f"gimbal angles {other:.2f} px; rename {names[0]} to outer and {names[1]} to inner"
                + ("" if axis == outer_axis else f" and say --outer-axis {axis}")
            )


def _with_field(model: ApsSunModel, field_rad: float) -> ApsSunModel:
    from dataclasses import replace

    return replace(model, sensor=replace(model.sensor, field_half_angle_rad=field_rad))


def _three_rms(error_rad: Matrix) -> float:
    return 3.0 * float(np.degrees(np.sqrt(np.mean(error_rad**2))))
