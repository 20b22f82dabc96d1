"""Pictures of a campaign: distributions of errors by range beside the published figures, and at the end."""

from pathlib import Path
from typing import Any

import numpy as np

from relnav.accuracy.campaign_summary import CampaignSummary, Reader
from relnav.accuracy.sensitivities import LISTED, Sensitivities, Share
from relnav.arrays import Vector
from relnav.files.picture_style import (
    ESTIMATE,
    PUBLISHED,
    SPREAD,
    heading,
    named_line,
    new_figure,
    one_legend,
    plain_decades,
    save,
    styled,
)

SHARES = ((0.5, 99.5, 0.15), (5.0, 95.0, 0.25), (25.0, 75.0, 0.4))
"""Percentiles between which a band is drawn, and how dark."""
BANDS_SAID = "rms error of a run; bands hold 50, 90 and 99 % of the runs"
FINAL_SAID = "Error at the end over its reported 1-sigma; line: normal distribution"


def rms_by_bin(read: Reader, name: str, bins: int) -> list[Vector]:
    """Rms errors of the runs that were in a range bin, bin by bin."""
    values = [read([f"bin{k}_rms_{name}"])[f"bin{k}_rms_{name}"] for k in range(bins)]
    return [each[np.isfinite(each)] for each in values]


def final_ratio(read: Reader, name: str) -> Vector:
    """Errors at the end of the runs over their reported sigmas, of those that have a state."""
    values = read([f"final_error_{name}", f"final_sigma_{name}"])
    ratio: Vector = values[f"final_error_{name}"] / values[f"final_sigma_{name}"]
    return ratio[np.isfinite(ratio)]


def ratio_edges(runs: int) -> Vector:
    """Edges of the histogram of so many ratios; those beyond are counted at its ends."""
    return np.linspace(-5.0, 5.0, 11 + 2 * round(runs ** (1.0 / 3.0)))


def ratio_title(name: str, ratio: Vector) -> str:
    """What a histogram is of."""
    return f"{name}: mean {np.mean(ratio):+.2f}, deviation {np.std(ratio):.2f} sigma"


def draw_errors(summary: CampaignSummary, read: Reader, path: Path) -> None:
    """Draw the distribution over runs of the rms error in every range bin, beside reported and published 1-sigma."""
    with styled():
        count = len(summary.quantities)
        figure = new_figure(8.0, 0.6 + 2.8 * count)
        axes = figure.subplots(count, 1, sharex=True)
        for axis, quantity in zip(axes, summary.quantities, strict=True):
            rows = [row for row in summary.bins if row.quantity == quantity.name]
            _draw_bins(axis, summary.edges_m, rows, rms_by_bin(read, quantity.column, len(summary.edges_m) - 1))
            axis.set_title(quantity.name.capitalize())
            axis.set_ylabel(quantity.unit)
        axes[-1].set_xlabel("range, m")
        heading(figure, f"{summary.runs} approaches: {BANDS_SAID}")
        one_legend(figure)
        save([figure], path)


def _draw_bins(axis: Any, edges_m: Any, rows: Any, values: list[Vector]) -> None:
    middles = 0.5 * (np.array(edges_m[:-1]) + np.array(edges_m[1:]))
    seen = [k for k, each in enumerate(values) if len(each)]
    for low, high, alpha in SHARES:
        band = np.array([np.percentile(values[k], (low, high)) for k in seen]).reshape(-1, 2)
        axis.fill_between(middles[seen], band[:, 0], band[:, 1], color=ESTIMATE, alpha=alpha, lw=0.0)
    axis.plot(middles, [row.rms for row in rows], "o-", ms=3.5, color=ESTIMATE, label="rms error, all runs")
    sigma = [row.sigma for row in rows]
    axis.plot(middles, sigma, "s", ls=(0, (4, 2)), ms=3.5, color=SPREAD, label="reported 1-sigma")
    if np.isfinite(rows[0].published):
        named_line(axis, rows[0].published, f"published {rows[0].published:g} {rows[0].unit}")
    if any(row.rms > 0.0 for row in rows):
        axis.set_yscale("log")
        plain_decades(axis)


def draw_final(summary: CampaignSummary, read: Reader, path: Path) -> None:
    """Draw histograms of the error at the end of every run over its reported sigma, beside the normal distribution."""
    with styled():
        names = [row.component for row in summary.final]
        figure = new_figure(10.5, 0.3 + 3.0 * (len(names) // 3))
        axes = figure.subplots(len(names) // 3, 3, sharex=True, sharey=True)
        grid = np.linspace(-5.0, 5.0, 201)
        for axis, name in zip(axes.ravel(), names, strict=True):
            ratio = final_ratio(read, name)
            if len(ratio):
                bins = ratio_edges(len(ratio))
                share = np.full(len(ratio), 1.0 / (len(ratio) * (bins[1] - bins[0])))
                axis.hist(np.clip(ratio, -5.0, 5.0), bins=bins, weights=share, color=ESTIMATE, alpha=0.55)
                axis.plot(grid, np.exp(-0.5 * grid**2) / np.sqrt(2.0 * np.pi), color=PUBLISHED, lw=1.6)
                axis.set_title(ratio_title(name, ratio))
        for axis in axes[-1]:
            axis.set_xlabel("error / reported 1-sigma")
        for axis in axes[:, 0]:
            axis.set_ylabel("share per 1-sigma")
        heading(figure, FINAL_SAID)
        save([figure], path)


def draw_sensitivities(found: Sensitivities, path: Path) -> None:
    """Draw what the three components of the position error at the end come from: indices, and shifts by one sigma."""
    components = list(found.deviation)[:3]
    most = min(LISTED, max((len(found.of(name)) for name in components), default=1) or 1)
    with styled():
        figure = new_figure(10.5, 1.2 + 3.0 * max(0.9, 0.09 * most) * len(components))
        axes = figure.subplots(len(components), 2, squeeze=False)
        for (left, right), name in zip(axes, components, strict=True):
            shares = found.of(name)[:LISTED][::-1]
            _draw_shares(left, shares)
            left.set_title(f"{name}: share of the variance")
            shifts = sorted((one for one in found.shifts if one.component == name), key=lambda one: abs(one.shift))
            moved = [one for one in shifts if np.isfinite(one.shift)][-LISTED:]
            spread = [one.spread if np.isfinite(one.spread) else 0.0 for one in moved]
            right.barh([one.number for one in moved], [one.shift for one in moved], xerr=spread, color=SPREAD)
            right.axvline(0.0, color="0.5", lw=0.8)
            right.locator_params(axis="x", nbins=6)
            right.ticklabel_format(axis="x", style="sci", scilimits=(-3, 3))
            right.set_title(f"{name}: moved by one sigma alone")
        axes[-1, 0].set_xlabel("Sobol' index")
        axes[-1, 1].set_xlabel("shift, in the unit of its component")
        heading(figure, f"Error at the end: where it comes from; {found.runs_used}")
        one_legend(figure)
        save([figure], path)


def _draw_shares(axis: Any, shares: list[Share]) -> None:
    places = np.arange(len(shares), dtype=np.float64)
    for offset, key, colour, label in (
        (0.2, "total", ESTIMATE, "total index"),
        (-0.2, "first", PUBLISHED, "first-order index"),
    ):
        value, low, high = (np.array([getattr(one, f"{key}{end}") for one in shares]) for end in ("", "_low", "_high"))
        error = np.maximum(0.0, np.array([value - low, high - value]).reshape(2, -1))
        axis.barh(places + offset, value, 0.38, xerr=error, color=colour, label=label, error_kw={"lw": 0.9})
    axis.set_yticks(places, [one.cause for one in shares])
    axis.axvline(0.0, color="0.5", lw=0.8)
