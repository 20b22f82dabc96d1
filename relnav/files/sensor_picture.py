"""How the sensors of a vehicle fare, as a picture: which was used when, and whether it is what is believed of it."""

from typing import Any

import numpy as np

from relnav.files.measurement_picture import draw_timeline
from relnav.files.picture_style import GATE, QUIET, SERIES, fine_grid, one_legend, plain_decades
from relnav.files.run_view import RunView
from relnav.spacecraft import RESERVED
from relnav.vehicle.monitor import ALARM_SIGMA, FADES_S

TIMELINE_TITLE = "Which sensor when"
DEVIATION_TITLE = (
    f"Squared innovations of some {FADES_S:g} s above what is expected, in the monitoring filter: "
    f"beyond {ALARM_SIGMA:g} sigma is an alarm"
)
DRIFT_TITLE = (
    f"How far innovations look like a drift of each, in the monitoring filter: beyond {ALARM_SIGMA:g} sigma is an alarm"
)
NIS_TITLE = "NIS per degree of freedom before the gate, averaged over ten observations; constant errors move it from 1"


def draw_sensors(figure: Any, view: RunView) -> None:
    """Draw the sheet."""
    names = [*view.sensors, *RESERVED]
    told = [name for name in view.sensors if view.has(f"nis_{name}")]
    grid = figure.add_gridspec(4, 1, height_ratios=[0.3 + 0.13 * len(view.rows), 1.0, 1.0, 1.0])
    timeline = figure.add_subplot(grid[0])
    draw_timeline(timeline, view, TIMELINE_TITLE)
    watched, drifting, nis = (figure.add_subplot(grid[k], sharex=timeline) for k in (1, 2, 3))
    colours = {name: SERIES[k % len(SERIES)] for k, name in enumerate(names)}
    _draw_deviations(watched, view, "deviation", colours)
    watched.set_title(DEVIATION_TITLE)
    _draw_deviations(drifting, view, "drift", colours)
    drifting.set_title(DRIFT_TITLE)
    for name in told:
        nis.plot(view.thin.times(), view.line(f"nis_{name}"), color=colours[name], lw=1.0, label=name)
    nis.axhline(1.0, color=QUIET, lw=1.0)
    if told:
        nis.set_yscale("log")
        plain_decades(nis)
    nis.set_title(NIS_TITLE)
    nis.set_ylabel("NIS per dof")
    nis.set_xlabel("time, s")
    for axis in (timeline, watched, drifting):
        axis.tick_params(labelbottom=False)
    timeline.margins(x=0.01)
    if told:
        fine_grid(nis)
    one_legend(figure)


def _draw_deviations(axis: Any, view: RunView, what: str, colours: dict[str, str]) -> None:
    """Draw a test statistic of each that has one, with the alarm limit."""
    shown = {name: view.line(f"{what}_{name}") for name in colours if view.has(f"{what}_{name}")}
    axis.axhline(ALARM_SIGMA, color=GATE, lw=1.3, ls=(0, (5, 2)), label=f"alarm, {ALARM_SIGMA:g} sigma")
    axis.axhline(0.0, color=QUIET, lw=0.7)
    for name, line in shown.items():
        axis.plot(view.thin.times(), line, color=colours[name], lw=1.0, label=name)
    most = max((float(np.nanmax(line)) for line in shown.values()), default=0.0)
    least = min((float(np.nanmin(line)) for line in shown.values()), default=0.0)
    axis.set_ylim(min(-3.5, 1.1 * least), max(1.15 * ALARM_SIGMA, 1.08 * most))
    axis.set_ylabel("sigma")
