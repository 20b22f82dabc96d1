"""Pictures of an accuracy report; matplotlib comes with the dependencies and is imported when used."""

import math
from pathlib import Path

from relnav.accuracy.published import QUANTITIES
from relnav.accuracy.report import AccuracyReport
from relnav.files.atomic import check_png, replacing


def draw_accuracy(report: AccuracyReport, path: Path) -> None:
    """Draw rms errors and reported 1-sigma over range, beside single shots and the published lines; .png.

    Raises
    ------
    UsageError
        For another ending.
    """
    check_png(path)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 8), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    for column, title in enumerate(("filtered", "smoothed")):
        methods = [method for method in report.envelopes if ("smoothed" in method) == (title == "smoothed")]
        axes[0, column].set_title(title)
        for row, quantity in enumerate(QUANTITIES):
            axis = axes[row, column]
            scale = 1.0 if quantity == "range" else math.degrees(1.0)
            for colour, method in enumerate(methods):
                range_m, error, sigma = report.envelopes[method]
                axis.semilogy(range_m[::5], error[::5, row] * scale, ".", ms=1.5, color=f"C{colour}")
                axis.semilogy(
                    range_m, sigma[:, row] * scale, color=f"C{colour}", lw=1.2, label=method.replace(", smoothed", "")
                )
            shots = [r for r in report.rows if r.method.startswith("single shot") and r.quantity == quantity]
            for marker, method in zip("ox+^", dict.fromkeys(r.method for r in shots), strict=False):
                points = [r for r in shots if r.method == method]
                axis.plot([r.range_m for r in points], [r.measured for r in points], marker, color="0.3", label=method)
            if shots:
                axis.axhline(shots[0].published, color="k", ls="--", label="published")
                axis.set_ylabel(f"{quantity}, {shots[0].unit}")
            axis.grid(alpha=0.3)
    for axis in axes[2]:
        axis.set_xlabel("range, m (the approach runs from right to left)")
    figure.suptitle("Error over runs, rms (dots), and reported 1-sigma (lines); single shots (marks)")
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    with replacing(path) as temporary:
        FigureCanvasAgg(figure)
        figure.savefig(temporary, format="png", dpi=100)
