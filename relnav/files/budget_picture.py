"""Picture of a three-beacon error budget: every line over range, one fix beside the settled filter."""

from pathlib import Path
from typing import Any

from relnav.accuracy.budget import QUANTITIES, Budget
from relnav.errors import UsageError
from relnav.files.atomic import check_png, replacing


def draw_budget(report: Any, path: Path, before: Any = None, change: str = "") -> None:
    """Draw a budget; .png. With the budget before a change, its total is drawn too.

    Raises
    ------
    UsageError
        For another ending, or a budget of another kind.
    """
    check_png(path)
    if not isinstance(report, Budget):
        raise UsageError("--plot draws budgets of three-beacon missions; this one has no picture")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 10), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    places = report.places
    ranges = [place.range_m for place in places]
    for column, (which, title) in enumerate((("single", "one fix"), ("settled", "settled filter"))):
        axes[0, column].set_title(title)
        for row, (quantity, unit, scale) in enumerate(QUANTITIES):
            axis = axes[row, column]
            for number, line in enumerate(places[0].lines):
                values = [getattr(place.lines[number], which)[row] * scale for place in places]
                if not any(value > 1e-5 for value in values):
                    continue
                style, width = ("-", 1.5) if line.counts else (":", 1.0)
                name = line.name if line.counts else f"({line.name})"
                axis.semilogy(ranges, values, style, lw=width, color=f"C{number}", label=name)
            total = [place.total(which)[row] * scale for place in places]
            axis.semilogy(ranges, total, "k-", lw=2.5, label="total")
            if before is not None:
                earlier = [place.total(which)[row] * scale for place in before.places]
                axis.semilogy(ranges, earlier, "k--", lw=1.5, label=f"total before {change}")
            axis.set_ylabel(f"{quantity}, {unit}, 1-sigma")
            axis.grid(alpha=0.3)
    for axis in axes[2]:
        axis.set_xlabel("range, m")
    entries = {
        label: handle for axis in axes.ravel() for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.suptitle(f"Error budget of {report.model} on the docking axis; dotted: not in the total")
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=3, fontsize=8)
    with replacing(path) as temporary:
        FigureCanvasAgg(figure)
        figure.savefig(temporary, format="png", dpi=100)
