"""`relnav calibrate sun`: turntable angles and spots in, calibration file and report with residual maps out."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from relnav.cli.printing import InputPath, OutputPath, say

if TYPE_CHECKING:
    from relnav.files.sun_calibration import SunCalibrationReport

MAP_SIDE = 7


@click.command(epilog="Example: relnav calibrate sun turntable.csv --out sun.json --plot residuals.png")
@click.argument("measurements", type=InputPath())
@click.option("--out", required=True, type=OutputPath(), help="Calibration file to write, .json.")
@click.option("--model", default="aps_sun", show_default=True, help="Sensor with its design values.")
@click.option(
    "--method",
    default="auto",
    show_default=True,
    type=click.Choice(["auto", "rays", "patent"]),
    help="Ray model with a spline where it helps, ray model alone, or the patent's two stages.",
)
@click.option(
    "--outer-axis",
    default="x",
    show_default=True,
    type=click.Choice(["x", "y"]),
    help="Sensor axis along which the turntable's outer axis stands (columns outer, inner).",
)
@click.option("--incomplete", is_flag=True, help="Take a grid that lacks nodes.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of the cross-validation.")
@click.option("--plot", type=OutputPath(), help="Draw residual maps, .png.")
@click.option("--json", "json_path", type=OutputPath(), help="Write the report as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    measurements: Path,
    out: Path,
    model: str,
    method: str,
    outer_axis: str,
    incomplete: bool,
    seed: int,
    plot: Path | None,
    json_path: Path | None,
    quiet: bool,
) -> None:
    """Calibrate an APS sun sensor from MEASUREMENTS, a CSV table with one row a turntable position.

    Columns: alpha_deg, beta_deg (projection angles) or outer_deg, inner_deg (gimbal angles), in any angle unit;
    spot_x_px, spot_y_px, empty where no spot was seen.
    """
    from relnav.errors import ModelError, UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder, check_png
    from relnav.files.models import load_model
    from relnav.files.sun_calibration import calibrate_sun, write_sun_calibration
    from relnav.files.sun_pictures import draw_residual_maps
    from relnav.files.tables import write_json
    from relnav.sensors.aps_sun import ApsSunModel

    for path in (out, plot, json_path):
        if path is not None:
            check_folder(path)
    if plot is not None:
        check_png(plot)
    if out.suffix.lower() != ".json":
        raise UsageError(f"{out}: a sun calibration is written as .json; got '{out.suffix}'")
    check_distinct(measurements, out, plot, json_path)
    sensor = load_model(model)
    if not isinstance(sensor, ApsSunModel):
        raise ModelError(f"{sensor.path}: an APS sun sensor is expected (sensor_type aps_sun)")
    report = calibrate_sun(measurements, sensor, method=method, outer_axis=outer_axis, incomplete=incomplete, seed=seed)
    with Outputs() as outputs:
        write_sun_calibration(report, outputs.path(out))
        if plot is not None:
            draw_residual_maps(report, outputs.path(plot, ".png"))
        if json_path is not None:
            write_json(report.to_dict(), outputs.path(json_path))
    if not quiet:
        say(report_lines(report), out, plot, json_path)


def report_lines(report: "SunCalibrationReport") -> list[str]:
    """The report for a reader, with a coarse map of what is left."""
    figures = report.to_dict()
    unseen = f", {figures['not_seen']} without a spot" if figures["not_seen"] else ""
    lines = [
        f"{figures['points']} points{unseen}, model {figures['model']}, method: {figures['method']}, "
        f"field +-{figures['field_half_angle_deg']:.4g} deg",
        f"error of a plain hole: up to {figures['error_before_max_deg']:.4g} deg",
        f"error calibrated: 3 sigma {figures['error_after_3rms_deg']:.4f} deg, at most "
        f"{figures['error_after_max_deg']:.4f} deg, spot noise of the measurements included",
        f"spot noise stated {figures['spot_noise_px']:.4f} px, calibration itself off by "
        f"{figures['calibration_noise_px']:.4f} px (both in every covariance)",
    ]
    lines.extend(
        f"left out: line {line}: its spot is {off:.1f} px from where the other points put it; measure it again"
        for line, off in report.left_out
    )
    outside = figures["points"] - len(report.left_out) - figures["points_in_field"]
    if outside:
        lines.append(f"{outside} points lie beyond the field: they are fitted, but not in the errors above")
    if "parameters" in figures:
        lines.append(
            f"ray model: residual {figures['spot_residual_rms_px']:.4f} px rms, chi2/dof "
            f"{figures['chi2_per_dof']:.3f}, condition {figures['condition']:.0f}; compiling costs "
            f"{figures['compile_loss_deg']:.5f} deg at most"
        )
        width = max(map(len, figures["parameters"]))
        lines.extend(
            f"  {name:<{width}} {entry['value']: .6e} +- {entry['sigma']:.1e}"
            for name, entry in figures["parameters"].items()
        )
    if "held_out_rms_px" in figures:
        tried = ", ".join(f"{name} {value:.4f}" for name, value in figures["held_out_rms_px"].items())
        lines.append(f"spline, rms of held-out points, px: {tried}")
    return lines + residual_map(report)


def residual_map(report: "SunCalibrationReport") -> list[str]:
    """Rms of what is left over the field, in thousandths of a degree; alpha to the right, beta upward."""
    import numpy as np

    counted = report.counted
    angles, error = report.measurements.angles_rad[counted], report.result.error_rad[counted]
    edge = float(np.abs(angles).max())
    bins = np.clip(((angles / edge + 1.0) * 0.5 * MAP_SIDE).astype(np.int64), 0, MAP_SIDE - 1)
    total, count = np.zeros((MAP_SIDE, MAP_SIDE)), np.zeros((MAP_SIDE, MAP_SIDE))
    np.add.at(total, (bins[:, 0], bins[:, 1]), np.mean(np.degrees(error) ** 2, axis=1))
    np.add.at(count, (bins[:, 0], bins[:, 1]), 1)
    lines = ["residual map, rms in 0.001 deg: alpha to the right, beta upward"]
    centres = np.degrees(edge) * (2.0 * np.arange(MAP_SIDE) + 1.0 - MAP_SIDE) / MAP_SIDE
    for j in reversed(range(MAP_SIDE)):
        cells = [
            f"{1e3 * np.sqrt(total[i, j] / count[i, j]):7.1f}" if count[i, j] else "      -" for i in range(MAP_SIDE)
        ]
        lines.append(f"  beta {centres[j]:6.1f} " + "".join(cells))
    lines.append("   alpha       " + "".join(f"{centre:7.1f}" for centre in centres))
    return lines
