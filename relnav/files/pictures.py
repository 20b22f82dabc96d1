"""Pictures of an accuracy report; matplotlib comes with the dependencies and is imported when used."""

import math
from pathlib import Path
from typing import Any

from relnav.accuracy.published import QUANTITIES
from relnav.accuracy.report import AccuracyReport
from relnav.files.picture_style import (
    INK,
    SERIES,
    check_picture,
    heading,
    named_line,
    new_figure,
    one_legend,
    plain_decades,
    save,
    styled,
)

LINES = ((7.0, "-", 0.4), (4.2, "-", 0.7), (1.9, "-", 1.0), (1.0, (0, (4, 2)), 1.0))
"""Width, dashes and opacity of curves: the first lie widest below, so that those that coincide are all seen."""
MARKS = ("o", "x", "+", "^")
APART_M = 0.07
"""By which the marks of single shots at one range stand apart."""
DOTS = 24
"""Of an rms error along a curve."""


def draw_accuracy(report: AccuracyReport, path: Path) -> None:
    """Draw rms errors and reported 1-sigma over range, beside single shots and the published lines.

    Raises
    ------
    UsageError
        For another ending.
    """
    check_picture(path)
    with styled():
        figure = new_figure(11.7, 8.6)
        axes = figure.subplots(3, 2, sharex=True, sharey="row")
        for column, title in enumerate(("filtered", "smoothed")):
            methods = [method for method in report.envelopes if ("smoothed" in method) == (title == "smoothed")]
            for row, quantity in enumerate(QUANTITIES):
                _draw(axes[row, column], report, methods, row)
                axes[row, column].set_title(f"{quantity.capitalize()}, {title}")
        for axis in axes[2]:
            axis.set_xlabel("range, m: flown from left to right, until the chaser holds")
        axes[0, 0].invert_xaxis()
        heading(figure, "Rms errors over the runs (dots) beside reported 1-sigma (lines), and of single images (marks)")
        one_legend(figure)
        save([figure], path)


def _draw(axis: Any, report: AccuracyReport, methods: list[str], row: int) -> None:
    quantity = QUANTITIES[row]
    scale = 1.0 if quantity == "range" else math.degrees(1.0)
    for number, method in enumerate(methods):
        range_m, error, sigma = report.envelopes[method]
        colour, (width, dashes, opacity) = SERIES[number % len(SERIES)], LINES[min(number, len(LINES) - 1)]
        name, every = method.replace(", smoothed", ""), max(1, len(range_m) // DOTS)
        axis.semilogy(range_m, sigma[:, row] * scale, color=colour, lw=width, ls=dashes, alpha=opacity, label=name)
        begin = number * every // len(methods)
        dots = range_m[begin::every], error[begin::every, row] * scale
        axis.semilogy(*dots, ".", ms=6, color=colour, mec="white", mew=0.4)
    shots = [r for r in report.rows if r.method.startswith("single shot") and r.quantity == quantity]
    kinds = list(dict.fromkeys(r.method for r in shots))
    for number, method in enumerate(kinds):
        points, aside = [r for r in shots if r.method == method], (number - 0.5 * (len(kinds) - 1)) * APART_M
        places = [r.range_m + aside for r in points]
        mark = MARKS[number % len(MARKS)]
        axis.plot(places, [r.measured for r in points], mark, color=INK, mfc="none", ms=5, mew=1.0, label=method)
    if shots:
        named_line(axis, shots[0].published, f"published {shots[0].published:g} {shots[0].unit}", at=0.1, side="left")
        axis.set_ylabel(shots[0].unit)
    plain_decades(axis)
