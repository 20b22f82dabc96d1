"""`relnav calibrate psd`: a grid of known spots in, the correction of the detector's distortion out."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.cli.completion import ModelName
from relnav.cli.printing import InputPath, OutputPath, say

if TYPE_CHECKING:
    from relnav.arrays import Vector
    from relnav.sensors.three_beacon.calibrate import CalibrationReport


@click.command(epilog="Example: relnav calibrate psd grid.csv --out calibration.toml --model three_beacon_psd")
@click.argument("grid", type=InputPath())
@click.option("--out", type=OutputPath(), help="Calibration to write, .toml; a model's [calibration] names it.")
@click.option(
    "--model",
    type=ModelName("three_beacon"),
    help="Model of this detector, for the share of its area that the grid covers.",
)
@click.option("--target", "target_um", default=10.0, show_default=True, help="Required 3-sigma of the residual, um.")
@click.option("--json", "json_path", type=OutputPath(), help="Write the figures as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    grid: Path, out: Path | None, model: str | None, target_um: float, json_path: Path | None, quiet: bool
) -> None:
    """Fit a two-dimensional correction from GRID, a CSV of known and measured spots, one row a point.

    Columns of GRID: true_x_um, true_y_um, spot_x_um, spot_y_um (any length unit; an empty spot is not seen). The order
    of the correction is chosen by cross-validation. Sizes are those of one axis; the residual is
    the expected 3 x rms over the grid's area, between its points too.
    """
    from relnav.errors import LogError, UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.models import load_mission
    from relnav.files.psd_calibration import write_calibration
    from relnav.files.psd_grid import read_grid
    from relnav.files.tables import write_json
    from relnav.sensors.three_beacon.calibrate import calibrate_without_outliers

    if not target_um > 0.0:
        raise UsageError(f"--target is a length above zero; got {target_um:g}")
    for path in (out, json_path):
        if path is not None:
            check_folder(path)
    check_distinct(grid, out, json_path)
    size = None if model is None else load_mission(model).sensor.detector_size_m
    true_m, measured_m, rows = read_grid(grid)
    try:
        report, left_out = calibrate_without_outliers(
            true_m, measured_m, detector_size_m=size, target_m=target_um * 1e-6
        )
    except ValueError as error:
        raise LogError(f"{grid}: {error}") from error
    with Outputs() as outputs:
        if out is not None:
            write_calibration(report, outputs.path(out), grid.name)
        if json_path is not None:
            write_json(summary(report) | {"left_out_lines": [rows[k] for k in left_out]}, outputs.path(json_path))
    if not quiet:
        contradicted = [_left_out(rows[k], true_m[k] * 1e3) for k in left_out]
        name = [] if out is None else [f'calibration: {out} (name it in a model: [calibration] file = "{out.name}")']
        say([*contradicted, *lines(report), *name], out, json_path)


def _left_out(line: int, true_mm: "Vector") -> str:
    x, y = true_mm
    return (
        f"left out: line {line}: the other points contradict the spot known to be at ({x:.3f}, {y:.3f}) mm; measure it "
        "again"
    )


def summary(report: "CalibrationReport") -> dict[str, Any]:
    """The figures as plain values."""
    c = report.calibration
    return {
        "points": c.points,
        "noise_um": report.noise_m * 1e6,
        "raw_max_um": report.raw_max_m * 1e6,
        "raw_rms_um": report.raw_rms_m * 1e6,
        "figure_length_mm": [value * 1e3 for value in report.figure_length_m],
        "order": c.order,
        "chosen_order": report.chosen.order,
        "orders": [
            {
                "order": fit.order,
                "terms": fit.terms,
                "in_use": fit.in_use,
                "prediction_um": fit.prediction_m * 1e6,
                "fit_noise_um": fit.fit_noise_m * 1e6,
                "figure_um": fit.figure_m * 1e6,
                "apart_um": fit.apart_m * 1e6,
            }
            for fit in report.orders
        ],
        "residual_3_sigma_um": report.reached_m * 1e6,
        "target_um": report.target_m * 1e6,
        "met": report.met,
        "chance_within_target": report.chance,
        "center_mm": [value * 1e3 for value in c.center_m],
        "half_width_mm": [value * 1e3 for value in c.half_width_m],
        "detector_share": report.detector_share,
        "outlier_mm": [value * 1e3 for value in report.outlier_m],
        "outlier_sigma": report.outlier_sigma,
        "empty_cells": report.empty_cells,
        "rim_slope": c.rim_slope,
        "recommended_side": report.recommended(),
        "gain": list(report.gain),
    }


def lines(report: "CalibrationReport") -> list[str]:
    """The figures for a reader."""
    from relnav.sensors.three_beacon.calibrate import OUTLIER_SIGMA, USUAL_GAIN

    c, chosen, length = report.calibration, report.chosen, report.figure_length_m
    out = [
        f"{c.points} points, noise {report.noise_m * 1e6:.1f} um (estimated); detection error before: largest "
        f"{report.raw_max_m * 1e6:.0f} um, rms {report.raw_rms_m * 1e6:.0f} um",
        "offset, scale, shear, pin-cushion and tilt, and a smooth figure of length "
        f"{length[0] * 1e3:.1f} to {length[1] * 1e3:.1f} mm (68 %)",
        "order  terms  in use  left-out point  fit noise  figure beyond  from the last   (1-sigma, um, each axis)",
    ]
    for fit in report.orders:
        mark = "  <- taken" if fit is chosen else ""
        out.append(
            f"{fit.order:5}  {fit.terms:5}  {fit.in_use:6.1f}  {fit.prediction_m * 1e6:14.2f}"
            f"  {fit.fit_noise_m * 1e6:9.2f}  {fit.figure_m * 1e6:13.2f}  {fit.apart_m * 1e6:13.2f}{mark}"
        )
    out.append(
        f"left by the correction, 3-sigma: {report.reached_m * 1e6:.1f} um of {report.target_m * 1e6:g} um wanted"
        f"  {'met' if report.met else 'NOT met'}"
        + ("" if report.empty_cells else f"; an axis is within with {_percent(report.chance)}")
    )
    box = (
        f"valid within {c.half_width_m[0] * 1e3:.2f} x {c.half_width_m[1] * 1e3:.2f} mm of "
        f"({c.center_m[0] * 1e3:.2f}, {c.center_m[1] * 1e3:.2f}) mm"
    )
    share = "" if report.detector_share is None else f", {100.0 * report.detector_share:.0f} % of the detector"
    out.append(
        f"{box}{share}; beyond, the correction is held and is wrong by {c.rim_slope * 100.0:.1f} um more every 0.1 mm"
    )
    if max(abs(gain - 1.0) for gain in report.gain) > USUAL_GAIN:
        x, y = report.gain
        out.append(
            f"GAIN: the spots move {x:.2f} times the known way in x and {y:.2f} times in y; of a detector some per "
            "cent are usual: check the detector's size and the units"
        )
    if report.outlier_sigma > OUTLIER_SIGMA:
        x, y = (value * 1e3 for value in report.outlier_m)
        out.append(
            f"OUTLIER: the spot known to be at ({x:.3f}, {y:.3f}) mm is {report.outlier_sigma:.0f} sigma from where "
            "the others put it; measure it again, or leave it out"
        )
    if report.empty_cells:
        out.append(
            f"HOLES: {report.empty_cells} of 25 cells of that box hold no point; measure there too. Without, more may "
            "be left than is said above, and no probability is given"
        )
    out.append(_advice(report))
    return out


def _advice(report: "CalibrationReport") -> str:
    from relnav.sensors.three_beacon.calibrate import LARGEST_SIDE, SURE

    side, width = report.recommended(), 2e3 * float(max(report.box.half_m))
    target = f"{report.target_m * 1e6:g} um"
    if side is None:
        finest = report.orders[-1]
        return (
            f"no grid up to {LARGEST_SIDE} x {LARGEST_SIDE} keeps an axis within {target} at this noise; order "
            f"{finest.order} leaves {3e6 * finest.figure_m:.1f} um (3-sigma) of the figure with whatever grid: "
            "calibrate a smaller area, or with less noise"
        )
    have = "enough" if side * side <= report.calibration.points and not report.empty_cells else "recommended"
    return (
        f"{have}: a grid of {side} x {side} (every {width / (side - 1):.2f} mm) keeps an axis within {target} with "
        f"{100.0 * SURE:g} % at this noise"
    )


def _percent(chance: float) -> str:
    return f"{100.0 * chance:.1f} %" if chance < 0.9995 else "more than 99.9 %"
