"""`relnav calibrate sun`: turntable angles and spots, or a birefringent sensor's own spots in; its calibration out."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from relnav.cli.completion import SUN, ModelName
from relnav.cli.printing import InputPath, OutputPath, say

if TYPE_CHECKING:
    from relnav.files.sun_calibration import SunCalibrationReport
    from relnav.files.sun_self_calibration import SunSelfCalibrationReport
    from relnav.sensors.birefringent_sun import BirefringentSunModel

MAP_SIDE = 7


@click.command(epilog="Example: relnav calibrate sun turntable.csv --out sun.json --plot residuals.png")
@click.argument("measurements", type=InputPath())
@click.option(
    "--out",
    required=True,
    type=OutputPath(),
    help="Calibration file to write, .json; of a birefringent sensor the fitted keys of its model, .toml.",
)
@click.option(
    "--model",
    type=ModelName(*SUN),
    default="aps_sun",
    show_default=True,
    help="Sensor with its design values.",
)
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
    help="Sensor axis that is parallel to the turntable's outer axis (columns outer, inner).",
)
@click.option("--incomplete", is_flag=True, help="Accept a grid with missing nodes.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of the cross-validation.")
@click.option(
    "--free",
    help="Birefringent sensor: the constants to fit, after commas, of zero_spot_x_px, zero_spot_y_px (these two if "
    "left out), crystal_thickness_m, axis_polar_rad, axis_azimuth_rad (these too with known angles), ordinary_index, "
    "extraordinary_index.",
)
@click.option("--plot", type=OutputPath(), help="Draw residual maps, .png, .pdf or .svg.")
@click.option("--json", "json_path", type=OutputPath(), help="Write the report as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
@click.pass_context
def command(
    context: click.Context,
    measurements: Path,
    out: Path,
    model: str,
    method: str,
    outer_axis: str,
    incomplete: bool,
    seed: int,
    free: str | None,
    plot: Path | None,
    json_path: Path | None,
    quiet: bool,
) -> None:
    """Calibrate a sun sensor from MEASUREMENTS, a CSV table with one row a turntable position.

    Columns: alpha_deg, beta_deg (projection angles) or outer_deg, inner_deg (gimbal angles), in any angle unit;
    spot_x_px, spot_y_px, empty where no spot was seen. In flight the angles come from stars and ephemeris.

    A birefringent sensor (--model birefringent_sun) has spot_a_x_px, spot_a_y_px, spot_b_x_px, spot_b_y_px, and may
    have a third angle, roll_deg: the rotation of the sensor about its boresight in its mount. Without angles it
    calibrates itself, in flight too; the sun's direction need not be known.
    """
    from relnav.errors import UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.picture_style import check_picture
    from relnav.files.sun_calibration import calibrate_sun, write_sun_calibration
    from relnav.files.sun_measuring import load_sun_sensor
    from relnav.files.sun_pictures import draw_residual_maps
    from relnav.files.tables import write_json
    from relnav.sensors.aps_sun import ApsSunModel

    for path in (out, plot, json_path):
        if path is not None:
            check_folder(path)
    if plot is not None:
        check_picture(plot)
    check_distinct(measurements, out, plot, json_path)
    sensor = load_sun_sensor(model)
    if not isinstance(sensor, ApsSunModel):
        lines = _birefringent(context, measurements, sensor, free, outer_axis, out, json_path)
        return None if quiet else say(lines, out, json_path)
    _only_for(context, ("free",), "a birefringent sensor; this is an APS sensor")
    if out.suffix.lower() != ".json":
        raise UsageError(f"{out}: a sun calibration is written as .json; got '{out.suffix}'")
    report = calibrate_sun(measurements, sensor, method=method, outer_axis=outer_axis, incomplete=incomplete, seed=seed)
    with Outputs() as outputs:
        write_sun_calibration(report, outputs.path(out))
        if plot is not None:
            draw_residual_maps(report, outputs.path(plot, ".png"))
        if json_path is not None:
            write_json(report.to_dict(), outputs.path(json_path))
    if not quiet:
        say(report_lines(report), out, plot, json_path)


def _only_for(context: click.Context, names: tuple[str, ...], what: str) -> None:
    """Refuse options that were given and mean nothing here."""
    from click.core import ParameterSource

    from relnav.errors import UsageError

    for name in names:
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"--{name.replace('_', '-')} is for {what}")


def _birefringent(
    context: click.Context,
    measurements: Path,
    sensor: "BirefringentSunModel",
    free: str | None,
    outer_axis: str,
    out: Path,
    json_path: Path | None,
) -> list[str]:
    """Fit a birefringent sensor's constants and write them; what to say of it."""
    from relnav.errors import UsageError
    from relnav.files.atomic import Outputs, is_stream
    from relnav.files.sun_self_calibration import KEYS, calibrate_birefringent_sun
    from relnav.files.tables import write_json

    _only_for(context, ("method", "incomplete", "seed", "plot"), "an APS sensor; this one is birefringent")
    if out.suffix.lower() != ".toml" and not is_stream(out):
        raise UsageError(f"{out}: a birefringent sensor's constants are written as .toml; got '{out.suffix}'")
    names = None if free is None else tuple(name.strip() for name in free.split(","))
    if names is not None and (any(name not in KEYS for name in names) or len(set(names)) < len(names)):
        raise UsageError(f"--free {free}: constants after commas, each once, of {', '.join(KEYS)}")
    report = calibrate_birefringent_sun(measurements, sensor, names, outer_axis=outer_axis)
    if report.known is None:
        _only_for(context, ("outer_axis",), "a turntable's angles; this log has none")
    with Outputs() as outputs:
        outputs.path(out).write_text(report.section(), encoding="utf-8")
        if json_path is not None:
            write_json(report.to_dict(), outputs.path(json_path))
    return self_calibration_lines(report)


def self_calibration_lines(report: "SunSelfCalibrationReport") -> list[str]:
    """The report for a reader."""
    figures = report.to_dict()
    unseen = f", {report.not_seen} without both spots" if report.not_seen else ""
    lines = [f"{report.frames} images{unseen}, model {report.model}; chi2/dof {figures['chi2_per_dof']:.3f}"]
    allowed = "; the sigmas below are of the noise found" if figures["covariance_factor"] > 1.0 else ""
    lines.append(
        f"spot noise found {figures['spot_noise_found_px']:.4g} px, the model states {figures['spot_noise_px']:.4g} "
        f"px{allowed}"
    )
    lines.extend(f"left out: line {line}: its two spots contradict the others" for line in report.left_out)
    if report.known is not None:
        turn, sigma = figures["alignment_deg"], figures["alignment_sigma_deg"]
        lines += [
            f"error calibrated: 3 sigma {figures['error_after_3rms_deg']:.4f} deg, at most "
            f"{figures['error_after_max_deg']:.4f} deg, each position with constants of the others; its spots' "
            "noise included",
            "the axes of the angles are turned to the sensor's by "
            + ", ".join(f"{t:.4f} +- {s:.4f}" for t, s in zip(turn, sigma, strict=True))
            + " deg about x, y, z: put it into the sensor's mounting",
        ]
    width = max(map(len, figures["parameters"]))
    lines.extend(
        f"  {name:<{width}} {entry['value']:.8g} +- {entry['sigma']:.1e}"
        for name, entry in figures["parameters"].items()
    )
    return lines


def report_lines(report: "SunCalibrationReport") -> list[str]:
    """The report for a reader, with a coarse map of what is left."""
    figures = report.to_dict()
    unseen = f", {figures['not_seen']} without a spot" if figures["not_seen"] else ""
    lines = [
        f"{figures['points']} points{unseen}, model {figures['model']}, method: {figures['method']}, "
        f"field +-{figures['field_half_angle_deg']:.4g} deg",
        f"error of a plain hole: up to {figures['error_before_max_deg']:.4g} deg",
        f"error calibrated: 3 sigma {figures['error_after_3rms_deg']:.4f} deg, at most "
        f"{figures['error_after_max_deg']:.4f} deg, each point predicted by the others; its spot's noise included, "
        "points at the edge extrapolated",
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
    lines = ["residual map, rms in 0.001 deg, each point predicted by the others: alpha to the right, beta upward"]
    centres = np.degrees(edge) * (2.0 * np.arange(MAP_SIDE) + 1.0 - MAP_SIDE) / MAP_SIDE
    for j in reversed(range(MAP_SIDE)):
        cells = [
            f"{1e3 * np.sqrt(total[i, j] / count[i, j]):7.1f}" if count[i, j] else "      -" for i in range(MAP_SIDE)
        ]
        lines.append(f"  beta {centres[j]:6.1f} " + "".join(cells))
    lines.append("   alpha       " + "".join(f"{centre:7.1f}" for centre in centres))
    return lines
