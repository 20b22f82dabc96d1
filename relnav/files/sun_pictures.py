"""Residual maps of a sun sensor's calibration; matplotlib comes with the dependencies and is imported when used."""

from pathlib import Path

import numpy as np

from relnav.files.atomic import check_png, replacing
from relnav.files.sun_calibration import SunCalibrationReport


def draw_residual_maps(report: SunCalibrationReport, path: Path) -> None:
    """Draw alpha and beta errors over the field, before and after the calibration; .png.

    Raises
    ------
    UsageError
        For another ending.
    """
    check_png(path)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    counted = report.counted
    angles = np.degrees(report.measurements.angles_rad[counted])
    size = float(np.clip(9e4 / len(angles), 2.0, 120.0))
    figure = Figure(figsize=(10, 8.5), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    for row, (when, error) in enumerate((("before", report.before_rad), ("after", report.result.error_rad))):
        degrees = np.degrees(error[counted])
        most = float(np.abs(degrees).max())
        for column, name in enumerate(("alpha", "beta")):
            axis = axes[row, column]
            dots = axis.scatter(
                angles[:, 0],
                angles[:, 1],
                c=degrees[:, column],
                s=size,
                marker="s",
                cmap="RdBu_r",
                vmin=-most,
                vmax=most,
            )
            three = 3.0 * float(np.sqrt(np.mean(degrees[:, column] ** 2)))
            axis.set_title(
                f"{name} {when}: 3 rms {three:.4g} deg, max {np.abs(degrees[:, column]).max():.4g} deg", fontsize=10
            )
            figure.colorbar(dots, ax=axis, label="deg")
    for axis in axes[1]:
        axis.set_xlabel("alpha, deg")
    for axis in axes[:, 0]:
        axis.set_ylabel("beta, deg")
    figure.suptitle(f"Calibrated minus stated angle, {len(angles)} points, {report.result.calibration.method}")
    with replacing(path) as temporary:
        FigureCanvasAgg(figure)
        figure.savefig(temporary, format="png", dpi=100)
