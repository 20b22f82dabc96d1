"""The page of a campaign: its summary, distributions over the runs, and what was flown, from the campaign's folder."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from relnav.accuracy.campaign_summary import WRONG_SAID, CampaignSummary, summary_of
from relnav.arrays import Vector
from relnav.errors import InputError
from relnav.estimation.consistency import Consistency
from relnav.files.accuracy_page import figure
from relnav.files.campaign import SUMMARY
from relnav.files.campaign_folder import DESCRIPTION, RUNS, Cut, Runs, missing
from relnav.files.campaign_pictures import (
    BANDS_SAID,
    FINAL_SAID,
    SHARES,
    final_ratio,
    ratio_edges,
    ratio_title,
    rms_by_bin,
)
from relnav.files.report_page import Markup, key_cell, paragraph, section, table, tile, words, write_page
from relnav.files.tables import read_json
from relnav.files.wording import shown

FAILED_SHOWN = 50
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 400.0, 210.0, 52.0, 18.0, 8.0, 36.0
"""Of a chart, in units of its view box, and the margins around what is drawn."""


@dataclass(frozen=True)
class FlownCampaign:
    """What a finished campaign's folder holds: what was flown, in plain values, its summary, and its runs."""

    described: dict[str, Any]
    summary: CampaignSummary
    runs: Runs


def read_campaign(folder: Path) -> FlownCampaign:
    """A finished campaign.

    Raises
    ------
    InputError
        If the folder holds none, an unfinished one, or files that are not a campaign's.
    """
    go_on = "the `relnav campaign` command that began it goes on with it"
    if not (folder / DESCRIPTION).is_file():
        raise InputError(f"{folder}: no campaign's folder, as it holds no {DESCRIPTION}; `relnav campaign` makes one")
    described = read_json(folder / DESCRIPTION, "a campaign's description")
    if isinstance(described, dict) and described.get("design"):
        raise InputError(f"{folder}: holds sensitivities, whose table and picture are there; no campaign")
    try:
        runs, batch = int(described["runs"]), int(described["batch"])
        good = runs > 0 and batch > 0 and all(isinstance(described[key], dict) for key in ("model", "scenario"))
        named = {key: str(described[key]) for key in ("method", "seed", "relnav", "code")}
    except (KeyError, TypeError, ValueError, OverflowError):
        good = False
    if not good:
        raise InputError(f"{folder / DESCRIPTION}: not the description of a campaign")
    cut = Cut(runs, range(0, runs, batch))
    there = len(list((folder / RUNS).iterdir())) if (folder / RUNS).is_dir() else 0
    left = len(cut.starts) - there if there < len(cut.starts) else len(missing(folder, cut))
    if left:
        raise InputError(f"{folder}: unfinished, {left} of {len(cut.starts)} batches of runs are missing; {go_on}")
    if not (folder / SUMMARY).is_file():
        raise InputError(f"{folder}: unfinished, as it holds no {SUMMARY}; {go_on}")
    plain = read_json(folder / SUMMARY, "a campaign's summary")
    try:
        summary = summary_of(plain)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{folder / SUMMARY}: not the summary of a campaign; delete it, and {go_on}") from error
    if summary.runs != runs or len(summary.bins) % max(1, len(summary.nees_by_bin)) or not summary.final:
        raise InputError(f"{folder / SUMMARY}: not the summary of this campaign; delete it, and {go_on}")
    return FlownCampaign(described | named, summary, Runs(folder, cut))


def write_campaign_page(flown: FlownCampaign, path: Path) -> None:
    """Write the page of a campaign.

    Raises
    ------
    InputError
        If a file of runs is damaged, or of another campaign.
    """
    told, summary = flown.described, flown.summary
    try:
        failed = flown.runs.failed().slice(0, FAILED_SHOWN).to_pydict()
        by_range, at_end = _by_range(flown), _at_end(flown)
        assumed, uncertain = (
            [(key_cell(key), value) for key, value in _values(told[part])] for part in ("model", "scenario")
        )
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, ArithmeticError, RecursionError) as error:
        where = flown.runs.folder
        raise InputError(f"{where}: runs and {DESCRIPTION} do not belong together: {shown(error)}") from error
    parts = [f'<div class="tiles">{"".join(_tiles(summary))}</div>']
    parts.append(
        section(
            "Consistency of the covariance",
            paragraph(_HONEST_SAID) + (paragraph(summary.note) if summary.note else ""),
            table(_HONEST, _honest(summary), (1, 2, 3)),
        )
    )
    parts.append(section("Errors by range", by_range, table(_BINS, _bins(summary), (2, 3, 4, 5, 6, 7))))
    parts.append(section("Errors at the end", at_end, table(_FINAL, _final(summary), (1, 2, 3, 4, 5))))
    if failed["run"]:
        said = paragraph(
            f"{summary.outcomes.get('failed', 0)} runs failed; of these at most {FAILED_SHOWN} are listed."
        )
        rows = zip(failed["run"], failed["reason"], strict=True)
        parts.append(section("Runs that failed", said, table(("run", "reason"), rows, (0,))))
    campaign = [(key, told[key]) for key in ("relnav", "code", "method", "seed", "runs", "batch")]
    parts.append(section("What was flown", table(("key", "value"), campaign)))
    parts.append(section("What the model assumed", table(("key", "value"), assumed)))
    parts.append(section("What the scenario made uncertain", table(("key", "value"), uncertain)))
    lead = f"{summary.runs} approaches, method {told['method']}, seed {told['seed']}, flown by relnav {told['relnav']}."
    write_page(path, f"Campaign of {told['model'].get('name', '')}", lead, "".join(parts))


_HONEST = ("where", "per degree of freedom", "interval", "degrees of freedom", "verdict")
_HONEST_SAID = "95 % intervals; NEES of one epoch of each run: runs are independent of one another."
_BINS = ("range, m", "quantity", "runs", "rms", "worst run", "1-sigma", "published", "runs within")
_FINAL = ("component", "mean", "deviation", "99.73 %", "worst", "1-sigma")


def _tiles(summary: CampaignSummary) -> Iterator[str]:
    outcomes = {name.replace("_", " "): count for name, count in summary.outcomes.items()}
    good = outcomes.get("ok", 0)
    others = ", ".join(f"{name} {count}" for name, count in outcomes.items() if name != "ok")
    yield tile("runs", str(summary.runs), f"restarts {summary.restarts}")
    yield tile("with a state at the end", str(good), others, "good" if good == summary.runs else "bad")
    yield tile("runs that were wrong", str(summary.wrong), WRONG_SAID, "bad" if summary.wrong else "good")
    for name, entry in (("NIS, epochs used whole", summary.nis), ("NEES at the end", summary.final_nees)):
        if entry.dof:
            yield tile(
                f"{name}, per degree of freedom", f"{entry.ratio:.3f}", str(entry).partition(", ")[2], _colour(entry)
            )
    known = [entry for entry in summary.nees_by_bin if entry.dof]
    if known:
        faults = sum(entry.overconfident for entry in known)
        note = f"of {len(known)}, NEES entering them"
        yield tile("range bins overconfident", str(faults), note, "bad" if faults else "good")
    for quantity in (each.name for each in summary.quantities):
        rows = [row for row in summary.bins if row.quantity == quantity and math.isfinite(row.rms)]
        if rows:
            worst = max(rows, key=lambda row: row.rms)
            claimed = math.isfinite(worst.published)
            verdict = "" if not claimed else "good" if worst.rms <= worst.published else "bad"
            where = f"at {worst.from_m:.2f} .. {worst.to_m:.2f} m"
            note = f"{where}; published {worst.published:g} {worst.unit}" if claimed else where
            yield tile(f"{quantity}, largest rms of a bin", f"{worst.rms:.3g} {worst.unit}", note, verdict)


def _colour(entry: Consistency) -> str:
    return "" if entry.withheld else "bad" if entry.overconfident else "good"


def _honest(summary: CampaignSummary) -> Iterator[tuple[object, ...]]:
    named = [(f"entering {low:.2f} .. {high:.2f} m", entry)
             for (low, high), entry in zip(pairwise(summary.edges_m), summary.nees_by_bin, strict=False)]  # fmt: skip
    for where, entry in [*named, ("at the end", summary.final_nees), ("all epochs used whole", summary.nis)]:
        verdict = str(entry).rpartition(": ")[2]
        if not entry.dof:
            yield f"{entry.quantity} {where}", "-", "-", 0, verdict
            continue
        interval = "-" if entry.withheld else f"{entry.lower:.3f} to {entry.upper:.3f}"
        told = _whole(verdict, _colour(entry))
        yield f"{entry.quantity} {where}", f"{entry.ratio:.3f}", interval, entry.dof, told


def _whole(text: str, colour: str = "") -> Markup:
    """A cell whose words are not broken on a phone."""
    return Markup(f'<span class="whole {colour}">{words(text)}</span>')


def _bins(summary: CampaignSummary) -> Iterator[tuple[object, ...]]:
    for row in summary.bins:
        share = f"{100.0 * row.share_within:.1f} %" if math.isfinite(row.share_within) else "-"
        numbers = (figure(value, row.unit) for value in (row.rms, row.worst, row.sigma, row.published))
        yield _whole(f"{row.from_m:.2f} .. {row.to_m:.2f}"), _whole(row.quantity), row.runs, *numbers, share


def _final(summary: CampaignSummary) -> Iterator[tuple[object, ...]]:
    for row in summary.final:
        numbers = (row.mean, row.deviation, row.three_sigma, row.worst, row.sigma)
        yield row.component, *(figure(value) for value in numbers)


def _values(value: Any, where: str = "") -> Iterator[tuple[str, object]]:
    """Keys of nested tables joined by dots, and their values."""
    for key, entry in value.items():
        if isinstance(entry, dict):
            yield from _values(entry, f"{where}{key}.")
        else:
            yield f"{where}{key}", "-" if entry is None else entry


def _card(title: str, drawn: str) -> str:
    label = f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{words(title)}">'
    return f'<div class="chart"><h3>{words(title)}</h3>{label}{drawn}</svg></div>'


class _Axes:
    """Where a value stands in a chart; heights by their logarithm if they are to."""

    def __init__(self, x: tuple[float, float], y: tuple[float, float], log: bool = False) -> None:
        self._x, self._log = x, log
        self._y = (math.log10(y[0]), math.log10(y[1])) if log else y

    def across(self, x: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (x - self._x[0]) / (self._x[1] - self._x[0])

    def up(self, y: float) -> float:
        value = math.log10(y) if self._log else y
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - self._y[0]) / (self._y[1] - self._y[0])

    def box(self, x: tuple[float, float], y: tuple[float, float], colour: str, opacity: float = 1.0) -> str:
        left, right, top, bottom = self.across(x[0]), self.across(x[1]), self.up(y[1]), self.up(y[0])
        size = f'x="{left:.2f}" y="{top:.2f}" width="{right - left:.2f}" height="{max(0.0, bottom - top):.2f}"'
        return f'<rect {size} style="fill:var(--{colour});opacity:{opacity:g}"/>'

    def line(self, points: list[tuple[float, float]], colour: str, dash: str = "none", width: float = 1.6) -> str:
        path = " ".join(f"{self.across(x):.2f},{self.up(y):.2f}" for x, y in points)
        style = f"fill:none;stroke:var(--{colour});stroke-width:{width:g};stroke-dasharray:{dash}"
        return f'<polyline points="{path}" style="{style}"/>'

    def frame(self, x: list[float], y: list[float], name: str, rise: str) -> str:
        """Grid, ticks and names of both axes."""
        out = []
        for value in y:
            out.append(self.line([(self._x[0], value), (self._x[1], value)], "grid", width=1.0))
            out.append(_text(LEFT - 5.0, self.up(value) + 4.0, f"{value:.3g}", "end"))
        out += [_text(self.across(value), HEIGHT - BOTTOM + 14.0, f"{value:.4g}") for value in x]
        out.append(_text(0.5 * (LEFT + WIDTH - RIGHT), HEIGHT - 5.0, name))
        middle = 0.5 * (HEIGHT - BOTTOM + TOP)
        out.append(f'<g transform="translate(11 {middle:g}) rotate(-90)">{_text(0.0, 0.0, rise)}</g>')
        return "".join(out)


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" style="fill:var(--soft)">{words(text)}</text>'


def _by_range(flown: FlownCampaign) -> str:
    """Charts of the rms errors of the runs by range."""
    said = f"{BANDS_SAID}. Line: rms error of all runs; dashes: reported 1-sigma; dots: published."
    charts = []
    known = flown.runs.columns()
    for quantity in flown.summary.quantities:
        if f"bin0_rms_{quantity.column}" not in known:
            continue
        rows = [row for row in flown.summary.bins if row.quantity == quantity.name]
        values = rms_by_bin(flown.runs.read, quantity.column, len(rows))
        shown_of = [
            *(v for each in values if len(each) for v in np.percentile(each, (0.5, 99.5))),
            *(v for row in rows for v in (row.rms, row.sigma, row.published)),
        ]
        positive = [v for v in shown_of if math.isfinite(v) and v > 0.0]
        if not positive:
            continue
        low, high = 0.8 * min(positive), 1.25 * max(positive)
        axes = _Axes((min(row.from_m for row in rows), max(row.to_m for row in rows)), (low, high), log=True)
        edges = [rows[0].from_m, *(row.to_m for row in rows)]
        drawn = [axes.frame(_few(edges), _ticks(low, high), "range, m", f"{quantity.name}, {rows[0].unit}")]
        for row, each in zip(rows, values, strict=True):
            for under, over, dark in SHARES if len(each) else ():
                a, b = np.maximum(np.percentile(each, (under, over)), low)
                drawn.append(axes.box((row.from_m, row.to_m), (float(a), float(b)), "estimate", dark))
        for key, colour, dash in (
            ("rms", "estimate", "none"),
            ("sigma", "spread", "6 4"),
            ("published", "published", "2 3"),
        ):
            for row in rows:
                if math.isfinite(value := getattr(row, key)) and value > 0.0:
                    drawn.append(axes.line([(row.from_m, value), (row.to_m, value)], colour, dash))
        charts.append(_card(f"{quantity.name}, rms error of a run", "".join(drawn)))
    return paragraph(said[0].upper() + said[1:]) + f'<div class="charts">{"".join(charts)}</div>'


def _few(edges: list[float]) -> list[float]:
    return edges[:: max(1, len(edges) // 6)]


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers for a logarithmic axis: decades alone if these are many, more if they are few."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    few = high < 6.0 * low
    steps = (1, 2, 3, 5, 7) if few else (1, 2, 5) if len(decades) <= 4 else (1,)
    return [v for k in decades for v in (step * 10.0**k for step in steps) if low <= v <= high]


def _at_end(flown: FlownCampaign) -> str:
    """Histograms of the errors at the end over their reported sigmas."""
    charts = []
    grid = np.linspace(-5.0, 5.0, 101)
    normal = np.exp(-0.5 * grid**2) / math.sqrt(2.0 * math.pi)
    for name in (row.component for row in flown.summary.final):
        ratio: Vector = final_ratio(flown.runs.read, name)
        if not len(ratio):
            continue
        edges = ratio_edges(len(ratio))
        density = np.histogram(np.clip(ratio, -5.0, 5.0), edges, density=True)[0]
        top = 1.08 * max(float(density.max()), float(normal.max()))
        axes = _Axes((-5.0, 5.0), (0.0, top))
        heights = [v for v in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0) if v <= top]
        drawn = axes.frame([-4.0, -2.0, 0.0, 2.0, 4.0], heights, "error over 1-sigma", "density")
        drawn += "".join(
            axes.box(pair, (0.0, float(height)), "estimate", 0.55)
            for pair, height in zip(pairwise(edges.tolist()), density, strict=True)
        )
        drawn += axes.line(list(zip(grid.tolist(), normal.tolist(), strict=True)), "published")
        charts.append(_card(ratio_title(name, ratio), drawn))
    return (
        paragraph(f"{FINAL_SAID}; what lies beyond is counted at the ends.")
        + f'<div class="charts">{"".join(charts)}</div>'
    )
