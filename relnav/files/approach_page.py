"""The approach in space on the page of a run: what is drawn, and in words where the run ends within capture limits."""

from typing import Any

import numpy as np

from relnav.arrays import Vector
from relnav.files.approach_view import MISALIGNMENT, MISALIGNMENT_3_SIGMA, CaptureLimits, verdicts
from relnav.files.report_page import paragraph, section, table, toolbar
from relnav.files.run_view import RunView

PATH_POINTS = 1200
_TOOLS = toolbar(
    "Approach in space",
    "drawn",
    ("near", "Closer", "+"),
    ("far", "Farther", "-"),
    ("path", "Whole approach", "0"),
    classes="tools still",
)
_CANVAS = (
    '<canvas id="space" tabindex="0" role="img" aria-label="Approach in the docking frame: arrow keys turn it, '
    'plus and minus come closer to the port and go away from it"></canvas>'
)


def approach_section(view: RunView, corridor_deg: float, capture: CaptureLimits) -> str:
    """The drawing, what it shows, and the end of the run beside the limits."""
    said = paragraph(_seen(view, corridor_deg)), _captured(view, capture)
    return section("Approach in space", _TOOLS, _CANVAS, *said)


def _seen(view: RunView, corridor_deg: float) -> str:
    """What the drawing shows, in words."""
    if all(place.correlated for place in view.places):
        axes = "along the eigenvectors of its covariance in docking axes"
    elif view.has("range_m"):
        axes = (
            "from the sigmas of range, azimuth and elevation alone, as if they were not correlated (the whole "
            "covariance needs the docking frame of the model: --model)"
        )
    else:
        axes = "along the docking axes, as the track holds no correlations"
    return (
        f"Cone: a corridor of {corridor_deg:g} deg half angle, yours to state (--corridor-deg). Ellipsoids: 3-sigma "
        f"of the position at {len(view.places)} epochs or as many as have room, {axes}, magnified as said above; "
        "dashed: larger still. Square: port; dot: end. Drag, or use the arrow keys, to turn it."
    )


def _captured(view: RunView, capture: CaptureLimits) -> str:
    """The end of the run beside the limits, in words and numbers."""
    end, what = view.places[-1], "camera" if view.has("range_m") else "chaser's port"
    rows = verdicts(end, capture)
    said = ""
    if capture.angle_deg and all(row.unit != "deg" for row in rows):
        said = "Nothing to hold against --capture-deg: the run has no relative attitude, or its model is not known. "
    if not rows:
        return paragraph(said or "Your port's capture limits: --capture-m, --capture-distance-m, --capture-deg.")
    if all(row.inside for row in rows):
        lies = "inside the port's capture limits, and so do its 3 sigma"
    elif all(row.estimate <= row.limit for row in rows):
        lies = "inside the port's capture limits, but its 3 sigma reach beyond"
    else:
        lies = "outside the port's capture limits"
    drawn = "Orange: what the port captures, to scale. " if capture.lateral_m or capture.distance_m else ""
    said += f"{drawn}At the end of the run, {end.t_s:.9g} s, the {what} lies {lies}."
    shown = [
        (row.quantity, *(f"{v:.4g} {row.unit}" for v in (row.estimate, row.largest, row.limit)), row.words)
        for row in rows
    ]
    head = ("at the end of the run", "estimate", "largest within 3 sigma", "capture limit", "the end lies")
    return paragraph(said) + table(head, shown, (1, 2, 3))


def approach_data(view: RunView, capture: CaptureLimits) -> dict[str, Any] | None:
    """The approach in docking axes, m: a path, 3-sigma ellipsoids by their semi-axes, and the limits."""
    place, _ = view.place()
    known = np.isfinite(place).all(axis=0)
    if not known.any() or not view.places:
        return None
    place = place[:, known]
    at = np.unique(np.linspace(0, place.shape[1] - 1, PATH_POINTS).astype(np.int64))
    ellipsoids = [
        {"t": one.t_s, "at": _short(one.position_m), "axes": [_short(axis) for axis in one.axes_m().T]}
        for one in view.places
    ]
    x, y, z = (_short(row) for row in place[:, at])
    far = 1.06 * float(np.linalg.norm(place, axis=0).max())
    said = {"x": x, "y": y, "z": z, "far": far, "ellipsoids": ellipsoids}
    return said | {"capture": capture.lateral_m, "distance": capture.distance_m}


def _short(values: Vector) -> list[float]:
    return [float(f"{value:.9g}") for value in values]


def misalignment_chart(limit_deg: float) -> dict[str, Any]:
    """Of a run that has a relative attitude; limit 0: none."""
    lines: list[dict[str, Any]] = [
        {"column": MISALIGNMENT, "label": "estimate", "colour": "estimate"},
        {"column": MISALIGNMENT_3_SIGMA, "label": "largest within 3 sigma, at most", "colour": "spread"},
    ]
    if limit_deg:
        lines.append({"constant": limit_deg, "label": "capture limit", "colour": "published", "dash": True})
    title = "Angular misalignment: from the docked attitude"
    return {"section": "docking", "title": title, "unit": "deg", "log": True, "wide": True, "lines": lines}
