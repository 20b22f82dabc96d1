"""The page of one run: figures, approach in space, states, measurements, timeline, and what the model assumed."""

import base64
import math
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Vector
from relnav.files.approach_page import approach_data, approach_section, misalignment_chart
from relnav.files.approach_view import MISALIGNMENT, CaptureLimits
from relnav.files.models import model_values
from relnav.files.report_page import key_cell, paragraph, section, table, tile, toolbar, write_page
from relnav.files.run_view import TURNS, WORDS, Quantity, RunView
from relnav.files.thinning import envelope_limits
from relnav.files.vehicle_page import SENSORS_SAID, TIMELINE_SAID, sensor_charts, vehicle_tiles
from relnav.navigation.status import EpochStatus

GROUPS = 8192
"""Of epochs, at most twice as many: what a browser draws without a wait."""
NOT_STARTED = "NOT STARTED: no image was confirmed by the next, and there is no state to draw."


def write_run_page(
    view: RunView, model: Any, path: Path, corridor_deg: float, capture: CaptureLimits, notes: tuple[str, ...]
) -> None:
    """Write the page; `model` is what was flown, None if that is not known; notes are for the reader.

    Corridor (half angle) and capture limits are the mission's: drawn, and the end of the run is held against them.
    """
    charts = _charts(view, capture)
    used = {line.get("column") for chart in charts for line in chart.get("lines", [])}
    used |= {line.get("sigma") for chart in charts for line in chart.get("lines", [])}
    used |= {row["column"] for chart in charts for row in chart.get("rows", [])}
    limits = {key: line for key, line in _limits(view).items() if key in used}
    columns = {name: view.line(name) for name in view.names if name in used} | limits
    data = {
        "time": base64.b64encode(np.asarray(view.thin.times(), dtype="<f8").tobytes()).decode(),
        "columns": {
            name: base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()
            for name, values in columns.items()
        },
        "charts": charts,
        "corridor": corridor_deg,
        "path": approach_data(view, capture),
    }
    log = view.metadata.get("log", "")
    title = f"{view.title}: {log}" if log else view.title
    thinned = "" if view.thin.whole else f", drawn as the extremes of {len(view.thin.begin)} groups: no peak is lost"
    epochs = f"{view.thin.epochs} epoch{'s' if view.thin.epochs != 1 else ''}"
    lead = f"{epochs}, {view.thin.begin[0]:.9g} s to {view.thin.end[-1]:.9g} s{thinned}."
    body = _body(view, model, corridor_deg, capture, notes, {chart["section"] for chart in charts})
    write_page(path, title, lead, body, data)


def _body(
    view: RunView, model: Any, corridor_deg: float, capture: CaptureLimits, notes: tuple[str, ...], shown: set[str]
) -> str:
    notes = notes if view.started else (NOT_STARTED, *notes)
    parts = [f'<div class="tiles">{"".join(_tiles(view))}</div>', *(paragraph(note) for note in notes)]
    parts.append(_TOOLS)
    if view.places:
        parts.append(approach_section(view, corridor_deg, capture))
    for key, title, said in _SECTIONS:
        if key not in shown:
            continue
        said = _OF_VEHICLES.get(key, said) if view.of_vehicle else said
        if key == "measurements" and view.unsaid:
            said = f"{said} {view.unsaid}"
        parts.append(
            section(
                title, paragraph(said), f'<div class="charts{" pairs" if key in _PAIRED else ""}" id="{key}"></div>'
            )
        )
    parts.append(section("Gate decisions and alarms", _events(view)))
    parts.append(section("Published figures", _claims(view)))
    parts.append(section("What the model assumed", _assumptions(model)))
    parts.append(section("Metadata of the track", table(("key", "value"), view.metadata.items())))
    return "".join(parts)


_TOOLS = toolbar(
    "Time",
    "span",
    ("in", "Zoom in", "+"),
    ("out", "Zoom out", "-"),
    ("left", "Earlier", ","),
    ("right", "Later", "."),
    ("all", "All", "0"),
)
_PAIRED = ("docking", "states", "ports")
_OF_VEHICLES = {"measurements": SENSORS_SAID, "timeline": TIMELINE_SAID}
_SECTIONS = (
    ("docking", "Docking quantities", "Estimate within its 3-sigma envelope, and reported 1-sigma beside the figure "
     "published for the sensor. Drag across a chart to zoom all of them; a double click shows everything."),
    ("states", "State", "Chaser relative to target in lvlh_ccsds, velocity in the turning frame."),
    ("ports", "Port from port", "Chaser's port from the target's, target axes: velocity in the turning target, "
     "attitude as a turn from the nearest attitude with parallel axes, rate of the target relative to the chaser."),
    ("measurements", "Measurements", "Innovations are measured minus predicted, of everything seen; the gate is the "
     "half width of the ellipsoid outside which an image (or a spot) is refused. NIS should average to its degrees of "
     "freedom."),
    ("timeline", "Timeline", "What became of the epochs; a mark is never narrower than one can see."),
)  # fmt: skip


def _epoch_tiles(view: RunView) -> list[str]:
    counts = view.counts
    used = counts[EpochStatus.UPDATED] + counts[EpochStatus.STARTED]
    refused = counts[EpochStatus.PARTIAL] + counts[EpochStatus.REJECTED]
    started = next((event.begin_s for event in view.events if event.what == "STARTED"), math.nan)
    since = f"{started:.6g} s" if started == started else "never"
    tiles = [
        tile("started", since, f"starts: {counts[EpochStatus.STARTED]}", "" if view.started else "bad"),
        tile("epochs used whole", str(used), f"of {view.thin.epochs}"),
        tile("epochs with something refused", str(refused), f"{counts[EpochStatus.PREDICTED]} without a measurement"),
    ]
    if view.ambiguous >= 0:
        fine = f"of {view.thin.epochs}", "good" if view.started else ""
        note, verdict = ("not to be used", "bad") if view.ambiguous else fine
        tiles.append(tile("epochs with an ambiguous pose", str(view.ambiguous), note, verdict))
    if view.nis.dof:
        verdict = "bad" if view.nis.overconfident else "" if view.nis.withheld else "good"
        said = str(view.nis).partition(", ")[2]
        tiles.append(tile("NIS per degree of freedom", f"{view.nis.ratio:.3f}", said, verdict))
    return tiles


def _tiles(view: RunView) -> list[str]:
    tiles = vehicle_tiles(view) if view.of_vehicle else _epoch_tiles(view)
    for quantity in view.docking():
        last = _last(view.largest(quantity.sigma)) if view.has(quantity.sigma) else math.nan
        claim = view.claim(quantity)
        verdict = "" if claim is None else "good" if last <= claim.value else "bad"
        note = "" if claim is None else f"published {claim.value:g} {claim.unit}, statistic {claim.statistic}"
        note += f"; {claim.condition}" if claim is not None and view.of_vehicle else ""
        tiles.append(tile(f"{quantity.label}, 1-sigma at the end", f"{last:.3g} {quantity.unit}", note, verdict))
    return tiles


def _last(values: Vector) -> float:
    known = values[np.isfinite(values)]
    return float(known[-1]) if known.size else math.nan


def _charts(view: RunView, capture: CaptureLimits) -> list[dict[str, Any]]:
    charts: list[dict[str, Any]] = []
    for quantity in view.docking():
        charts.append(_value(quantity, "docking", view))
        charts.append(_spread(quantity, "docking", 1.0, view))
    if view.has(MISALIGNMENT):
        charts.append(misalignment_chart(capture.angle_deg))
    for quantity in view.states():
        charts.append(_value(quantity, "states", view))
        charts.append(_spread(quantity, "states", 3.0, view))
    for quantity in view.ports():
        charts.append(_value(quantity, "ports", view))
        charts.append(_spread(quantity, "ports", 3.0, view))
    charts += [
        {"section": "states", "title": f"Target attitude, {name[11]}: 3-sigma", "unit": "deg", "log": True,
         "lines": [{"column": name, "times": 3.0, "label": "3-sigma", "colour": "spread"}]}
        for name in TURNS if view.has(name)
    ]  # fmt: skip
    for quantity in view.innovations:
        gate = f"gate_{quantity.column}"
        lines: list[dict[str, Any]] = [
            {"column": quantity.column, "label": "innovation", "colour": "dots", "kind": "dots"}
        ]
        if view.has(gate):
            lines += [
                {"column": gate, "times": sign, "label": f"{'+' if sign > 0 else '-'} gate", "colour": "gate"}
                for sign in (1.0, -1.0)
            ]
        charts.append(
            {"section": "measurements", "title": quantity.label, "unit": quantity.unit, "lines": lines,
             "limits": _robust(view, quantity.column, gate)}
        )  # fmt: skip
    charts += sensor_charts(view) if view.of_vehicle else [_nis(view)]
    rows = [{"label": row.label, "column": row.column, "colour": row.colour} for row in view.rows]
    title = "Which sensor when" if view.of_vehicle else "What became of the epochs"
    if not rows:  # a vehicle's track without columns of its sensors
        return charts
    charts.append({"section": "timeline", "title": title, "wide": True, "rows": rows})
    return charts


def _value(quantity: Quantity, where: str, view: RunView) -> dict[str, Any]:
    line = {"column": quantity.column, "label": "estimate", "colour": "estimate"}
    known = view.line(quantity.column)
    three = np.zeros_like(known)
    if view.has(quantity.sigma):
        line["sigma"] = quantity.sigma
        three = 3.0 * view.largest(quantity.sigma)
    limits = list(envelope_limits(known, three, 0.08))
    return {"section": where, "title": quantity.label, "unit": quantity.unit, "lines": [line], "limits": limits}


def _spread(quantity: Quantity, where: str, times: float, view: RunView) -> dict[str, Any]:
    label = f"{times:g}-sigma"
    lines: list[dict[str, Any]] = []
    if view.has(quantity.sigma):
        lines.append({"column": quantity.sigma, "times": times, "label": label, "colour": "spread"})
    if times == 1.0 and view.has(quantity.protection):
        lines.append({"column": quantity.protection, "label": "protection level, 1e-7", "colour": "gate"})
    claim = view.claim(quantity)
    if claim is not None and times == 1.0:
        lines.append({"constant": claim.value, "label": "published", "colour": "published", "dash": True})
    return {"section": where, "title": f"{quantity.label}, {label}", "unit": quantity.unit, "log": True, "lines": lines}


def _nis(view: RunView) -> dict[str, Any]:
    lines: list[dict[str, Any]] = [{"column": "nis", "label": "NIS", "colour": "dots", "kind": "dots"}]
    limits = _limits(view)
    names = {"nis_limit_95": ("95 % limit of a consistent filter", "published"), "nis_gate": ("gate", "gate")}
    lines += [
        {"column": key, "label": names[key][0], "colour": names[key][1], "kind": "steps"}
        for key in limits
    ]  # fmt: skip
    top = max((float(np.nanmax(line)) for line in limits.values() if np.isfinite(line).any()), default=10.0)
    title = "NIS of everything seen, before the gate"
    chart = {"section": "measurements", "title": title, "unit": "NIS", "wide": True, "lines": lines}
    return chart | {"limits": [0.0, 1.2 * top]}


def _limits(view: RunView) -> dict[str, Vector]:
    if view.of_vehicle:
        return {}
    out = {"nis_limit_95": view.nis_bound(0.95)[0]}
    if not math.isnan(view.gate_probability):
        out["nis_gate"] = view.nis_bound(view.gate_probability)[0]
    return out


def _robust(view: RunView, column: str, gate: str) -> list[float]:
    """Limits that a glint does not stretch."""
    size = np.abs(view.line(column))
    size = size[np.isfinite(size)]
    limit = 8.0 * float(np.median(size)) if size.size else 1.0
    if view.has(gate):
        limit = max(0.5 * limit, 1.25 * float(np.nanpercentile(view.largest(gate), 90)))
    return [-(limit or 1.0), limit or 1.0]


def _events(view: RunView) -> str:
    rows = [(f"{event.begin_s:.9g}", f"{event.end_s:.9g}", event.epochs, _said(event.what)) for event in view.events]
    if not rows:
        return paragraph("Nothing was refused, and the filter never started: there is nothing to tell.")
    more = f"And {view.events_left_out} more; the timeline shows them all." if view.events_left_out else ""
    rows_of_all = table(("from, s", "to, s", "epochs", "what"), rows, (0, 1, 2))
    return f'<div class="long">{rows_of_all}</div>' + paragraph(more)


def _said(what: str) -> str:
    return WORDS[EpochStatus[what]] if what in EpochStatus.__members__ else what


def _claims(view: RunView) -> str:
    if not view.claims:
        return paragraph("No figures are published for this model, or the model is not known here (--model).")
    rows = [
        (c.quantity, f"{c.value:g} {c.unit}", c.statistic, c.condition, c.page, f"{c.expected}: {c.reason}")
        for c in view.claims
    ]
    return table(("quantity", "published", "statistic", "condition", "where it stands", "what we expect"), rows)


def _assumptions(model: Any) -> str:
    if model is None:
        return paragraph("The model is not known here; name it with --model to see its values and their sources.")
    rows = [(key_cell(key), str(entry["value"]), entry["source"]) for key, entry in model_values(model).items()]
    return paragraph(f"{model.name}: {model.title}") + table(("key", "value", "where it comes from"), rows)
