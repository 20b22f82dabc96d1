"""Picture of a vehicle's accuracy: errors by distance, what each sensor told, what it buys, and what could be seen."""

from pathlib import Path
from typing import Any

import numpy as np

from relnav.accuracy.rendezvous import APPROACH, VehicleReport
from relnav.files.picture_style import (
    ESTIMATE,
    INK,
    PUBLISHED,
    SERIES,
    SPREAD,
    check_picture,
    heading,
    new_figure,
    one_legend,
    plain_decades,
    save,
    styled,
)

ERRORS = {"port along": ESTIMATE, "port across": PUBLISHED, "attitude": ESTIMATE, "rate": PUBLISHED}
"""Curves over distance: the first two in one panel, the others in the next."""
MEASURED, REPORTED = "rms error an axis", "rms reported 1-sigma"
LEARNT = ("position", "target\nattitude", "chaser\nattitude")
BOUGHT = ("port along", "port across", "attitude", "rate")
WITHOUT = "without "


def draw_vehicle_accuracy(report: VehicleReport, path: Path) -> None:
    """Draw errors and reported 1-sigma over distance, shares of what was learnt, losses without a sensor, what is left.

    Raises
    ------
    UsageError
        For another ending.
    """
    check_picture(path)
    with styled():
        figure = new_figure(11.7, 9.5)
        axes = figure.subplot_mosaic([["place", "turn"], ["told", "bought"], ["left", "left"]])
        _over_distance(axes["place"], report, ("port along", "port across"), 1e3, "mm")
        axes["place"].set_title("Port from port: rms error (dots) and reported 1-sigma")
        _over_distance(axes["turn"], report, ("attitude", "rate"), 1.0, "deg, deg/s")
        axes["turn"].set_title("Attitude, and rate of the target against the chaser")
        _told(axes["told"], report)
        _bought(axes["bought"], report)
        _left(axes["left"], report)
        heading(figure, f"{report.model}: {report.runs} approaches, seed {report.seed}")
        one_legend(figure)
        save([figure], path)


def _over_distance(axis: Any, report: VehicleReport, quantities: tuple[str, ...], scale: float, unit: str) -> None:
    for quantity in quantities:
        for statistic, style in ((MEASURED, "o"), (REPORTED, "-")):
            rows = [
                (row.range_m or 0.0, scale * row.measured)
                for row in report.rows
                if (row.quantity, row.statistic, row.method) == (quantity, statistic, APPROACH)
            ]
            axis.loglog(*np.array(rows).T, style, ms=4, color=ERRORS[quantity], label=f"{quantity}, {statistic}")
    axis.set(xlabel="port from port, m", ylabel=unit)
    at = sorted({row.range_m for row in report.rows if row.range_m is not None})
    axis.set_xticks(at, [f"{range_m:g}" for range_m in at])
    axis.set_xticks([], minor=True)
    plain_decades(axis)


def _told(axis: Any, report: VehicleReport) -> None:
    """Bars of 100 %: who told what of what was learnt."""
    begin = np.zeros(len(LEARNT))
    for number, (name, share) in enumerate(report.shares.items()):
        axis.barh(LEARNT, 100.0 * share, left=begin, color=SERIES[number % len(SERIES)], height=0.6, label=name)
        begin = begin + 100.0 * share
    axis.invert_yaxis()
    axis.set(xlabel="share of the information, %", title="Sources of information", xlim=(0.0, 100.0))


def _bought(axis: Any, report: VehicleReport) -> None:
    """How many times as large the reported 1-sigma is without each sensor."""
    sigmas: dict[str, dict[str, float]] = {}
    for row in report.rows:
        if row.statistic == REPORTED and row.quantity in BOUGHT and row.method != APPROACH:
            sigmas.setdefault(row.method.partition(",")[0], {})[row.quantity] = row.measured
    whole = sigmas.pop("all sensors")
    names, step = list(sigmas), 0.8 / len(BOUGHT)
    for k, quantity in enumerate(BOUGHT):
        times = [sigmas[name][quantity] / whole[quantity] for name in names]
        colour = (ESTIMATE, PUBLISHED, SPREAD, INK)[k]
        places = np.arange(len(names)) + (k - 1.5) * step
        axis.barh(places, times, height=step, color=colour, label=f"{quantity}, without a sensor")
    axis.axvline(1.0, color=INK, lw=0.8)
    axis.set_yticks(range(len(names)), [name.removeprefix(WITHOUT) for name in names])
    axis.invert_yaxis()
    axis.set(xlabel="times the 1-sigma with all sensors", title="What a sensor buys: the last metres without it")


def _left(axis: Any, report: VehicleReport) -> None:
    """Of each error that lasts and is estimated, how much of its 1-sigma is left: what could be seen."""
    seen = {name: 100.0 * share for name, share in report.left.items() if share == share}
    axis.bar(list(seen), list(seen.values()), color=SPREAD, width=0.6)
    axis.set(ylabel="% of its 1-sigma left", ylim=(0.0, 105.0))
    axis.set_title("What could be seen: lasting errors that are estimated, at the end")
    for place, value in enumerate(seen.values()):
        axis.annotate(f"{value:.0f}", (place, value), ha="center", va="bottom", color=INK)
