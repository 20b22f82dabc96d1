"""A run as pictures: the approach, the state with its envelopes, the measurements with their gates."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from relnav.accuracy.published import Claim
from relnav.files.atomic import check_folder
from relnav.files.measurement_picture import draw_measurements
from relnav.files.models import mission_of
from relnav.files.picture_style import (
    ESTIMATE,
    GATE,
    INK,
    QUIET,
    SMALLEST_PLAIN,
    SPREAD,
    check_picture,
    fine_grid,
    heading,
    named_line,
    new_figure,
    one_legend,
    plain_decades,
    plainly,
    save,
    styled,
)
from relnav.files.run_view import TURNS, Quantity, RunView, watcher_of
from relnav.files.sensor_picture import draw_sensors
from relnav.files.space_picture import draw_space
from relnav.files.thinning import envelope_limits
from relnav.files.tracks import ROWS_AT_ONCE
from relnav.files.wording import printable

GROUPS = 1500
"""Of epochs: more than a page has dots across."""
WIDTH, HEIGHT = 11.7, 8.3
CORRIDOR_DEG = 10.0
PROTECTION_SAID = "protection level, exceeded with a probability of 1e-7"


def track_figures(view: RunView, corridor_deg: float = CORRIDOR_DEG) -> list[Any]:
    """The sheets, a figure each."""
    sheets = []
    for title, draw in _sheets(view, corridor_deg).items():
        with styled():
            figure = new_figure(WIDTH, HEIGHT)
            draw(figure, view)
            _head(figure, view, title)
            sheets.append(figure)
    return sheets


def track_figure(view: RunView, corridor_deg: float = CORRIDOR_DEG) -> Any:
    """The sheets in one figure, one below the other."""
    with styled():
        sheets = _sheets(view, corridor_deg)
        figure = new_figure(WIDTH, len(sheets) * HEIGHT)
        parts = figure.subfigures(len(sheets), 1, squeeze=False)[:, 0]
        for part, (title, draw) in zip(parts, sheets.items(), strict=True):
            draw(part, view)
            _head(part, view, title)
    return figure


def draw_track(view: RunView, path: Path, corridor_deg: float = CORRIDOR_DEG) -> None:
    """Draw a run; .png and .svg hold the sheets one below the other, .pdf has a page for each."""
    if path.suffix.lower() == ".pdf":
        save(track_figures(view, corridor_deg), path)
    else:
        save([track_figure(view, corridor_deg)], path)


def _sheets(view: RunView, corridor_deg: float) -> dict[str, Any]:
    """What there is to draw, by title; without a state only the measurements."""
    if not view.docking():
        return {"Measurements (the filter never started)": draw_measurements}
    sheets = {
        "Approach": lambda figure, view: _draw_approach(figure, view, corridor_deg),
        "Approach in space": lambda figure, view: draw_space(figure, view, corridor_deg),
        "State and its 3-sigma": _draw_states,
        "Port from port, target axes, and its 3-sigma": _draw_ports,
        "Measurements": draw_measurements,
        "Sensors": draw_sensors,
    }
    there = [
        bool(view.docking()),
        bool(view.places),
        bool(view.states()),
        bool(view.ports()),
        not view.of_vehicle,
        bool(view.sensors),
    ]
    return {title: draw for (title, draw), here in zip(sheets.items(), there, strict=True) if here}


def _head(figure: Any, view: RunView, title: str) -> None:
    log = view.metadata.get("log", "")
    said = f"{title}: {printable(view.title)}" + (f"; {printable(log)}" if log else "")
    heading(figure, said)


def _draw_approach(figure: Any, view: RunView, corridor_deg: float) -> None:
    quantities = view.docking()
    grid = figure.add_gridspec(len(quantities) * 2, 3, width_ratios=[1.25, 1.0, 1.0])
    half = len(quantities)
    top = figure.add_subplot(grid[:half, 0])
    side = figure.add_subplot(grid[half:, 0], sharex=top)
    _draw_paths(view, top, side, corridor_deg)
    first = None
    for row, quantity in enumerate(quantities):
        cells = slice(2 * row, 2 * row + 2)
        axis = figure.add_subplot(grid[cells, 1], sharex=first)
        first = first or axis
        _draw_value(axis, view, quantity)
        spread = figure.add_subplot(grid[cells, 2], sharex=first)
        _draw_spread(spread, view, quantity, 1.0, view.claim(quantity))
        for each in (axis, spread):
            if row + 1 < len(quantities):
                each.tick_params(labelbottom=False)
            else:
                each.set_xlabel("time, s")
    one_legend(figure)


def _draw_paths(view: RunView, top: Any, side: Any, corridor_deg: float) -> None:
    """The path from above and from the side, port at the left, with the corridor and the end's ellipse."""
    place, sigma = view.place()
    known = np.isfinite(place).all(axis=0)
    if not known.any():
        return
    place, sigma = place[:, known], sigma[:, known]
    far = 1.04 * float(place[0].max())
    widest = math.tan(math.radians(corridor_deg))
    off = float(np.abs(place[1:]).max())
    height = 1.25 * max(off, min(widest * far, 3.0 * off))
    for axis, row, name in ((top, 1, "y"), (side, 2, "z")):
        x = np.array([0.0, far])
        axis.fill_between(x, -widest * x, widest * x, color=SPREAD, alpha=0.09, lw=0)
        for sign in (-1.0, 1.0):
            axis.plot(x, sign * widest * x, color=SPREAD, lw=0.9, label=f"corridor, {corridor_deg:g} deg half angle")
        axis.axhline(0.0, color=QUIET, lw=0.7)
        axis.plot(place[0], place[row], color=ESTIMATE, label="estimate")
        axis.plot(place[0, 0], place[row, 0], "o", ms=5, mfc="white", color=ESTIMATE)
        axis.plot(place[0, -1], place[row, -1], "o", ms=5, color=ESTIMATE)
        axis.plot(0.0, 0.0, marker="s", ms=7, color=INK, clip_on=False, zorder=5)
        axis.set_xlim(0.0, far)
        axis.set_ylim(height, -height)  # y to the right of who looks out of the port, z down
        axis.set_ylabel(f"{name} of the docking frame, m")
    end = ", ".join(f"{1e3 * 3.0 * value:.2g}" for value in sigma[:, -1])
    top.set_title("From above")
    side.set_title("From the side")
    top.tick_params(labelbottom=False)
    side.set_xlabel(f"x out of the port, m   (port: square, start: ring, end: dot;\n3-sigma at the end {end} mm)")


def _draw_value(axis: Any, view: RunView, quantity: Quantity) -> None:
    """A quantity within its 3-sigma envelope."""
    t, value = view.thin.times(), view.line(quantity.column)
    three = np.zeros_like(value)
    if view.has(quantity.sigma):
        three = 3.0 * view.largest(quantity.sigma)
        axis.fill_between(t, value - three, value + three, color=ESTIMATE, alpha=0.22, lw=0, label="3-sigma envelope")
    axis.plot(t, value, color=ESTIMATE, label="estimate")
    axis.set_ylim(*envelope_limits(value, three, 0.08))
    axis.set_title(quantity.label)
    axis.set_ylabel(quantity.unit)
    axis.margins(x=0.01)


def _draw_spread(axis: Any, view: RunView, quantity: Quantity, times: float, claim: Claim | None) -> None:
    """Its sigma over time, on a logarithmic axis, beside the published figure."""
    name, title = f"reported {times:g}-sigma", f"{quantity.label}, {times:g}-sigma"
    if view.has(quantity.sigma):
        spread = times * view.largest(quantity.sigma)
        axis.semilogy(view.thin.times(), spread, color=SPREAD, label=name)
        last = float(spread[np.isfinite(spread)][-1])
        ends = f"ends at {plainly(last, 2, exponent=last < SMALLEST_PLAIN)} {quantity.unit}"
        axis.set_title(ends, loc="right", fontsize=8, fontweight="normal", color=SPREAD)
    if times == 1.0 and view.has(quantity.protection):
        level = view.largest(quantity.protection)
        axis.semilogy(view.thin.times(), level, color=GATE, lw=1.0, label=PROTECTION_SAID)
    if claim is not None:
        where = f": {claim.condition}" if view.of_vehicle else ""
        named_line(axis, claim.value, f"published {claim.value:g} {claim.unit}", f"published figure{where}")
    plain_decades(axis)
    axis.set_title(title)
    axis.set_ylabel(quantity.unit)
    axis.margins(x=0.01, y=0.12)
    fine_grid(axis)


def _draw_states(figure: Any, view: RunView) -> None:
    turns = [Quantity(name.removeprefix("sigma_"), f"Target attitude, {name[11]}", "deg") for name in TURNS]
    _draw_grid(figure, view, view.states(), [turn for turn in turns if view.has(turn.sigma)])


def _draw_ports(figure: Any, view: RunView) -> None:
    _draw_grid(figure, view, view.ports(), [])


def _draw_grid(figure: Any, view: RunView, quantities: tuple[Quantity, ...], alone: list[Quantity]) -> None:
    """Quantities by threes, each over its 3-sigma; below them those of which only that is known."""
    rows = [quantities[k : k + 3] for k in range(0, len(quantities), 3)]
    ratios = [r for _ in rows for r in (1.0, 0.75)] + ([0.75] if alone else [])
    grid = figure.add_gridspec(len(ratios), 3, height_ratios=ratios)
    first = None
    for row, group in enumerate(rows):
        for column, quantity in enumerate(group):
            axis = figure.add_subplot(grid[2 * row, column], sharex=first)
            first = first or axis
            _draw_value(axis, view, quantity)
            axis.tick_params(labelbottom=False)
            spread = figure.add_subplot(grid[2 * row + 1, column], sharex=first)
            _draw_spread(spread, view, quantity, 3.0, None)
            spread.set_title("")
            spread.set_ylabel(f"3-sigma, {quantity.unit}")
            spread.tick_params(labelbottom=row + 1 == len(rows) and not alone)
    for column, quantity in enumerate(alone):
        axis = figure.add_subplot(grid[-1, column], sharex=first)
        _draw_spread(axis, view, quantity, 3.0, None)
        axis.set_title(quantity.label)
        axis.set_ylabel(f"3-sigma, {quantity.unit}")
    for axis in figure.axes[-3:] if alone else figure.axes[-6:][1::2]:
        axis.set_xlabel("time, s")
    one_legend(figure)


def plot_solution(solution: Any, path: Any, model: Any, corridor_deg: float) -> Any:
    """The figure of a solution, as `Solution.plot` describes it."""
    if path is not None:
        path = Path(path)
        check_folder(path)
        check_picture(path)
    if not 0.0 < corridor_deg <= 80.0:
        raise ValueError(f"corridor_deg is above 0 and up to 80; got {corridor_deg!r}")
    watcher = watcher_of(mission_of(solution) if model is None else model, GROUPS)
    for begin in range(0, len(solution), ROWS_AT_ONCE):
        watcher.take(solution.part(begin, begin + ROWS_AT_ONCE))
    view = watcher.view()
    figure = track_figure(view, corridor_deg)
    if path is not None and path.suffix.lower() == ".pdf":
        draw_track(view, path, corridor_deg)
    elif path is not None:
        save([figure], path)
    return figure
