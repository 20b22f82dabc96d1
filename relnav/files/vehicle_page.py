"""What the report page says of a vehicle's run beside what it says of any: its sensors, and the protection level."""

import math
from typing import Any

import numpy as np

from relnav.files.report_page import tile
from relnav.files.run_view import PORTS, RunView
from relnav.spacecraft import RESERVED
from relnav.vehicle.monitor import ALARM_SIGMA, FADES_S

SENSORS_SAID = (
    f"Squared innovations of some {FADES_S:g} s above what is expected, in the monitoring filter, in sigma: beyond "
    f"{ALARM_SIGMA:g} is an alarm. Drift: how far the innovations look like a drift of each sensor, the gyro or the "
    "thrusters, with the same limit. NIS per degree of freedom, before the gate, is that of the filter itself, "
    "averaged over ten observations: its mean is one, and constant errors move it from there."
)
TIMELINE_SAID = "Which sensor was used when: a mark for each row of the track with an accepted observation."


def vehicle_tiles(view: RunView) -> list[str]:
    """Figures of the summary."""
    alarmed = [row.label for row in view.rows if row.colour == "gate"]
    used = [name for name in view.sensors if view.has(f"used_{name}") and view.line(f"used_{name}").max() > 0.0]
    tiles = [
        tile("rows", str(view.thin.epochs), "of the track"),
        tile("sensors used", str(len(used)), f"of {len(view.sensors)}"),
        tile("alarms", str(len(alarmed)), ", ".join(alarmed) or "none", "bad" if alarmed else "good"),
    ]
    levels = [view.largest(q.protection) for q in PORTS if view.has(q.protection)]
    if levels:
        last = max(float(level[np.isfinite(level)][-1]) for level in levels)
        said = "largest axis; exceeded with a probability of 1e-7"
        tiles.append(tile("protection level at the end", f"{last:.3g} m", said))
    return tiles


def sensor_charts(view: RunView) -> list[dict[str, Any]]:
    """Charts of the section of measurements: what is watched, and NIS."""
    charts: list[dict[str, Any]] = []
    for name in [*view.sensors, *RESERVED]:
        nis = f"nis_{name}"
        for what in ("deviation", "drift"):
            column = f"{what}_{name}"
            if view.has(column):
                low, high = _ends(view, column)
                limits = [min(-3.5, 1.1 * low), max(1.15 * ALARM_SIGMA, 1.08 * high)]
                charts.append(_chart(f"{name}: {what}", "sigma", _with_limit(column, what), limits))
        if view.has(nis):
            lines: list[dict[str, Any]] = [
                {"column": nis, "label": "NIS per dof", "colour": "spread"},
                {"constant": 1.0, "label": "expected", "colour": "soft", "dash": True},
            ]
            limits = [0.0, max(2.0, 1.08 * _ends(view, nis)[1])]
            charts.append(_chart(f"{name}: NIS per degree of freedom", "NIS per dof", lines, limits))
    return charts


def _with_limit(column: str, label: str) -> list[dict[str, Any]]:
    return [
        {"column": column, "label": label, "colour": "estimate"},
        {"constant": ALARM_SIGMA, "label": f"alarm, {ALARM_SIGMA:g}", "colour": "gate", "dash": True},
    ]


def _ends(view: RunView, column: str) -> tuple[float, float]:
    values = view.line(column)
    return float(np.nanmin(values)), float(np.nanmax(values))


def _chart(title: str, unit: str, lines: list[dict[str, Any]], limits: list[float]) -> dict[str, Any]:
    assert all(math.isfinite(limit) for limit in limits)
    return {"section": "measurements", "title": title, "unit": unit, "lines": lines, "limits": limits}
