"""The measurements of a run as a picture: innovations within gates, NIS within bounds, what became of the epochs."""

import math
from typing import Any

import numpy as np

from relnav.arrays import Flags, Vector
from relnav.files.picture_style import GATE, INK, PUBLISHED, QUIET, SPREAD, TIMELINE_COLOURS, one_legend
from relnav.files.run_view import RunView


def draw_measurements(figure: Any, view: RunView) -> None:
    """Draw the sheet."""
    columns = 3
    shown = list(view.innovations)
    rows = math.ceil(len(shown) / columns)
    ratios = [1.0] * rows + [1.0, 0.8, 0.75]
    grid = figure.add_gridspec(len(ratios), columns, height_ratios=ratios)
    first = None
    for k, quantity in enumerate(shown):
        axis = figure.add_subplot(grid[k // columns, k % columns], sharex=first)
        first = first or axis
        _draw_innovation(axis, view, quantity.column)
        axis.set_title(f"{quantity.label}: measured minus predicted")
        axis.set_ylabel(quantity.unit)
        if k // columns < rows - 1:
            axis.tick_params(labelbottom=False)
    nis = figure.add_subplot(grid[rows, :], sharex=first)
    bars = figure.add_subplot(grid[rows + 1, :], sharex=nis)
    status = figure.add_subplot(grid[rows + 2, :], sharex=nis)
    _draw_nis(nis, view)
    _draw_bars(bars, view)
    draw_timeline(status, view, "What became of the epochs")
    for axis in (nis, bars):
        axis.tick_params(labelbottom=False)
    nis.margins(x=0.01)
    status.set_xlabel("time, s" + (f"   ({view.unsaid})" if view.unsaid else ""))
    one_legend(figure)


def _dots(axis: Any, t: Vector, values: Vector, limit: float, floor: float) -> None:
    """Values as dots; what lies beyond the limits as triangles at the border, so that nothing is hidden."""
    beyond: Flags = np.isfinite(values) & ((values > limit) | (values < floor))
    axis.plot(
        t, np.where(beyond, np.nan, values), ".", ms=1.6, color=QUIET, rasterized=len(t) > 5000, label="one image"
    )
    for side, marker, at in ((values > limit, "^", limit), (values < floor, "v", floor)):
        if bool((beyond & side).any()):
            chosen = beyond & side
            axis.plot(t[chosen], np.full(int(chosen.sum()), at), marker, ms=4.5, color=GATE, label="beyond the axis")
    axis.set_ylim(*(floor - 0.04 * (limit - floor), limit + 0.04 * (limit - floor)))


def _draw_innovation(axis: Any, view: RunView, column: str) -> None:
    t, values, gate = view.thin.times(), view.line(column), np.full(1, np.nan)
    if view.has(f"gate_{column}"):
        gate = view.largest(f"gate_{column}")
        for sign in (-1.0, 1.0):
            axis.plot(t, sign * gate, color=GATE, lw=1.1, label=f"gate, {100.0 * view.gate_probability:g} %")
    size = np.abs(values[np.isfinite(values)])
    limit = 8.0 * float(np.median(size)) if size.size else 1.0  # 5.4 sigma of a normal error, whatever glints do
    if np.isfinite(gate).any():
        limit = max(1.25 * float(np.nanpercentile(gate, 90)), 0.5 * limit)
    limit = limit or 1.0
    axis.axhline(0.0, color=QUIET, lw=0.7)
    _dots(axis, t, values, limit, -limit)
    axis.margins(x=0.01)


def _draw_nis(axis: Any, view: RunView) -> None:
    t, nis = view.thin.times(), view.line("nis")
    limit, usual = 10.0, ""
    bounds = [(0.95, PUBLISHED, "95 % limit of a consistent filter")]
    if not math.isnan(view.gate_probability):
        bounds.append((view.gate_probability, GATE, f"gate, {100.0 * view.gate_probability:g} %"))
    for probability, colour, label in bounds:
        line, alone = view.nis_bound(probability)
        if np.isfinite(line).any():
            usual = "; bounds of the usual number of spots" if alone else ""
            axis.plot(t, line, color=colour, lw=1.1, drawstyle="steps-mid", label=label)
            limit = 1.15 * float(np.nanmax(line))
    _dots(axis, t, nis, limit, 0.0)
    axis.set_ylim(0.0, 1.04 * limit)
    axis.set_title(f"NIS of everything seen, before the gate{usual}")
    axis.set_ylabel("NIS")


def _draw_bars(axis: Any, view: RunView) -> None:
    bars = view.nis_bars()
    if not bars:
        axis.set_title("NIS: no image was used")
        return
    edges = np.array([[bar.begin_s, bar.end_s] for bar in bars])
    middle, half = edges.mean(axis=1), 0.5 * np.diff(edges, axis=1)[:, 0]
    low, high, ratio = (np.array([getattr(bar, key) for bar in bars]) for key in ("lower", "upper", "ratio"))
    if not view.nis.withheld:
        said = "95 % interval of the mean"
        axis.bar(middle, high - low, 1.9 * half, bottom=low, color=SPREAD, alpha=0.18, lw=0, label=said)
    axis.axhline(1.0, color=QUIET, lw=0.7)
    axis.errorbar(middle, ratio, xerr=half, fmt="none", ecolor=INK, elinewidth=1.4, label="mean of a stretch")
    axis.set_title(f"Mean over stretches, epochs used whole. {view.nis}")
    axis.set_ylabel("NIS per dof")
    axis.set_ylim(min(0.5, 0.95 * float(ratio.min())), max(1.5, 1.05 * float(ratio.max())))


def draw_timeline(axis: Any, view: RunView, title: str) -> None:
    """Draw the rows of the timeline; a mark is never narrower than a row of the track."""
    begin, end = view.thin.begin, view.thin.end
    step = float(np.median(np.diff(begin))) if len(begin) > 1 else 1.0
    for place, row in enumerate(reversed(view.rows)):
        here = view.thin.high[view.names[row.column]] > 0.0
        spans = [(b, max(e - b, 0.0) + step) for b, e in zip(begin[here], end[here], strict=True)]
        axis.broken_barh(_joined(spans), (place - 0.36, 0.72), color=TIMELINE_COLOURS[row.colour], lw=0)
    axis.set_yticks(range(len(view.rows)), [row.label for row in reversed(view.rows)])
    axis.set_title(title)
    axis.grid(axis="y", visible=False)
    axis.set_ylim(-0.6, len(view.rows) - 0.4)


def _joined(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Spans (begin, length) that touch made one."""
    out: list[tuple[float, float]] = []
    for begin, length in spans:
        if out and begin <= out[-1][0] + out[-1][1] * (1.0 + 1e-9) + 1e-9:
            out[-1] = (out[-1][0], begin + length - out[-1][0])
        else:
            out.append((begin, length))
    return out
