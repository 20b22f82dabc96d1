"""Picture of a three-beacon error budget: every line over range, one fix beside the settled filter."""

from pathlib import Path
from typing import Any

import numpy as np

from relnav.accuracy.budget import QUANTITIES, Budget
from relnav.errors import UsageError
from relnav.files.picture_style import (
    INK,
    QUIET,
    SERIES,
    check_picture,
    heading,
    new_figure,
    one_legend,
    plain_decades,
    save,
    styled,
)
from relnav.mission import Model

LEAST = 1e-4
"""Share of the largest total: lines that are nowhere larger are left out."""
UNSEEN = {
    "single": "beacons out of view:\nno fix; only the printed\nform's own error goes on",
    "settled": "beacons out of view:\nno fix, and the curves end",
}


def check_drawable(mission: Any) -> None:
    """Refuse a mission whose budget has no picture, before it is worked out.

    Raises
    ------
    UsageError
        Saying what is drawn.
    """
    if not isinstance(mission, Model):
        raise UsageError("--plot draws budgets of three-beacon missions; this one has no picture")


def draw_budget(report: Budget, path: Path, before: Budget | None = None, change: str = "") -> None:
    """Draw a budget. With the budget before a change, its total is drawn too.

    Raises
    ------
    UsageError
        For another ending.
    """
    check_picture(path)
    with styled():
        figure = new_figure(11.7, 10.5)
        axes = figure.subplots(3, 2, sharex=True, sharey="row")
        for column, (which, title) in enumerate((("single", "one fix"), ("settled", "settled filter"))):
            for row, (quantity, unit, _) in enumerate(QUANTITIES):
                _draw(axes[row, column], report, before, change, which, row)
                axes[row, column].set_title(f"{quantity.capitalize()}, {title}")
                axes[row, column].set_ylabel(f"1-sigma, {unit}")
        for axis in axes[2]:
            axis.set_xlabel("range, m")
        heading(figure, f"Error budget of {report.model} on the docking axis; dotted: not in the total")
        one_legend(figure)
        save([figure], path)


def _draw(axis: Any, report: Budget, before: Any, change: str, which: str, row: int) -> None:
    places, (_, _, scale) = report.places, QUANTITIES[row]
    ranges = [place.range_m for place in places]
    total = np.array([place.total(which)[row] * scale for place in places])
    least = LEAST * float(np.nanmax(total)) if np.isfinite(total).any() else 0.0
    for number, line in enumerate(places[0].lines):
        values = [getattr(place.lines[number], which)[row] * scale for place in places]
        if not any(value > least for value in values):
            continue
        style, width = ("-", 1.5) if line.counts else (":", 1.2)
        name = line.name if line.counts else f"({line.name})"
        axis.semilogy(ranges, values, style, lw=width, color=SERIES[number % len(SERIES)], label=name)
    axis.semilogy(ranges, total, "-", color=INK, alpha=0.35, lw=5.0, zorder=1.0, label="total")
    if before is not None:
        earlier = [place.total(which)[row] * scale for place in before.places]
        axis.semilogy(ranges, earlier, color=INK, lw=1.5, ls=(0, (5, 2)), label=f"total before {change}")
    unseen = [r for r, value in zip(ranges, total, strict=True) if not np.isfinite(value)]
    if unseen and len(unseen) < len(ranges):
        axis.axvspan(min(unseen), min(r for r in ranges if r > max(unseen)), color=QUIET, alpha=0.15, lw=0)
        place = {"xycoords": ("data", "axes fraction"), "xytext": (4, 4), "textcoords": "offset points", "va": "bottom"}
        axis.annotate(UNSEEN[which], (min(unseen), 0.0), color=INK, fontsize=8, **place)
    plain_decades(axis)
