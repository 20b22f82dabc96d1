"""Residual maps of a sun sensor's calibration; matplotlib comes with the dependencies and is imported when used."""

from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.files.picture_style import check_picture, heading, new_figure, save, styled
from relnav.files.sun_calibration import SunCalibrationReport


def draw_residual_maps(report: SunCalibrationReport, path: Path) -> None:
    """Draw alpha and beta errors over the field, before and after the calibration.

    Raises
    ------
    UsageError
        For another ending.
    """
    check_picture(path)
    counted = report.counted
    angles = np.degrees(report.measurements.angles_rad[counted])
    with styled():
        figure = new_figure(10.5, 9.0)
        axes = figure.subplots(2, 2, sharex=True, sharey=True)
        for row, (when, error) in enumerate((("before", report.before_rad), ("held out", report.result.error_rad))):
            degrees = np.degrees(error[counted])
            for column, name in enumerate(("alpha", "beta")):
                _draw(axes[row, column], angles, degrees[:, column], float(np.abs(degrees).max()))
                three = 3.0 * float(np.sqrt(np.mean(degrees[:, column] ** 2)))
                most = float(np.abs(degrees[:, column]).max())
                axes[row, column].set_title(f"{name} {when}: 3 rms {three:.4g} deg, max {most:.4g} deg")
        for axis in axes[1]:
            axis.set_xlabel("alpha, deg")
        for axis in axes[:, 0]:
            axis.set_ylabel("beta, deg")
        method = report.result.calibration.method
        heading(figure, f"Calibrated minus stated angle, {len(angles)} points, each held out, method {method}")
        save([figure], path)


def _draw(axis: Any, angles: Matrix, values: Vector, most: float) -> None:
    """Errors as coloured squares, white for none."""
    size = float(np.clip(9e4 / len(angles), 2.0, 120.0))
    dots = axis.scatter(*angles.T, c=values, s=size, marker="s", cmap="RdBu_r", vmin=-most, vmax=most)
    bar = axis.figure.colorbar(dots, ax=axis, label="deg")
    bar.outline.set_visible(False)
